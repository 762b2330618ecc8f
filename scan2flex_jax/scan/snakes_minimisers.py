"""Four minimisers of a snakes energy, with their costs.

* ``cg``: nonlinear conjugate gradients (Polak-Ribiere), restarted along the gradient, as in the paper;
* ``bfgs``: quasi-Newton;
* ``least squares``: Levenberg-Marquardt on the residual vector, the default;
* ``cg numerical``: the paper's method: conjugate gradients with central differences, two evaluations per
  coordinate. It is a baseline for comparison, not for use.

Coordinates are in units of the radius, so that steps are of order one. Convergence is tested independently of the solver:
the gradient (per unit of r) must have fallen below `GRADIENT_TOLERANCE` of its initial value, or of the energy.

Symbols: ``x`` (K, 3) points (m), ``y = (x - x_0)/r`` (-), energy E (-).
Reference: optimistix (NonlinearCG, BFGS, LevenbergMarquardt).
"""

from dataclasses import dataclass
from time import perf_counter

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jaxtyping import Float

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.scan.snakes import SnakesProblem, snakes_energy, snakes_residuals

METHODS = ("least squares", "bfgs", "cg", "cg numerical")
GRADIENT_TOLERANCE = 1e-3
_DIFFERENCE = 1e-5  # step of the numerical gradient, in r: error 1e-10 of the curvature, noise 1e-11 of the energy
_RTOL, _ATOL = 1e-9, 1e-11
_RESTART = 40  # conjugate-gradient steps before the next restart


@dataclass(frozen=True)
class Minimised:
    """Points (m), energy before and after, gradient norm per r, evaluations of the energy, seconds, and convergence."""

    points: Float[np.ndarray, "K 3"]
    start_energy: float
    energy: float
    gradient: float
    evaluations: int
    seconds: float
    converged: bool
    trace: tuple[tuple[int, float], ...] = ()


def _energy(y, args):
    x0, problem = args
    return snakes_energy(x0 + problem.radius * y, problem)


def _residuals(y, args):
    x0, problem = args
    return snakes_residuals(x0 + problem.radius * y, problem)


@jax.custom_vjp
def _energy_numerical(y, args):
    return _energy(y, args)


def _numerical_forward(y, args):
    return _energy(y, args), (y, args)


def _numerical_backward(saved, g):
    y, args = saved
    flat = y.ravel()

    def difference(i):
        step = jnp.zeros_like(flat).at[i].set(_DIFFERENCE).reshape(y.shape)
        return (_energy(y + step, args) - _energy(y - step, args)) / (2.0 * _DIFFERENCE)

    slope = jax.lax.map(difference, jnp.arange(flat.size)).reshape(y.shape)
    return g * slope, None


_energy_numerical.defvjp(_numerical_forward, _numerical_backward)


@eqx.filter_jit
def _judge(y, args):
    value, slope = jax.value_and_grad(_energy)(y, args)
    return value, jnp.linalg.norm(slope)


@eqx.filter_jit
def _solve(method: str, y, args, steps):
    """One run of a solver: the new y and the number of steps."""
    out: optx.Solution
    if method == "least squares":
        solver: optx.LevenbergMarquardt = optx.LevenbergMarquardt(rtol=1e-6, atol=1e-8)
        out = optx.least_squares(_residuals, solver, y, args, max_steps=steps, throw=False)
    elif method == "bfgs":
        out = optx.minimise(_energy, optx.BFGS(_RTOL, _ATOL), y, args, max_steps=steps, throw=False)
    else:
        fn = _energy_numerical if method == "cg numerical" else _energy
        out = optx.minimise(fn, optx.NonlinearCG(_RTOL, _ATOL), y, args, max_steps=steps, throw=False)
    return out.value, out.stats["num_steps"]


def minimise_snakes(x0, problem: SnakesProblem, method: str = "least squares", max_steps: int = 200) -> Minimised:
    """Minimise the energy from points ``x0`` (m); conjugate gradients restart every 40 steps until they gain nothing."""
    if method not in METHODS:
        raise Scan2FlexError(f"there is no method {method!r} for the snakes energy: choose one of {', '.join(METHODS)}")
    began = perf_counter()
    args = (jnp.asarray(x0), problem)
    y = jnp.zeros_like(args[0])
    energy, slope = (float(a) for a in _judge(y, args))
    start, first, taken, trace = energy, slope, 0, [(0, energy)]
    batch = _RESTART if method.startswith("cg") else max_steps
    while taken < max_steps:
        y_new, steps = _solve(method, y, args, min(batch, max_steps - taken))
        new, slope_new = (float(a) for a in _judge(y_new, args))
        taken += max(int(steps), 1)
        gained = energy - new
        if np.isfinite(new) and gained > 0.0:
            y, energy, slope = y_new, new, slope_new
        trace.append((taken, energy))
        if not gained > 1e-7 * energy or slope <= 0.1 * GRADIENT_TOLERANCE * energy:
            break
    per_step = 2 * y.size + 1 if method == "cg numerical" else 1
    converged = slope <= GRADIENT_TOLERANCE * max(first, energy)
    points = np.asarray(args[0] + problem.radius * y)
    seconds = perf_counter() - began
    return Minimised(points, start, energy, slope, taken * per_step, seconds, converged, tuple(trace))
