"""The stiffness of a cable from its measured shapes: a differentiable Cosserat rod, its fit, and the physics it lacks.

Start with ``fit(load_study(folder))``. float64 must be on before the first array:
``jax.config.update("jax_enable_x64", True)``.
"""

from importlib import import_module

_HOMES = {
    "Boundary": "rod.boundary",
    "Cable": "rod.cable",
    "CableModel": "rod.model",
    "Equilibrium": "equilibrium.solve",
    "MixedNewton": "equilibrium.newton",
    "Scan2FlexError": "errors",
    "StudyError": "errors",
    "equilibrium": "equilibrium.solve",
    "fit": "fit",
    "load_study": "study",
    "plot": "",
    "predict": "predict",
    "save_study": "study",
}
__all__ = sorted(_HOMES)
__version__ = "0.1.0"


def __getattr__(name: str):
    """Public names are imported when they are first used, so that reading a study does not load JAX."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name == "plot":
        return import_module(f"{__name__}.plot")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)


def __dir__():
    """Public names."""
    return __all__
