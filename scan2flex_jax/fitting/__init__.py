"""From measured centre curves to material parameters, with their uncertainty and a verdict on their validity."""

from scan2flex_jax.fitting.law import Law, Reading
from scan2flex_jax.fitting.parameters import model_of
from scan2flex_jax.fitting.poses import boundary_of
from scan2flex_jax.fitting.residuals import ResidualFunction, residual_function
from scan2flex_jax.fitting.result import Estimate, Fit, PoseFit
from scan2flex_jax.fitting.run import METHODS, fit
from scan2flex_jax.fitting.settings import FitSettings

__all__ = [
    "METHODS",
    "Estimate",
    "Fit",
    "FitSettings",
    "Law",
    "PoseFit",
    "Reading",
    "ResidualFunction",
    "boundary_of",
    "fit",
    "model_of",
    "residual_function",
]
