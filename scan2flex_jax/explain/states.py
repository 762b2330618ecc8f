"""One structure for every effect: what an effect does to the rod, apart from how the rod is solved.

A *state* is the discrete rod of one pose with slots for all energy laws and outer fields of the catalogue (each null until
it is used), and the affine map by which the scanner sees points. Effects on clamps, sections and loads only change arrays
of the state. So one compiled evaluation serves the base model, every kind of the catalogue and every combination of kinds;
what is compiled anew for a kind is only the cheap way from its numbers to the state.

Symbols: ``view`` (3, 4) = [A | b], points are seen at ``A p + b``; ``tangents`` are directions in the space of states, and
the residual's derivative along each is that of the equilibrium by the implicit function theorem: one back-substitution.
"""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.compilation import compiled
from scan2flex_jax.effects.catalogue import catalogue
from scan2flex_jax.equilibrium.solve import Verdict, equilibrium
from scan2flex_jax.fit.distance import normal_residuals
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.effect import AbstractEffect, Node, Section, overriding
from scan2flex_jax.rod.energy import node_weights
from scan2flex_jax.rod.loads import DeadLoad
from scan2flex_jax.rod.model import CableModel, Configuration, Rod, discretise

CHUNK = 24  # tangents that one call pushes through: a refit needs about a dozen, the catalogue some 250
_ENERGY_HOOKS = ("strain_energy", "node_potential")


class State(eqx.Module):
    """What the balance of one pose depends on: sections, loads, supports, energy laws in slots, and the scanner's view."""

    section: Section
    load: DeadLoad
    boundary: Boundary
    slots: tuple[AbstractEffect, ...]
    view: Float[Array, "3 4"]


class Given(AbstractEffect):
    """Sections, loads and supports that are already worked out, in place of those of a cable."""

    sections: Section
    load: DeadLoad
    boundary: Boundary

    def clamps(self, boundary: Boundary) -> Boundary:
        """The supports."""
        return self.boundary

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """The sections."""
        return self.sections

    def dead_load(self, section: Section, gravity: Float[Array, "3"]) -> DeadLoad:
        """The loads."""
        return self.load


class Shape(NamedTuple):
    """One pose solved: residual (m, 3) in m, its derivatives (m, 3, K), arc lengths (m), configuration, verdict."""

    residual: np.ndarray
    columns: np.ndarray
    s: np.ndarray
    configuration: Configuration
    verdict: Verdict


def slots_of(effects) -> tuple[AbstractEffect, ...]:
    """Those of the effects that bring an energy law or an outer field."""
    return tuple(e for e in effects if any(overriding((e,), hook) for hook in _ENERGY_HOOKS))


def empty_slots(context) -> dict[str, tuple[AbstractEffect, ...]]:
    """Per kind of the catalogue that needs slots: its effects at zero amplitude."""
    found = {}
    for entry in catalogue():
        slots = slots_of(entry.build(jnp.zeros(len(entry.amplitudes)), entry.sites(context)[0], context))
        if slots:
            found[entry.kind] = slots
    return found


def state_of(model: CableModel, boundary: Boundary, elements: int, slots) -> State:
    """The state of a model in one pose; ``slots`` are the energy laws in the order that all states share."""
    rod = discretise(model, boundary, elements)

    def seen(points):
        for effect in model.effects:
            points = effect.observe(points)
        return points

    origin = seen(jnp.zeros((1, 3)))[0]
    view = jnp.concatenate([(seen(jnp.eye(3)) - origin).T, origin[:, None]], axis=1)
    return State(rod.section, rod.load, rod.boundary, slots, view)


def load_of_fields(effects, state: State, configuration: Configuration) -> DeadLoad:
    """The dead load that outer fields of effects are at a configuration: of nodes and of their tangents d3."""
    rod = Rod(state.section, state.load, state.boundary, ())

    def energy(r, d3):
        R = configuration.R.at[:, :, 2].set(d3)
        def node(r, R, s, w):
            seen = Node(r, R, s, w, rod.section.ds, rod.boundary)
            return sum(field.node_potential(seen) for field in overriding(effects, "node_potential"))

        return jnp.sum(jax.vmap(node)(r, R, rod.node_s, node_weights(rod)))

    force, lever = jax.grad(energy, argnums=(0, 1))(configuration.r, configuration.R[:, :, 2])
    return DeadLoad(-force, -lever)


def _shape(state, start, points, mask, expected):
    section = state.section
    n = section.s.shape[0]
    one = jnp.ones(())
    cable = Cable(section.ds * n, one, one, one)
    model = CableModel(cable, jnp.zeros(3), (Given(section, state.load, state.boundary), *state.slots))
    e = equilibrium(model, state.boundary, start=start, elements=n)
    view = state.view
    r, s = normal_residuals(
        e.points, e.configuration.R[:, :, 2], section.ds, points, expected, lambda p: p @ view[:, :3].T + view[:, 3]
    )
    return r * mask[:, None], (s, jax.lax.stop_gradient(e.configuration), e.verdict)


@compiled
def _evaluate(state, start, points, mask, expected, tangents):
    r, push, rest = jax.linearize(lambda x: _shape(x, start, points, mask, expected), state, has_aux=True)
    return r, jax.vmap(push)(tangents), rest


def evaluate(state: State, tangents: State | None, start: Configuration, points, mask, expected) -> Shape:
    """The pose solved from ``start``, and the residual's derivative along ``tangents`` (leading axis, any number)."""
    arrays = eqx.filter(state, eqx.is_inexact_array)
    zero = jax.tree.map(lambda x: np.zeros((CHUNK, *x.shape)), arrays)
    tangents = zero if tangents is None else tangents
    count = len(jax.tree.leaves(tangents)[0])
    columns = []
    for first in range(0, count, CHUNK):
        part = jax.tree.map(partial(_part, first), tangents, zero)
        r, d, (s, configuration, verdict) = _evaluate(state, start, points, mask, expected, part)
        columns.append(np.asarray(d))
        start = jax.tree.map(np.asarray, configuration)
    d = np.moveaxis(np.concatenate(columns)[:count], 0, -1)
    return Shape(np.asarray(r), d, np.asarray(s), start, jax.tree.map(np.asarray, verdict))


def _part(first, x, zero):
    """``CHUNK`` rows of ``x`` from ``first`` on, zeros where there are none."""
    x = np.asarray(x)[first : first + CHUNK]
    if len(x) == len(zero):
        return x
    full = zero.copy()
    full[: len(x)] = x
    return full
