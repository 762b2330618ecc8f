"""Any optimistix minimiser as a rod solver, on the dimensionless, scaled energy; with BFGS the reference solver.

optimistix stops on steps and values, never on the gradient, and skips curvature updates below an absolute threshold, so it
can report a rod of small energy as solved far from its minimum. Here its variables are coordinates ``z`` with
``twist = P z`` and ``P P' = unit H^-1`` for the Hessian at the start of the round, and the energy relative to that start in
units of the stored energy: a well conditioned problem of order one. Energy differences resolve a minimum only to the square
root of rounding (1e-8 of the length), so the last round minimises the squared scaled gradient, which vanishes there. The
status comes not from optimistix but from `verdict.judge`: out-of-balance force and inertia of the Hessian.
"""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import optimistix as optx

from scan2flex_jax.rod.assembly import derivatives, free_motions, out_of_balance
from scan2flex_jax.rod.energy import potential_energy, retract, supported
from scan2flex_jax.rod.model import Configuration, Rod
from scan2flex_jax.statics import blocktridiagonal as bt
from scan2flex_jax.statics.balance import BALANCE, imbalance
from scan2flex_jax.statics.newton import lendable_stiffness
from scan2flex_jax.statics.solver import AbstractRodSolver, Settled, Steps

_SHARES = (2, 4, 4)  # of the steps, one divisor per round: approach, restart with a fresh Hessian, finish
_SMALLEST = 1.0e-9  # curvature over the largest: directions below it are scaled no further
MAX_STEPS = 12_000


class ScaledMinimiser(AbstractRodSolver):
    """An optimistix minimiser (`optimistix.BFGS`, `LBFGS`, `NonlinearCG`, `GradientDescent`, `NelderMead`, ...) in rounds.

    Its tolerances apply to the coordinates ``z`` and the scaled energy, squared in the last round, whose objective is a square.
    A result that only meets loose tolerances has the status "the forces do not balance". Of ``max_steps`` (12,000 by default)
    the first round gets half, the second and the last a quarter each.
    """

    minimiser: optx.AbstractMinimiser

    def settle(self, rod: Rod, start: Configuration, max_steps: Steps = None) -> Settled:
        """See `AbstractRodSolver.settle`."""
        most = MAX_STEPS if max_steps is None else max_steps
        configuration, steps = supported(rod, start), jnp.array(0)
        for i, share in enumerate(_SHARES):
            last = i == len(_SHARES) - 1
            minimiser = _squared(self.minimiser) if last else self.minimiser
            configuration, found = _round(rod, configuration, minimiser, max(most // share, 1), last)
            steps = steps + found.stats["num_steps"]
        d = derivatives(rod, configuration)
        reached = found.result == optx.RESULTS.nonlinear_max_steps_reached
        exhausted = reached & ~(imbalance(rod, d) < BALANCE)  # rounding keeps some minimisers iterating on a solved rod
        return Settled(configuration, d, bt.factor(d.diagonal, d.upper).negative, steps, exhausted)


def _squared(minimiser: Any) -> Any:
    """The minimiser with its tolerances squared, where it has any."""
    given = [name for name in ("rtol", "atol") if isinstance(getattr(minimiser, name, None), float)]
    if not given:
        return minimiser
    return eqx.tree_at(lambda m: [getattr(m, n) for n in given], minimiser, [getattr(minimiser, n) ** 2 for n in given])


def _round(rod, base, minimiser, max_steps, last):
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
    found: optx.Solution = optx.minimise(goal, minimiser, jnp.zeros(scaling.shape[1]), max_steps=max_steps, throw=False)
    return moved(found.value), found


def _scaling(rod, configuration, unit):
    """``P``, with the absolute values of negative curvatures."""
    d = derivatives(rod, configuration, predict=lambda n: n.at[:, :3].set(0.0))
    values, vectors = jnp.linalg.eigh(dense(d.diagonal, d.upper))
    size = jnp.maximum(jnp.abs(values), _SMALLEST * jnp.max(jnp.abs(values)))
    return vectors * jnp.sqrt(unit / size)


def dense(diagonal, upper):
    """Dense symmetric matrix of the block-tridiagonal one."""
    n = diagonal.shape[0]
    i = jnp.arange(n)
    H = jnp.zeros((n, 6, n, 6), diagonal.dtype).at[i, :, i, :].set(diagonal)
    H = H.at[i[:-1], :, i[1:], :].set(upper).at[i[1:], :, i[:-1], :].set(jnp.swapaxes(upper, 1, 2))
    return H.reshape(6 * n, 6 * n)
