"""Plots of a fit, an explanation or a sweep, on matplotlib axes that each function takes and returns.

Arguments are the object, the part of it to show, then the axes (created by default): `shapes`, `errors`, `residual`,
`comparison`, `load`, `law`, `stiffness`, `basins`, `expected`. `overview`, `explained` and `varied` are whole figures;
`save` writes one. The page of `report` uses the same plots. The state before is drawn broad and pale under the state after;
legends stand above the axes.
"""

from scan2flex_jax.plot.in_space import measured, shapes
from scan2flex_jax.plot.over_length import along, errors, law, load, residual, stiffness
from scan2flex_jax.plot.scores import basins, comparison, correlations, expected
from scan2flex_jax.plot.style import BAND, MEASURED, save
from scan2flex_jax.plot.whole import explained, overview, varied

__all__ = [
    "BAND", "MEASURED", "along", "basins", "comparison", "correlations", "errors", "expected", "explained", "law", "load",
    "measured", "overview", "residual", "save", "shapes", "stiffness", "varied",
]  # fmt: skip
