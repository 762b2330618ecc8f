"""Distributed load: a dead force field along s. It describes what no kind explains; it is not physics.

``values`` (N/m, scan frame) on points evenly spaced from s = 0 to L, linear between them. Null: 0.
"""

from typing import ClassVar

from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects._fields import values
from scan2flex_jax.effects._span import hat_field
from scan2flex_jax.rod.effect import AbstractEffect, Section
from scan2flex_jax.rod.loads import DeadLoad, distributed_load


class DistributedLoad(AbstractEffect):
    """Dead load ``values`` (N/m) on points evenly along the cable."""

    kind: ClassVar[str] = "distributed_load"
    values: Float[Array, "m 3"] = values(3)

    def dead_load(self, section: Section, gravity: Float[Array, "3"]) -> DeadLoad:
        """The load on all elements."""
        length = section.ds * section.s.shape[0]
        return distributed_load(section, hat_field(section, self.values, length))
