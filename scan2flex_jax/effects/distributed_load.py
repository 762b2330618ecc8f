"""Distributed load: a dead load that varies along s.

``force`` (N/m, scan frame) at places ``s`` (m), smooth between them; without ``s``, at points evenly spaced from s = 0 to L
and linear between them. Null: 0.
"""

from typing import ClassVar

import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.builders import along
from scan2flex_jax.effects.entry import CatalogueEntry, SameShapes
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.effects.spans import field_along
from scan2flex_jax.geometry.fields import POINTS
from scan2flex_jax.rod.effect import AbstractEffect, Section
from scan2flex_jax.rod.loads import DeadLoad, distributed_load


class DistributedLoad(AbstractEffect):
    """Dead load ``force`` (N/m) at places ``s`` (m) along the cable."""

    kind: ClassVar[str] = "distributed_load"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "a dead load that varies along the cable"
    s: Float[Array, " m"] | None = parameter("m", per_point=True, domain="along_cable", estimable=False, default=None)
    force: Float[Array, "m 3"] = parameter("N/m", 3, per_point=True)

    def dead_load(self, section: Section, gravity: Float[Array, "3"]) -> DeadLoad:
        """The load on all elements."""
        length = section.ds * section.s.shape[0]
        return distributed_load(section, field_along(section, self.force, self.s, length))


ENTRY = CatalogueEntry(
    DistributedLoad,
    size=lambda c: np.full(3 * POINTS, 0.3 * c.force / c.length),  # as for a homogeneous load
    **along("force", DistributedLoad),
    signature="the cable is pulled the same way in every pose, more at some places than at others",
    settle="turn the rig, so that gravity comes from another side of the cable",
    same_shapes=(SameShapes("uniform_load", "when it is alike all along"),),
)  # fmt: skip
