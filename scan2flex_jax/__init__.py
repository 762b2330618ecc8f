"""The stiffness of a cable from its measured shapes: a differentiable Cosserat rod, its fit, and the physics it lacks.

Start with ``fit(load_study(folder))``. float64 must be on before the first array:
``jax.config.update("jax_enable_x64", True)``.
"""

import sys
from importlib import import_module
from types import ModuleType

_HOMES = {
    "Boundary": "rod.boundary",
    "Cable": "rod.cable",
    "CableModel": "rod.model",
    "Equilibrium": "equilibrium.solve",
    "MixedNewton": "equilibrium.newton",
    "Scan2FlexError": "errors",
    "StudyError": "errors",
    "equilibrium": "equilibrium.solve",
    "explain": "explain",
    "fit": "fit",
    "load_study": "study",
    "plan": "explain",
    "plot": "",
    "predict": "predict",
    "report": "report",
    "save_study": "study",
}
__all__ = sorted(_HOMES)
__version__ = "0.1.0"



def _public(name):
    """A public object, imported when it is first asked for, so that reading a study does not load JAX."""
    home = import_module(f"{__name__}.{_HOMES[name] or name}")
    return getattr(home, name) if _HOMES[name] else home


class _Package(ModuleType):
    """The package. `equilibrium`, `explain`, `fit`, `predict` and `report` name its functions, though modules are called so
    too: those are reached by imports from them, ``from scan2flex_jax.fit import METHODS``."""

    equilibrium = property(lambda self: _public("equilibrium"), lambda self, module: None)
    explain = property(lambda self: _public("explain"), lambda self, module: None)
    fit = property(lambda self: _public("fit"), lambda self, module: None)
    predict = property(lambda self: _public("predict"), lambda self, module: None)
    report = property(lambda self: _public("report"), lambda self, module: None)


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str):
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return _public(name)


def __dir__():
    """Public names."""
    return __all__
