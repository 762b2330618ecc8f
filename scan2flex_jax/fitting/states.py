"""The discretised pose, independent of the parametrisation: one structure for every study and effect.

A *state* is the discrete rod of one pose with slots for its energy laws and external fields, and the affine observation map of
the scanner. Parameters and effects on clamps, sections and loads only change arrays of the state. One compiled evaluation
therefore serves every choice of unknowns, and with slots for the laws of the whole catalogue (each null until it is used)
every combination of effect types; only the cheap map from parameters to the state is compiled for each choice.

Symbols: ``view`` (3, 4) = [A | b], points are seen at ``A p + b``; ``tangents`` are directions in the space of states, and
the residual's derivative along each is that of the equilibrium by the implicit function theorem: one back-substitution.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.compilation import compiled, lightly_compiled
from scan2flex_jax.fitting.distance import (
    closest_residuals,
    hausdorff_residuals,
    held_axes,
    integrated_residuals,
    marker_residuals,
    normal_residuals,
)
from scan2flex_jax.fitting.readings import AT_END, POINT, Readings, change, reading_residuals, rotation_at, wrenches
from scan2flex_jax.geometry.small import matvec
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.effect import AbstractEffect, overriding
from scan2flex_jax.rod.memory import Left, memories, remembering
from scan2flex_jax.rod.model import CableModel, Configuration, Rod, discretise
from scan2flex_jax.statics.newton import MAX_STEPS
from scan2flex_jax.statics.solve import Equilibrium, solve_rod
from scan2flex_jax.statics.verdict import SOLVED, Verdict

WIDTH = 24  # tangents per call: as fast as six; most fits need two, a refit a dozen
NEAR = 60  # steps of a solve from a neighbouring shape: of 16,000 that settled in three searches, all but 30 took fewer
DISTANCES: dict[str, Callable] = {
    "normal": normal_residuals,
    "closest": closest_residuals,
    "integrated": integrated_residuals,
    "hausdorff": hausdorff_residuals,
}
_ENERGY_HOOKS = ("strain_energy", "node_potential", "element_potential")


class State(eqx.Module):
    """A discretised pose: the rod, whose effects are the energy laws in slots, and the observation map."""

    rod: Rod
    view: Float[Array, "3 4"]


class Shape(NamedTuple):
    """One solved pose: residual (m, 3) in m, its derivatives (m, 3, K), arc lengths (m), configuration, status, the axes
    (m, 3, 3) of the residual (rows), and the mask of markers (m,), None if the study has none.

    With memory also the state that the pose ``entered`` with, the one that it ``left``, and the derivatives ``leaving`` of the
    latter (leading axis K)."""

    residual: np.ndarray
    columns: np.ndarray | None
    s: np.ndarray
    configuration: Configuration
    verdict: Verdict
    axes: np.ndarray
    marked: Float[Array | np.ndarray, " m"] | None = None
    left: Left = ()
    leaving: Left = ()
    entered: Left = ()


def slots_of(effects) -> tuple[AbstractEffect, ...]:
    """The effects that have an energy law or an external field."""
    return tuple(e for e in effects if any(overriding((e,), hook) for hook in _ENERGY_HOOKS))


def without_history(state: State) -> Left:
    """The state of a straightened cable, for each effect with memory."""
    return tuple(np.asarray(m.without_history(state.rod.elements)) for m in memories(state.rod.effects))


def at_first(state: State, tangents: State | None) -> tuple[Left, Left]:
    """The state before the first pose, for each effect with memory, and its derivatives along ``tangents`` (None: none)."""
    of, along = memories(state.rod.effects), () if tangents is None else memories(tangents.rod.effects)
    return jax.tree.map(np.asarray, _at_first(of, along, state.rod.elements))


@lightly_compiled
def _at_first(of, along, elements):
    def begun(of):
        return tuple(m.at_first(elements) for m in of)

    return begun(of), jax.vmap(lambda t: jax.jvp(begun, (of,), (t,))[1])(along) if along else ()


def after(state: State, left: Left) -> State:
    """The state (or its tangents) with what the pose before ``left``; unchanged without memory."""
    if not left:
        return state
    return eqx.tree_at(lambda s: s.rod.effects, state, remembering(state.rod.effects, left))


def state_of(model: CableModel, boundary: Boundary, elements: int, slots) -> State:
    """The state of a model in one pose; ``slots`` are the energy laws, in an order common to all states."""
    rod = discretise(model, boundary, elements)
    if slots and rod.section.growth is None:  # as in a search, where the stiffness may vary
        rod = eqx.tree_at(lambda r: r.section.growth, rod, jnp.zeros(elements), is_leaf=lambda x: x is None)

    def seen(points):
        for effect in model.effects:
            points = effect.observe(points)
        return points

    origin = seen(jnp.zeros((1, 3)))[0]
    view = jnp.concatenate([(seen(jnp.eye(3)) - origin).T, origin[:, None]], axis=1)
    return State(Rod(rod.section, rod.load, rod.boundary, slots), view)


class Target(NamedTuple):
    """The measured points of one pose: points (m, 3) in m, mask (m,), expected arc lengths (m,) in m.

    ``marked`` (m,) is 1 for points whose arc length is known, and `AT_END` for those at the end of the cable, whatever its
    length: these have `marker_residuals` whatever the distance of others. None: a study without markers, whose compiled
    functions omit them. ``rows``: see `poses.Poses`. ``readings``: what each row is; None where all are points of the curve.
    """

    points: Float[Array | np.ndarray, "m 3"]
    mask: Float[Array | np.ndarray, " m"]
    expected: Float[Array | np.ndarray, " m"]
    marked: Float[Array | np.ndarray, " m"] | None = None
    rows: Float[Array | np.ndarray, "3 3"] | None = None
    readings: Readings | None = None


def shape(state: State, start: Configuration, target: Target, distance: str, most=None):
    """Residual (m, 3) of a pose solved from ``start``, then ``(arc lengths (m), configuration, verdict, axes)``; traceable."""
    r, s, axes, e = _solved(state, start, target, distance, most)
    return r, (s, jax.lax.stop_gradient(e.configuration), e.verdict, axes)


def shape_and_left(state: State, start: Configuration, target: Target, distance: str, held: Float[Array, ""], most=None):
    """`shape` with the residual followed by the state that the pose leaves after it was ``held`` (s)."""
    r, s, axes, e = _solved(state, start, target, distance, most)
    return (r, e.leaves(held)), (s, jax.lax.stop_gradient(e.configuration), e.verdict, axes)


def _solved(state, start, target, distance, most) -> tuple[Array, Array, Array, Equilibrium]:
    """Residual, arc lengths, axes, and the equilibrium."""
    e = solve_rod(state.rod, start, max_steps=most)
    curve = e.points, e.configuration.R[:, :, 2], state.rod.section.ds, target.points, target.expected

    def seen(points):
        return points @ state.view[:, :3].T + state.view[:, 3]

    axes_at = held_axes(*curve[:3], seen)
    r, s = DISTANCES[distance](*curve, seen, axes_at)
    if target.marked is not None:
        at = jnp.where(target.marked == AT_END, state.rod.length, target.expected)
        if (known := target.readings) is None:
            marks = marker_residuals(*curve[:4], at, seen, axes_at, target.rows)
        else:
            R = jax.vmap(lambda s: rotation_at(e.configuration.R, state.rod.section.ds, s))(at)
            marks = marker_residuals(*curve[:4], at, seen, axes_at, target.rows, matvec(R, jnp.asarray(known.aside)))
            others = reading_residuals(known, target.points, R, state.view[:, :3], wrenches(state.rod, e.configuration))
            marks = jnp.where(known.kind[:, None] == POINT, marks, others)
        r = jnp.where(target.marked[:, None] > 0, marks, r)
        s = jnp.where(target.marked > 0, at, s)
    axes = jax.vmap(axes_at)(jax.lax.stop_gradient(s))
    if target.readings is not None:
        axes = jnp.where(target.readings.kind[:, None, None] == POINT, axes, jnp.eye(3))
    return r * target.mask[:, None], s, axes, e


def compared(found: Shape, reference: Shape, target: Target) -> Shape:
    """The shape of a pose whose readings are changes from a ``reference``, which was evaluated for values of zero."""
    residual = change(found.residual, reference.residual, target.readings, np)
    columns = None if found.columns is None or reference.columns is None else found.columns - reference.columns
    failed = found if int(found.verdict.code) != SOLVED else reference
    return found._replace(residual=residual, columns=columns, verdict=failed.verdict)


@compiled
def _evaluate(state, start, target, distance, most, tangents, held=None):
    """Residual and state left, their derivatives along ``tangents``, and the rest."""

    def solve(x):
        if held is not None:
            return shape_and_left(x, start, target, distance, held, most)
        r, rest = shape(x, start, target, distance, most)
        return (r, ()), rest

    if tangents is None:
        found, rest = solve(state)
        return found, None, rest
    found, push, rest = jax.linearize(solve, state, has_aux=True)
    return found, jax.vmap(lambda t: push(t))(tangents), rest  # noqa: PLW0108 - `vmap` prints the jaxpr of a bare `push`


def evaluate(
    state: State,
    tangents: State | None,
    start: Configuration,
    target: Target,
    distance: str = "normal",
    held: np.ndarray | None = None,
    near: bool = False,
) -> Shape:
    """The pose solved from ``start``, and the residual's derivative along ``tangents`` (leading axis, any number).

    `WIDTH` tangents are evaluated per call. Without ``tangents`` there are no columns, and a smaller function is compiled.
    ``held``: how long (s) the pose is held, for the state that it leaves; None: no memory. ``near``: the start is a
    neighbouring shape; a solve that takes long from there leads elsewhere, and is given up.
    """
    most = np.array(NEAR if near else MAX_STEPS)
    if tangents is None:
        (r, left), _, rest = _evaluate(state, start, target, distance, most, None, held)
        return _as_numpy(r, None, *rest)._replace(marked=target.marked, left=left)
    count, columns = len(jax.tree.leaves(tangents)[0]), []
    for first in range(0, max(count, 1), WIDTH):
        part = tangents if count == WIDTH else jax.tree.map(partial(_rows, first), tangents)
        (r, left), moved, (s, configuration, verdict, axes) = _evaluate(state, start, target, distance, most, part, held)
        columns.append(jax.tree.map(np.asarray, moved))
        start = jax.tree.map(np.asarray, configuration)
    d, leaving = jax.tree.map(lambda *x: np.concatenate(x)[:count], *columns)
    d = np.moveaxis(d, 0, -1)
    return _as_numpy(r, d, s, start, verdict, axes)._replace(marked=target.marked, left=left, leaving=leaving)


def still(state: State, count: int) -> State:
    """So many zero tangents of a state, to be filled in."""
    return jax.tree.map(lambda x: np.zeros((count, *np.shape(x))), eqx.filter(state, eqx.is_inexact_array))


def _as_numpy(residual, columns, s, configuration, verdict, axes) -> Shape:
    return Shape(*jax.tree.map(np.asarray, (residual, columns, s, configuration, verdict, axes)))


def _rows(first, x):
    """`WIDTH` rows of ``x`` from ``first`` on, padded with zeros."""
    x = np.asarray(x)[first : first + WIDTH]
    return np.concatenate([x, np.zeros((WIDTH - len(x), *x.shape[1:]))])
