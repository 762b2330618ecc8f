"""Point mass: a clip, a ferrite or a marker hangs on the cable.

``mass`` (kg) at arc length ``position`` (m) is a dead force ``mass * g`` on the centre line, distributed to the two nearest
nodes by Hermite interpolation, with a continuous derivative in ``position``. With an ``offset`` (m, along d1, d2, d3) its
centre is beside the cable, on an arm that turns with the section. Null: mass 0.
"""

from typing import ClassVar

import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.builders import places
from scan2flex_jax.effects.entry import CatalogueEntry, SameShapes, along_loaded
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.rod.effect import AbstractEffect, Section
from scan2flex_jax.rod.loads import DeadLoad, point_load


class PointMass(AbstractEffect):
    """A mass ``mass`` (kg) at arc length ``position`` (m)."""

    kind: ClassVar[str] = "point_mass"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "a mass hangs on the cable"
    position: Float[Array, ""] = parameter("m", domain="along_cable")
    mass: Float[Array, ""] = parameter("kg", domain="nonnegative")
    offset: Float[Array, "3"] | None = parameter("m", 3, default=None, optional=True)

    def dead_load(self, section: Section, gravity: Float[Array, "3"]) -> DeadLoad:
        """The weight of the mass."""
        return point_load(section, self.position, self.mass * gravity, self.offset)


ENTRY = CatalogueEntry(
    PointMass, ("mass",),
    lambda c: np.array([0.15 * c.mass_per_length * c.length]),  # a clip or a ferrite, relative to the whole cable
    sites=places, moving={"position": along_loaded}, one_sided=(True,),
    signature="the cable sags towards one place of it, always along gravity",
    settle="look for a clip, a marker or a connector at the named place, or weigh the cable",
    same_shapes=(SameShapes("density_profile", "a span that is short against the sag"),),
)  # fmt: skip
