"""From measured shapes to the minimum of their distances: what `inference` is built on.

Input: `poses`, `parameters` (unknowns, nuisance parameters and their priors), `start`, `problem`. Residuals: `distance`,
`states`, `evaluate`, and `residuals` as one traced function. Minimisers: `descent`, `quadratic`,
`least_squares` (with the paper's Nelder-Mead), `traced` (in JAX, for batches). `noise`, `discrepancy`: deviations.
"""

from scan2flex_jax.fitting.parameters import model_of
from scan2flex_jax.fitting.poses import boundary_of
from scan2flex_jax.fitting.residuals import ResidualFunction, residual_function
from scan2flex_jax.fitting.traced import TracedMinimum, TracedProblem, minimise, traced_problem

__all__ = ["ResidualFunction", "TracedMinimum", "TracedProblem", "boundary_of", "minimise", "model_of", "residual_function"]
__all__ += ["traced_problem"]
