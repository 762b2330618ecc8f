"""Point load: a dead force at one place, the same in every pose (a tie wrap, a hanging connector's lead, a finger).

``force`` (N, scan frame) acts at arc length ``position`` (m) by Hermite interpolation. A vertical one is a
`point_mass`. With an ``offset`` (m, along d1, d2, d3) it acts beside the cable, on an arm that turns with the section; two
opposite forces on opposite arms are a couple (a quasi-tangential moment). Null: force 0.
"""

from typing import ClassVar

import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.builders import XYZ, places
from scan2flex_jax.effects.entry import CatalogueEntry, SameShapes, along_loaded
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.rod.effect import AbstractEffect, Section
from scan2flex_jax.rod.loads import DeadLoad, point_load


class PointLoad(AbstractEffect):
    """A dead force ``force`` (N) at arc length ``position`` (m)."""

    kind: ClassVar[str] = "point_load"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "a dead force at one place"
    position: Float[Array, ""] = parameter("m", domain="along_cable")
    force: Float[Array, "3"] = parameter("N", 3)
    offset: Float[Array, "3"] | None = parameter("m", 3, default=None, optional=True)

    def dead_load(self, section: Section, gravity: Float[Array, "3"]) -> DeadLoad:
        """The force."""
        return point_load(section, self.position, self.force, self.offset)


ENTRY = CatalogueEntry(
    PointLoad, XYZ,
    lambda c: np.full(3, 0.05 * c.force),  # a lead or a tie that pulls with a twentieth of the weight
    sites=places, moving={"position": along_loaded},
    signature="the cable is drawn at one place of it, in the same direction of space in all poses",
    settle="look at the named place, or turn the whole setting about the vertical",
    same_shapes=(SameShapes("point_mass", "a force straight down", always=True),),
)  # fmt: skip
