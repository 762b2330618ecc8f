"""Bend-twist coupling: bending a section also twists it (a lay of wires, a braid under one-sided load).

The off-diagonal entries of K_Omega between bending about d1, d2 and twist are ``coupling sqrt(k_EI k_GJ)``;
``coupling`` (-) has two entries whose sum of squares must stay below 1. Null: 0.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.entry import CatalogueEntry, SameShapes
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.rod.effect import AbstractEffect, Section


class BendTwistCoupling(AbstractEffect):
    """Off-diagonal stiffness ``coupling`` (-) as fractions of ``sqrt(k_EI k_GJ)``."""

    kind: ClassVar[str] = "bend_twist_coupling"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "bending and twist are coupled"
    rank: ClassVar[int] = 1
    coupling: Float[Array, "2"] = parameter("-", 2)

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with the coupling."""
        K = section.stiffness
        both = self.coupling * jnp.sqrt(jnp.stack([K[:, 3, 3], K[:, 4, 4]], 1) * K[:, 5, 5, None])
        return eqx.tree_at(lambda x: x.stiffness, section, K.at[:, 3:5, 5].add(both).at[:, 5, 3:5].add(both))


ENTRY = CatalogueEntry(
    BendTwistCoupling, ("with d1", "with d2"),
    lambda c: np.full(2, 0.1),  # of sqrt(EI GJ): typical of the lay of a stranded core
    bounds_of=lambda c: (np.full(2, -0.7), np.full(2, 0.7)),
    other_starts=lambda a, site, c, places: [(-a, site, {})],  # the opposite sign has a minimum of its own
    signature="bending turns the cable out of its plane, the more the stronger it is bent",
    settle="scan one pose with both clamps rolled by 180 degrees, and one almost straight with a free end",
    same_shapes=(SameShapes("natural_curvature", "in fewer than four poses of like curvature"),),
)  # fmt: skip
