"""Stiffness of a cable from its measured shapes: a differentiable Cosserat rod, its fit, and the search for missing physics.

Start with ``fit(load_study(folder))``. float64 must be on before the first array:
``jax.config.update("jax_enable_x64", True)``.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from scan2flex_jax.version import __version__ as __version__

if TYPE_CHECKING:  # a type checker sees plain imports; at run time each name is imported at its first use
    from scan2flex_jax import plot as plot
    from scan2flex_jax.cache import keep_compiled as keep_compiled
    from scan2flex_jax.errors import Scan2FlexError as Scan2FlexError
    from scan2flex_jax.errors import StudyError as StudyError
    from scan2flex_jax.fitting import ResidualFunction as ResidualFunction
    from scan2flex_jax.fitting import boundary_of as boundary_of
    from scan2flex_jax.fitting import model_of as model_of
    from scan2flex_jax.fitting import residual_function as residual_function
    from scan2flex_jax.inference import Settings as Settings
    from scan2flex_jax.inference import expect as expect
    from scan2flex_jax.inference import explain as explain
    from scan2flex_jax.inference import fit as fit
    from scan2flex_jax.inference import memory_test as memory_test
    from scan2flex_jax.inference import plan as plan
    from scan2flex_jax.prediction import predict as predict
    from scan2flex_jax.reporting import report as report
    from scan2flex_jax.rod.boundary import Boundary as Boundary
    from scan2flex_jax.rod.cable import Cable as Cable
    from scan2flex_jax.rod.model import CableModel as CableModel
    from scan2flex_jax.statics import AbstractRodSolver as AbstractRodSolver
    from scan2flex_jax.statics import Equilibrium as Equilibrium
    from scan2flex_jax.statics import MixedNewton as MixedNewton
    from scan2flex_jax.statics import ScaledMinimiser as ScaledMinimiser
    from scan2flex_jax.statics import Settled as Settled
    from scan2flex_jax.statics import equilibrium as equilibrium
    from scan2flex_jax.statics import solve_rod as solve_rod
    from scan2flex_jax.study import Angle as Angle
    from scan2flex_jax.study import Clamp as Clamp
    from scan2flex_jax.study import EffectDeclaration as EffectDeclaration
    from scan2flex_jax.study import Markers as Markers
    from scan2flex_jax.study import MeasuredCurve as MeasuredCurve
    from scan2flex_jax.study import Study as Study
    from scan2flex_jax.study import StudyPose as StudyPose
    from scan2flex_jax.study import Tolerance as Tolerance
    from scan2flex_jax.study import Unknown as Unknown
    from scan2flex_jax.study import Wrench as Wrench
    from scan2flex_jax.study import load_study as load_study
    from scan2flex_jax.study import save_study as save_study

_HOMES = {
    "AbstractRodSolver": "statics",
    "Angle": "study",
    "Boundary": "rod.boundary",
    "Cable": "rod.cable",
    "CableModel": "rod.model",
    "Clamp": "study",
    "EffectDeclaration": "study",
    "Equilibrium": "statics",
    "Markers": "study",
    "MeasuredCurve": "study",
    "MixedNewton": "statics",
    "ResidualFunction": "fitting",
    "ScaledMinimiser": "statics",
    "Scan2FlexError": "errors",
    "Settings": "inference",
    "Settled": "statics",
    "Study": "study",
    "StudyError": "errors",
    "StudyPose": "study",
    "Tolerance": "study",
    "Unknown": "study",
    "Wrench": "study",
    "boundary_of": "fitting",
    "equilibrium": "statics",
    "expect": "inference",
    "explain": "inference",
    "fit": "inference",
    "keep_compiled": "cache",
    "load_study": "study",
    "memory_test": "inference",
    "model_of": "fitting",
    "plan": "inference",
    "plot": "",
    "predict": "prediction",
    "report": "reporting",
    "residual_function": "fitting",
    "save_study": "study",
    "solve_rod": "statics",
}
__all__ = sorted(_HOMES)


def __getattr__(name: str) -> object:
    """A public name, imported at its first use, so that reading a study does not load JAX."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    home = import_module(f"{__name__}.{_HOMES[name] or name}")
    found = getattr(home, name) if _HOMES[name] else home
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    """Public names."""
    return list(__all__)
