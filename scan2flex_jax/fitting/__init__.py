"""Estimation: from measured shapes to material parameters, with intervals and a validation on unseen poses.

`run` is the sequence of a fit; `settings` its thresholds. Input: `poses`, `parameters` (unknowns, nuisance parameters and their
priors), `start`, `problem`. Residuals: `distance`, `states`, `evaluate`, and `residuals` as one traced function. Minimisers:
`least_squares`, with `branches` (full turns) and `mistakes` (of the input). Statistics: `noise`, `likelihood` (its
estimate), `discrepancy`, `statistics` (covariance, identifiability), `estimate` (values, intervals), `influence`
(sensitivities), `belief` (validation). Scans: `direct`, `cloud`, `cloud_noise`. Output: `result`, `answer` (rounded numbers).
"""

from scan2flex_jax.fitting.estimate import Estimate
from scan2flex_jax.fitting.law import Law, Reading
from scan2flex_jax.fitting.parameters import model_of
from scan2flex_jax.fitting.poses import boundary_of
from scan2flex_jax.fitting.residuals import ResidualFunction, residual_function
from scan2flex_jax.fitting.result import Fit, PoseFit
from scan2flex_jax.fitting.run import METHODS, fit
from scan2flex_jax.fitting.settings import FitSettings
from scan2flex_jax.fitting.traced import TracedMinimum, TracedProblem, minimise, traced_problem

__all__ = [
    "METHODS",
    "Estimate",
    "Fit",
    "FitSettings",
    "Law",
    "PoseFit",
    "Reading",
    "ResidualFunction",
    "TracedMinimum",
    "TracedProblem",
    "boundary_of",
    "fit",
    "minimise",
    "model_of",
    "residual_function",
    "traced_problem",
]
