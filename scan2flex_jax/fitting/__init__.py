"""From measured centre curves to material parameters, with their uncertainty and a verdict on their validity."""

from scan2flex_jax.fitting.result import Estimate, Fit, PoseFit
from scan2flex_jax.fitting.run import METHODS, fit

__all__ = ["METHODS", "Estimate", "Fit", "PoseFit", "fit"]
