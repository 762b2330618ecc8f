"""The discretised pose: one structure for every study and effect, whatever the parametrisation.

A *state* is the discrete rod of one pose with slots for its energy laws and outer fields, and the affine map by which the
scanner sees points. Parameters and effects on clamps, sections and loads only change arrays of the state. So one compiled
evaluation serves every choice of unknowns, and with slots for the laws of the whole catalogue (each null until it is used)
every kind of effect and every combination of kinds; what is compiled anew for a choice is only the cheap way from its
numbers to the state.

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

from scan2flex_jax.compilation import compiled
from scan2flex_jax.fitting.distance import (
    closest_residuals,
    hausdorff_residuals,
    integrated_residuals,
    marker_residuals,
    normal_residuals,
)
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.effect import AbstractEffect, overriding
from scan2flex_jax.rod.model import CableModel, Configuration, Rod, discretise
from scan2flex_jax.statics.solve import solve_rod
from scan2flex_jax.statics.verdict import Verdict

FEW, CHUNK = 6, 24  # tangents that one call pushes through: most fits need few, a refit a dozen, the catalogue some 250
DISTANCES: dict[str, Callable] = {
    "normal": normal_residuals,
    "closest": closest_residuals,
    "integrated": integrated_residuals,
    "hausdorff": hausdorff_residuals,
}
_ENERGY_HOOKS = ("strain_energy", "node_potential")


class State(eqx.Module):
    """A discretised pose: the rod, whose effects are the energy laws in slots, and the scanner's view."""

    rod: Rod
    view: Float[Array, "3 4"]


class Shape(NamedTuple):
    """One pose solved: residual (m, 3) in m, its derivatives (m, 3, K), arc lengths (m), configuration, verdict, and which
    points are markers (m,), None where the study has none."""

    residual: np.ndarray
    columns: np.ndarray | None
    s: np.ndarray
    configuration: Configuration
    verdict: Verdict
    marked: Float[Array | np.ndarray, " m"] | None = None


def slots_of(effects) -> tuple[AbstractEffect, ...]:
    """Those of the effects that bring an energy law or an outer field."""
    return tuple(e for e in effects if any(overriding((e,), hook) for hook in _ENERGY_HOOKS))


def state_of(model: CableModel, boundary: Boundary, elements: int, slots) -> State:
    """The state of a model in one pose; ``slots`` are the energy laws in the order that all states share."""
    rod = discretise(model, boundary, elements)

    def seen(points):
        for effect in model.effects:
            points = effect.observe(points)
        return points

    origin = seen(jnp.zeros((1, 3)))[0]
    view = jnp.concatenate([(seen(jnp.eye(3)) - origin).T, origin[:, None]], axis=1)
    return State(Rod(rod.section, rod.load, rod.boundary, slots), view)


class Target(NamedTuple):
    """What one pose is compared with: points (m, 3) in m, mask (m,), expected arc lengths (m,) in m.

    ``marked`` (m,) is 1 for points whose arc length is known: `marker_residuals` are theirs, whatever the distance of others.
    None: a study without markers, whose compiled functions know of none.
    """

    points: Float[Array | np.ndarray, "m 3"]
    mask: Float[Array | np.ndarray, " m"]
    expected: Float[Array | np.ndarray, " m"]
    marked: Float[Array | np.ndarray, " m"] | None = None


def shape(state: State, start: Configuration, target: Target, distance: str):
    """Residual (m, 3) of a pose solved from ``start``, then ``(arc lengths (m), configuration, verdict)``; traceable."""
    e = solve_rod(state.rod, start)
    curve = e.points, e.configuration.R[:, :, 2], state.rod.section.ds, target.points, target.expected

    def seen(points):
        return points @ state.view[:, :3].T + state.view[:, 3]

    r, s = DISTANCES[distance](*curve, seen)
    if target.marked is not None:
        r = jnp.where(target.marked[:, None] > 0, marker_residuals(*curve, seen), r)
        s = jnp.where(target.marked > 0, target.expected, s)
    return r * target.mask[:, None], (s, jax.lax.stop_gradient(e.configuration), e.verdict)


@compiled
def _evaluate(state, start, target, distance, tangents):
    if tangents is None:
        r, rest = shape(state, start, target, distance)
        return r, None, rest
    r, push, rest = jax.linearize(lambda x: shape(x, start, target, distance), state, has_aux=True)
    return r, jax.vmap(push)(tangents), rest


def evaluate(
    state: State, tangents: State | None, start: Configuration, target: Target, distance: str = "normal", width: int = CHUNK
) -> Shape:
    """The pose solved from ``start``, and the residual's derivative along ``tangents`` (leading axis, any number).

    ``width`` tangents are pushed at a time; what is compiled depends on it. Without ``tangents`` there are no columns, and
    what is compiled is another, smaller function.
    """
    if tangents is None:
        r, _, rest = _evaluate(state, start, target, distance, None)
        return _as_numpy(r, None, *rest)._replace(marked=target.marked)
    count, columns = len(jax.tree.leaves(tangents)[0]), []
    for first in range(0, max(count, 1), width):
        part = tangents if count == width else jax.tree.map(partial(_rows, first, width), tangents)
        r, d, (s, configuration, verdict) = _evaluate(state, start, target, distance, part)
        columns.append(np.asarray(d))
        start = jax.tree.map(np.asarray, configuration)
    d = np.moveaxis(np.concatenate(columns)[:count], 0, -1)
    return _as_numpy(r, d, s, start, verdict)._replace(marked=target.marked)


def no_tangents(state: State) -> State:
    """Tangents of the kind that `evaluate` asks for, none of them."""
    return jax.tree.map(lambda x: np.zeros((0, *x.shape)), eqx.filter(state, eqx.is_inexact_array))


def _as_numpy(residual, columns, s, configuration, verdict) -> Shape:
    return Shape(*jax.tree.map(np.asarray, (residual, columns, s, configuration, verdict)))


def _rows(first, width, x):
    """``width`` rows of ``x`` from ``first`` on, zeros where there are none."""
    x = np.asarray(x)[first : first + width]
    return np.concatenate([x, np.zeros((width - len(x), *x.shape[1:]))])
