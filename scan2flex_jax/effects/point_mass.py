"""Point mass: a clip, a ferrite or a marker hangs on the cable.

``mass`` (kg) at arc length ``position`` (m) is a dead force ``mass * g`` on the centre line, put on the two nearest
nodes by Hermite interpolation: its derivative in ``position`` is continuous. Null: mass 0.
"""

from typing import ClassVar

from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects._fields import parameter
from scan2flex_jax.rod.effect import AbstractEffect, Section
from scan2flex_jax.rod.loads import DeadLoad, point_load


class PointMass(AbstractEffect):
    """A mass ``mass`` (kg) at arc length ``position`` (m)."""

    kind: ClassVar[str] = "point_mass"
    position: Float[Array, ""] = parameter()
    mass: Float[Array, ""] = parameter()

    def dead_load(self, section: Section, gravity: Float[Array, "3"]) -> DeadLoad:
        """The weight of the mass."""
        return point_load(section, self.position, self.mass * gravity)
