"""Memory: the cable keeps part of the curvature of the previous pose (plastic or slowly relaxing).

Natural curvature ``memory * previous``: ``previous`` (1/m, about d1, d2, d3) is the curvature in the previous pose at
points evenly spaced from s = 0 to L. It is data of the pose, supplied by the caller (`jnp.zeros((m, 3))` in the
first pose), so a study cannot declare this effect type. Null: memory 0.

It is the `relaxation` that is complete between poses, and knows the pose before only; `friction` knows all turning points.
Where it is found, `explain` also tests these over the order of poses, and says what each leaves.
"""

from typing import ClassVar

import equinox as eqx
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.entry import CatalogueEntry, Context
from scan2flex_jax.effects.format import leaf, rows
from scan2flex_jax.effects.spans import hat_field
from scan2flex_jax.rod.effect import AbstractEffect, Section


class MemorySet(AbstractEffect):
    """Natural curvature ``memory`` (-) times the curvature ``previous`` (1/m) of the previous pose."""

    kind: ClassVar[str] = "memory_set"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "the cable keeps part of the curvature of the pose before"
    memory: Float[Array, ""] = leaf()
    previous: Float[Array, "m 3"] = rows(3)

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with the remembered curvature."""
        kept = self.memory * hat_field(section, self.previous, length)
        return eqx.tree_at(lambda x: x.natural, section, section.natural.at[:, 3:].add(kept))

    def reported(self, context: Context | None) -> dict[str, Array]:
        """What is reported of it; ``previous`` is data."""
        return {"memory": self.memory}


ENTRY = CatalogueEntry(
    MemorySet, ("memory",),
    lambda c: np.array([0.15]),  # plastics keep ten to twenty per cent over minutes
    build=lambda a, site, c: (MemorySet(a[0], c.previous),),
    one_sided=(True,), bounds_of=lambda c: (np.zeros(1), np.ones(1)),
    signature="each pose leans towards the shape of the pose before it",
    settle="repeat the first pose at the end, and take the poses in another order",
)  # fmt: skip
