"""Empty slots of a state (`fitting.states`) for the whole catalogue, so that one compiled function serves every effect type."""

import jax
import jax.numpy as jnp
import numpy as np

from scan2flex_jax.effects.catalogue import catalogue
from scan2flex_jax.effects.entry import CatalogueEntry, Context
from scan2flex_jax.fitting.states import State, slots_of
from scan2flex_jax.rod.effect import AbstractEffect, Node, overriding
from scan2flex_jax.rod.energy import node_weights
from scan2flex_jax.rod.loads import DeadLoad
from scan2flex_jax.rod.model import Configuration


def empty_slots(context: Context, entries: tuple[CatalogueEntry, ...] = ()) -> dict[str, tuple[AbstractEffect, ...]]:
    """Effects at zero amplitude of each effect type of the catalogue, or of ``entries``, that needs slots, in the order of a
    dictionary's pytree leaves."""
    found = {}
    for entry in entries or catalogue():
        slots = slots_of(entry.build(jnp.zeros(len(entry.amplitudes)), entry.sites(context)[0], context))
        if slots:
            found[entry.kind] = slots
    return dict(sorted(found.items()))


def empty_slots_of(study) -> tuple[AbstractEffect, ...]:
    """The same for a study before its fit, in the order of a state; the scales of the cable are irrelevant."""
    nothing = Context(1.0, 1.0, 1.0, 1.0, np.asarray(study.gravity, float), (1.0, 2.0), clamped_ends=study.clamped_ends)
    return tuple(slot for slots in empty_slots(nothing).values() for slot in slots)


def load_of_fields(effects, state: State, configuration: Configuration) -> DeadLoad:
    """The dead load that outer fields of effects are at a configuration: of nodes and of their tangents d3."""
    rod = state.rod

    def energy(r, d3):
        R = configuration.R.at[:, :, 2].set(d3)

        def node(r, R, s, w):
            seen = Node(r, R, s, w, rod.section.ds, rod.boundary)
            return sum(field.node_potential(seen) for field in overriding(effects, "node_potential"))

        return jnp.sum(jax.vmap(node)(r, R, rod.node_s, node_weights(rod)))

    force, lever = jax.grad(energy, argnums=(0, 1))(configuration.r, configuration.R[:, :, 2])
    return DeadLoad(-force, -lever)
