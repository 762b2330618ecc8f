"""Tension-twist coupling: tension unwinds the cable (a rope, a cable of one lay).

At twist tau and tension N the torque is ``GJ tau + lever N``, and so the cable shortens by ``lever tau`` per length:
the energy is ``1/2 EA (epsilon + lever tau)^2 + 1/2 GJ tau^2``, with ``K[2, 5] = lever EA``. GJ is the torsional
stiffness of a cable free to change its length, so the energy is positive at every axial stiffness. ``lever`` in m, about
a tenth of the diameter for ropes. Null: 0.
"""

from typing import ClassVar

import equinox as eqx
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.entry import CatalogueEntry, SameShapes
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.rod.effect import AbstractEffect, Section


class TensionTwistCoupling(AbstractEffect):
    """Torque per tension ``lever`` (m)."""

    kind: ClassVar[str] = "tension_twist_coupling"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "tension twists the cable"
    rank: ClassVar[int] = 2
    lever: Float[Array, ""] = parameter("m")

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with the coupling."""
        K = section.stiffness
        c = self.lever * K[:, 2, 2]
        K = K.at[:, 2, 5].add(c).at[:, 5, 2].add(c).at[:, 5, 5].add(self.lever * c)
        return eqx.tree_at(lambda x: x.stiffness, section, K)


ENTRY = CatalogueEntry(
    TensionTwistCoupling, ("lever",),
    lambda c: np.array([0.1 * c.radius_or_guess]),  # a tenth of the radius: a cable of one lay, half a rope
    signature="tight poses are twisted, slack ones are not",
    settle="hang the cable with a weight at its free end and watch the end turn",
    same_shapes=(SameShapes("clamp_rotation", "when the tension is alike in all poses, for a roll"),),
)  # fmt: skip
