"""Derivatives of an equilibrium of any order, by the implicit function theorem.

With the balance ``F(p, c) = 0`` of the free motions f (`rod.assembly.node_forces`), whose derivative by body twists of the
nodes is the Hessian ``H`` at an equilibrium, a change ``dp`` of any array of the rod moves the nodes by the twists ``x`` of

    H_ff x_f + H_fh x_h = -F_p dp,   x_h = twist of the supports,

with the held motions h of the two ends.
The rule is written in functions of the rod and of the solution, so it can be differentiated again, to any order (`jax.hessian`,
`jax.jvp` of `jax.grad`, ...): H is a known function of both. First derivatives need no new matrix: each is one
back-substitution with the factors of the solver's last Hessian, and the derivative of H is traced for higher orders only (a
`custom_linear_solve` traces its matrix three times, a quarter of the wait for a first fit). Griewank and Walther, "Evaluating
Derivatives" (2008), chapter 15.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from scan2flex_jax.compilation import compiled
from scan2flex_jax.geometry import lie
from scan2flex_jax.geometry.small import matmul, matvec
from scan2flex_jax.rod.assembly import derivatives, free_motions, node_forces
from scan2flex_jax.rod.model import Configuration
from scan2flex_jax.statics import blocktridiagonal as bt
from scan2flex_jax.statics.solver import Settled
from scan2flex_jax.statics.starts import default_start


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
    change = jax.tree.map(_or_zeros, parameters, tangents[0], is_leaf=_is_none)
    still = jax.tree.map(jnp.zeros_like, eqx.filter(found, eqx.is_inexact_array))
    moved = _displacement(rod, change, found.configuration, found.derivatives)
    return found, eqx.tree_at(lambda t: t.configuration, still, moved)


def _is_none(leaf):
    return leaf is None


def _or_zeros(parameter, tangent):
    """Tangent of one leaf of the parameters (None: no parameter)."""
    return None if parameter is None else jnp.zeros_like(parameter) if tangent is None else tangent


@compiled
def _settle(rod, start, turns, down, solver, max_steps):
    if start is None:
        start = default_start(rod, down, turns)
    return solver.settle(rod, start, max_steps)


@compiled
def _displacement(rod, change, configuration, found):
    """Tangent of the configuration under a change of the rod's parameters."""
    parameters, fixed = eqx.partition(rod, eqx.is_inexact_array)
    free, known = free_motions(rod), _known(rod, configuration, found)

    def forces(parameters):
        return free * node_forces(eqx.combine(parameters, fixed), configuration)

    held = (1.0 - free) * _twist_of_supports(configuration, change.boundary)
    (first, after), (last, before) = known.ends
    force = jax.jvp(forces, (parameters,), (change,))[1]
    force = force.at[0].add(first @ held[0]).at[1].add(after.T @ held[0])
    force = force.at[-1].add(last @ held[-1]).at[-2].add(before @ held[-1])
    twist = held - bt.solve(bt.factor(known.diagonal, known.upper), free * force)
    return _moved(rod, configuration, twist, change.boundary)


@eqx.filter_custom_jvp
def _known(rod, configuration, found):
    """The solver's last derivatives at a solution, as the function of rod and configuration that they are."""
    return found


@_known.def_jvp
def _known_jvp(primals, tangents):
    rod, configuration, _ = primals
    parameters, fixed = eqx.partition(rod, eqx.is_inexact_array)
    pairs = zip((parameters, configuration), tangents[:2], strict=True)
    moved = tuple(jax.tree.map(_or_zeros, *pair, is_leaf=_is_none) for pair in pairs)
    return _known(*primals), jax.jvp(lambda p, c: derivatives(eqx.combine(p, fixed), c), (parameters, configuration), moved)[1]


def _twist_of_supports(configuration, change):
    """Body twists of the nodes when the supports change: zero except at the two ends."""
    r, R = configuration
    twist = jnp.zeros((len(r), 6))
    for end, node in ((0, 0), (1, -1)):
        turn = lie.unhat(R[node].T @ change.rotation[end])
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
