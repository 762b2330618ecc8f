"""The reference solver: optimistix BFGS on the dimensionless, scaled energy.

optimistix stops on steps and values, never on the gradient, and skips curvature updates below an absolute threshold, so it
calls a rod of small energy solved far from its minimum. Here it sees coordinates ``z`` with ``twist = P z`` and
``P P' = unit H^-1`` of the Hessian where the round starts, and an energy counted from there in units of what the rod
stores: a well conditioned problem of order one. Differences of energy resolve a minimum to no better than the square root
of rounding (1e-8 of the length), so the last round minimises the squared scaled gradient, which is zero there. The
verdict is not optimistix's but `solve.Verdict`, from the out-of-balance force and the inertia of the Hessian.
"""

import jax.numpy as jnp
import optimistix as optx

from scan2flex_jax.compilation import compiled
from scan2flex_jax.rod.assembly import derivatives, free_motions, out_of_balance
from scan2flex_jax.rod.energy import potential_energy, retract, supported
from scan2flex_jax.rod.model import Configuration, Rod
from scan2flex_jax.statics.newton import lendable_stiffness

_ROUNDS = 2  # on the energy; the first one travels, the second one starts from a Hessian that fits
_STEPS = 4000
_TOLERANCE = 1.0e-8  # in scaled coordinates, where the minimum has curvature one
_SMALLEST = 1.0e-9  # curvature, over the largest, below which a direction is not stretched any further


@compiled
def bfgs_configuration(rod: Rod, start: Configuration) -> tuple[Configuration, list]:
    """The rod settled from ``start`` by optimistix BFGS, and the steps that each round took."""
    configuration, steps = supported(rod, start), []
    for last in [False] * _ROUNDS + [True]:
        configuration, count = _round(rod, configuration, last)
        steps.append(count)
    return configuration, steps


def _round(rod, base, last):
    unit = jnp.maximum(jnp.abs(potential_energy(base, rod)), lendable_stiffness(rod)[5, 5] / rod.length)
    scaling = _scaling(rod, base, unit)

    def moved(z):
        return retract(base, (scaling @ z).reshape(-1, 6))

    def energy(z, args):
        return (potential_energy(moved(z), rod) - potential_energy(base, rod)) / unit

    def squared_gradient(z, args):
        gradient = out_of_balance(rod, moved(z)) * free_motions(rod)
        return 0.5 * jnp.sum((scaling.T @ gradient.ravel() / unit) ** 2)

    goal = squared_gradient if last else energy
    solver: optx.BFGS = optx.BFGS(_TOLERANCE**2, _TOLERANCE**2) if last else optx.BFGS(_TOLERANCE, _TOLERANCE)
    found: optx.Solution = optx.minimise(goal, solver, jnp.zeros(scaling.shape[1]), max_steps=_STEPS, throw=False)
    return moved(found.value), found.stats["num_steps"]


def _scaling(rod, configuration, unit):
    """``P``; negative curvatures are taken by their size."""
    d = derivatives(rod, configuration, predict=lambda n: n.at[:, :3].set(0.0))
    values, vectors = jnp.linalg.eigh(dense(d.diagonal, d.upper))
    size = jnp.maximum(jnp.abs(values), _SMALLEST * jnp.max(jnp.abs(values)))
    return vectors * jnp.sqrt(unit / size)


def dense(diagonal, upper):
    """The dense symmetric matrix of block-tridiagonal parts."""
    n = diagonal.shape[0]
    i = jnp.arange(n)
    H = jnp.zeros((n, 6, n, 6), diagonal.dtype).at[i, :, i, :].set(diagonal)
    H = H.at[i[:-1], :, i[1:], :].set(upper).at[i[1:], :, i[:-1], :].set(jnp.swapaxes(upper, 1, 2))
    return H.reshape(6 * n, 6 * n)
