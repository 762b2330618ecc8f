"""Derivatives of an equilibrium of any order, by the implicit function theorem.

With the balance ``F(p, c) = 0`` of the free motions f (`rod.assembly.node_forces`), whose derivative by body twists of the
nodes is the Hessian ``H`` at an equilibrium, a change ``dp`` of any array of the rod moves the nodes by the twists ``x`` of

    H_ff x_f + H_fh x_h = -F_p dp,   x_h = twist of the supports,

with the held motions h of the two ends.
The rule is written in functions of the rod and of the solution, so it can be differentiated again: ``x = H^-1 b`` solves a
linear system whose matrix is a known function of both, so ``dx = H^-1 (db - dH x)``, which gives derivatives of any
order (`jax.hessian`, `jax.jvp` of `jax.grad`, ...). First derivatives need no new matrix: each is one back-substitution
with the factors of the solver's last Hessian. Griewank and Walther, "Evaluating Derivatives" (2008), chapter 15.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from scan2flex_jax.compilation import compiled
from scan2flex_jax.geometry import lie
from scan2flex_jax.geometry.small import matmul, matvec
from scan2flex_jax.rod.assembly import free_motions, node_forces
from scan2flex_jax.rod.energy import retract
from scan2flex_jax.rod.model import Configuration
from scan2flex_jax.statics import blocktridiagonal as bt
from scan2flex_jax.statics.solver import Settled
from scan2flex_jax.statics.starts import sagging_start


@eqx.filter_custom_jvp
def settled(rod, start, turns, down, solver, max_steps) -> Settled:
    """Solution of ``solver`` from ``start``; without one, from a sag along ``down`` with ``turns`` turns.

    The configuration is differentiable with respect to ``rod``; the other fields have no derivative.
    """
    return _settle(rod, start, turns, down, solver, max_steps)


@settled.def_jvp
def _settled_jvp(primals, tangents):
    rod, *rest = primals
    found = settled(rod, *rest)  # differentiable itself, for derivatives of higher order
    parameters = eqx.filter(rod, eqx.is_inexact_array)
    change = jax.tree.map(_or_zeros, parameters, tangents[0], is_leaf=lambda x: x is None)
    still = jax.tree.map(jnp.zeros_like, eqx.filter(found, eqx.is_inexact_array))
    moved = _displacement(rod, change, found.configuration, found.derivatives)
    return found, eqx.tree_at(lambda t: t.configuration, still, moved)


def _or_zeros(parameter, tangent):
    """Tangent of one leaf of the parameters (None: no parameter)."""
    return None if parameter is None else jnp.zeros_like(parameter) if tangent is None else tangent


@compiled
def _settle(rod, start, turns, down, solver, max_steps):
    if start is None:
        start = sagging_start(rod.boundary, rod.length, down, turns, rod.elements)
    return solver.settle(rod, start, max_steps)


@compiled
def _displacement(rod, change, configuration, derivatives):
    """Tangent of the configuration under a change of the rod's parameters."""
    parameters, fixed = eqx.partition(rod, eqx.is_inexact_array)
    free, still = free_motions(rod), jnp.zeros((rod.elements + 1, 6))

    def forces(parameters):
        return free * node_forces(eqx.combine(parameters, fixed), configuration)

    def stiffness(twist):  # balance of the free motions; held ones unchanged
        moved = jax.jvp(lambda t: free * node_forces(rod, retract(configuration, t)), (still,), (twist,))[1]
        return moved + (1.0 - free) * twist

    given = (1.0 - free) * _twist_of_supports(configuration, change.boundary) - jax.jvp(forces, (parameters,), (change,))[1]
    inverse = _Inverse(bt.factor(derivatives.diagonal, derivatives.upper), derivatives.ends, free)
    twist = jax.lax.custom_linear_solve(
        stiffness, given, lambda _, b: inverse.times(b), lambda _, b: inverse.transposed_times(b)
    )
    return _moved(rod, configuration, twist, change.boundary)


class _Inverse(eqx.Module):
    """Inverse of ``[[H_ff, H_fh], [0, 1]]``, the Hessian's rows of free motions f above held ones h that are given."""

    factors: bt.Factors
    ends: Float[Array, "2 2 6 6"]
    free: Float[Array, "nodes 6"]

    def times(self, b):
        """Free motions in balance with the given forces and held motions."""
        held = (1.0 - self.free) * b
        (first, after), (last, before) = self.ends
        force = jnp.zeros_like(b).at[0].add(first @ held[0]).at[1].add(after.T @ held[0])
        force = force.at[-1].add(last @ held[-1]).at[-2].add(before @ held[-1])
        return bt.solve(self.factors, self.free * (b - force)) + held

    def transposed_times(self, b):
        """The adjoint of `times`."""
        x = bt.solve(self.factors, self.free * b)
        (first, after), (last, before) = self.ends
        reaction = jnp.zeros_like(b).at[0].add(first @ x[0] + after @ x[1]).at[-1].add(last @ x[-1] + before.T @ x[-2])
        return self.free * x + (1.0 - self.free) * (b - reaction)


def _twist_of_supports(configuration, change):
    """Body twists of the nodes when the supports change: zero except at the two ends."""
    r, R = configuration
    twist = jnp.zeros((len(r), 6))
    for end, node in ((0, 0), (1, -1)):
        W = R[node].T @ change.rotation[end]
        turn = 0.5 * jnp.stack([W[2, 1] - W[1, 2], W[0, 2] - W[2, 0], W[1, 0] - W[0, 1]])
        twist = twist.at[node].set(jnp.concatenate([R[node].T @ change.position[end], turn]))
    return twist


def _moved(rod, configuration, twist, change):
    """Tangent of the configuration under body twists; held ends follow their supports exactly."""
    dr = matvec(configuration.R, twist[:, :3])
    dR = matmul(configuration.R, jax.vmap(lie.hat)(twist[:, 3:]))
    for end, node in ((0, 0), (1, -1)):
        place, turn = rod.boundary.held[end, 0] > 0, rod.boundary.held[end, 3] > 0
        dr = dr.at[node].set(jnp.where(place, change.position[end], dr[node]))
        dR = dR.at[node].set(jnp.where(turn, change.rotation[end], dR[node]))
    return Configuration(dr, dR)
