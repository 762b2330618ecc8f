"""From measured centre curves to material parameters, with their uncertainty and a verdict on their validity."""

from scan2flex_jax.fit.result import Estimate, Fit, PoseFit
from scan2flex_jax.fit.run import METHODS, fit

__all__ = ["METHODS", "Estimate", "Fit", "PoseFit", "fit"]
