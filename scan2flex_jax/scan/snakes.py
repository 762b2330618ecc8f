"""The snakes energy of the paper's Eq. 8, all its terms, as a pure function of the guide points.

    E = 1/(N r^2) sum_i rho(d(curve, p_i) - r_i) + w_1 E_1            data: points lie a radius away from the curve
      + w_s 1/(K-2) sum_k (1 - cos(v_{k-1}, v_k)) + w_2 E_2           shape: smooth, and even in arc length

Two errors of the paper are corrected: its names of external and internal energy are swapped (the data term is the
external one), and its smoothness term is a mean cosine, which is largest for a smooth curve, so that
``1 - cos`` is minimised here. Its curve on ``[0, K]`` has K points at 0..K-1 (see `spline.py`).

E_1 penalises leaving the cloud: at samples of the curve, the distance of the nearest cloud point beyond the radius, squared
over r^2; samples inside a known gap do not count. E_2 penalises uneven arc length: variance of ``|v_k|`` over its mean
squared. ``rho`` is the pseudo-Huber loss: e^2 for small e, 2 delta |e| for outliers.

Every term is a sum of squares, so that least squares (Levenberg-Marquardt of optimistix) minimise the sum; the paper has
conjugate gradients with numerical derivatives instead, and reports slow convergence.

Symbols: ``x`` (K, 3) guide points (m), ``p`` cloud points (m), ``r_i`` their radius (m), ``v_k`` tangents at half-knots.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax import Array
from jaxtyping import Bool, Float

from scan2flex_jax.scan import spline

_SAMPLES_PER_SEGMENT = 2  # of E_1
_STEPS = 60  # of the minimiser: the last stage refines what they leave


class SnakesWeights(eqx.Module):
    """Weights of the terms (-); ``leave`` is w_1, ``smooth`` w_s, ``uneven`` w_2; ``outlier`` is delta over r."""

    leave: float = 0.1
    smooth: float = 0.1
    uneven: float = 0.3
    outlier: float = 0.5


class SnakesProblem(eqx.Module):
    """Data of the energy: points and their radii (m), the mask of real points (the rest is padding), r (m)."""

    points: Float[Array, "n 3"]
    radii: Float[Array, " n"]
    real: Bool[Array, " n"]
    in_gap: Bool[Array, " m"]
    radius: Float[Array, ""]
    weights: SnakesWeights = SnakesWeights()


def gap_samples(count: int) -> Float[Array, " m"]:
    """Parameters at which E_1 samples a curve of ``count`` points."""
    return jnp.linspace(0.0, count - 1.0, _SAMPLES_PER_SEGMENT * (count - 1) + 1)


def snakes_residuals(x: Float[Array, "K 3"], problem: SnakesProblem) -> dict[str, Float[Array, "..."]]:
    """The terms as vectors whose squares add up to the energy: data, leave (E_1), smooth, uneven (E_2)."""
    w, r = problem.weights, problem.radius
    c = spline.coefficients(x)
    e = jnp.where(problem.real, spline.distances(c, problem.points) - problem.radii, 0.0) / r
    data = e * jnp.sqrt(2.0 / (1.0 + jnp.sqrt(1.0 + (e / w.outlier) ** 2)))  # its square is the pseudo-Huber loss
    v = spline.half_knot_tangents(c)
    speed = jnp.linalg.norm(v, axis=1)
    turn = jnp.diff(v / speed[:, None], axis=0)  # |difference of unit vectors|^2 = 2 (1 - cos)
    mean = jnp.mean(speed)
    return {
        "data": data / jnp.sqrt(jnp.sum(problem.real)),
        "leave": jnp.sqrt(w.leave) * _beyond(c, x.shape[0], problem),
        "smooth": jnp.sqrt(w.smooth / (2.0 * turn.shape[0])) * turn,
        "uneven": jnp.sqrt(w.uneven / speed.shape[0]) * (speed / mean - 1.0),
    }


def _beyond(c, count, problem) -> Float[Array, " m"]:
    """Distance (in r) of each curve sample beyond 1.5 r from the nearest cloud point, normalised to a mean square."""
    q = spline.evaluate(c, gap_samples(count))
    p = jnp.where(problem.real[:, None], problem.points, 1e6)
    square = jnp.sum(jax.lax.stop_gradient(q) ** 2, axis=1)[:, None] - 2.0 * jax.lax.stop_gradient(q) @ p.T
    near = p[jnp.argmin(square + jnp.sum(p**2, axis=1), axis=1)]
    gap2 = jnp.sum((q - near) ** 2, axis=1) + 1e-24
    beyond = jnp.maximum(jnp.sqrt(gap2) / problem.radius - 1.5, 0.0)
    return jnp.where(problem.in_gap, 0.0, beyond) / jnp.sqrt(q.shape[0])


def snakes_terms(x: Float[Array, "K 3"], problem: SnakesProblem) -> dict[str, Float[Array, ""]]:
    """Value of each term of the energy (-)."""
    return {name: jnp.sum(part**2) for name, part in snakes_residuals(x, problem).items()}


def snakes_energy(x: Float[Array, "K 3"], problem: SnakesProblem) -> Float[Array, ""]:
    """The energy (-)."""
    return jnp.asarray(sum(snakes_terms(x, problem).values()))


@eqx.filter_jit
def _solve(x0, problem):
    """The points of least energy, by displacements in radii, so that steps are of order one."""
    solver: optx.LevenbergMarquardt = optx.LevenbergMarquardt(rtol=1e-6, atol=1e-8)

    def residuals(y, _):
        return snakes_residuals(x0 + problem.radius * y, problem)

    x = x0 + problem.radius * optx.least_squares(residuals, solver, jnp.zeros_like(x0), max_steps=_STEPS, throw=False).value
    return jnp.where(snakes_energy(x, problem) < snakes_energy(x0, problem), x, x0)


def minimise_snakes(x0: Float[np.ndarray, "K 3"], problem: SnakesProblem) -> Float[np.ndarray, "K 3"]:
    """Points (m) of least energy, by descent from ``x0`` (m); those of ``x0`` where no step gains."""
    return np.asarray(_solve(jnp.asarray(x0), problem))
