"""Point load: a dead force at one place, the same in every pose (a tie wrap, a hanging connector's lead, a finger).

``force`` (N, scan frame) acts at arc length ``position`` (m) by Hermite interpolation. A vertical one is a
`point_mass`. Null: force 0.
"""

from typing import ClassVar

from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects._fields import parameter
from scan2flex_jax.rod.effect import AbstractEffect, Section
from scan2flex_jax.rod.loads import DeadLoad, point_load


class PointLoad(AbstractEffect):
    """A dead force ``force`` (N) at arc length ``position`` (m)."""

    kind: ClassVar[str] = "point_load"
    position: Float[Array, ""] = parameter()
    force: Float[Array, "3"] = parameter(3)

    def dead_load(self, section: Section, gravity: Float[Array, "3"]) -> DeadLoad:
        """The force."""
        return point_load(section, self.position, self.force)
