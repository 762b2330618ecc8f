"""Effects with memory: the energy of a pose depends on a state that the poses before it left in the cable.

Each pose is a minimum of the energy given that state (incremental variational principle): the energy of an element is one
function of its strain and of the state ``left`` by the pose before, and the state that the pose leaves follows from its strain.
Everything is a pure function, so derivatives chain through the order of the poses.
References: Ortiz and Stainier, "The variational formulation of viscoplastic constitutive updates" (1999); Miehe, "Strain-driven
homogenization of inelastic microstructures and composites based on an incremental variational formulation" (2002).
"""

import abc
from collections.abc import Sequence
from typing import ClassVar

import equinox as eqx
import jax
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.rod.effect import AbstractEffect

Left = tuple[Float[Array | np.ndarray, "..."], ...]
"""The state of every effect with memory of a rod: one array (n, ...) per effect, one row per element."""


class AbstractMemory(AbstractEffect):
    """Base of effects with memory.

    ``left`` is the state of every element before the pose, data of the pose that `remembering` inserts; None is the state
    before the first pose, that of a cable without history unless the cable came with a set (`at_first`).
    ``needs`` is what the poses have to tell: their "order", or the "time" of each.
    """

    needs: ClassVar[str] = "order"
    left: Float[Array | np.ndarray, "n ..."] | None = eqx.field(default=None, kw_only=True)

    @abc.abstractmethod
    def without_history(self, elements: int) -> Float[Array, "n ..."]:
        """State of a new cable, or of one that was taken out and straightened."""

    def at_first(self, elements: int) -> Float[Array, "n ..."]:
        """State before the first pose: none, unless the cable came with a set."""
        return self.without_history(elements)

    @abc.abstractmethod
    def energy_given(
        self, strain: Float[Array, "6"], stiffness: Float[Array, "6 6"], left: Float[Array, "..."]
    ) -> Float[Array, ""]:
        """Energy per length (J/m) added to the quadratic one, as `strain_energy`, given the state of the element."""

    def strain_energy(self, strain: Float[Array, "6"], stiffness: Float[Array, "6 6"]) -> Float[Array, ""]:
        """The energy of a cable without history."""
        return self.energy_given(strain, stiffness, self.without_history(1)[0])

    @abc.abstractmethod
    def leaves(
        self, strain: Float[Array, "6"], stiffness: Float[Array, "6 6"], left: Float[Array, "..."], held: Float[Array, ""]
    ) -> Float[Array, "..."]:
        """State that a pose of this excess strain leaves after it was held for ``held`` (s)."""

    @classmethod
    def begin(cls, curvature: float, length: float, seconds: float) -> tuple[dict[str, float], ...]:
        """Values of the parameters to begin a fit from, where nobody knows better: for poses of this RMS ``curvature`` (1/m) of
        a cable of this ``length`` (m), measured within so many ``seconds``."""
        return ()

    def before(self, elements: int) -> Float[Array | np.ndarray, "n ..."]:
        """State of every element before the pose."""
        return self.at_first(elements) if self.left is None else self.left


def memories(effects: Sequence[AbstractEffect]) -> tuple[AbstractMemory, ...]:
    """The effects with memory, in their order."""
    return tuple(e for e in effects if isinstance(e, AbstractMemory))


def remembering(effects: Sequence[AbstractEffect], left: Left | None) -> tuple[AbstractEffect, ...]:
    """The effects with the states ``left`` by the pose before; None: the state before the first pose."""
    states = iter(left) if left is not None else None
    return tuple(_with_state(e, states) if isinstance(e, AbstractMemory) else e for e in effects)


def straightened(effects: Sequence[AbstractEffect], elements: int) -> tuple[AbstractEffect, ...]:
    """The effects of a cable of so many ``elements`` that was taken out and straightened."""
    return remembering(effects, tuple(m.without_history(elements) for m in memories(effects)))


def _with_state(effect, states):
    state = None if states is None else next(states)
    return eqx.tree_at(lambda e: e.left, effect, state, is_leaf=lambda x: x is None)


def left_by(rod, excess: Float[Array, "n 6"], held: Float[Array, ""] | float = 0.0) -> Left:
    """States that a pose of these excess strains leaves after it was held for ``held`` (s)."""
    K, n = rod.section.stiffness, rod.elements
    return tuple(
        jax.vmap(lambda e, k, q, m=m: m.leaves(e, k, q, held))(excess, K, m.before(n)) for m in memories(rod.effects)
    )
