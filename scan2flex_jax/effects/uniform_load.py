"""Uniform load: a dead load along the whole cable, the same in every pose (wind, buoyancy, or a tilt of gravity).

``force`` (N/m, scan frame) per unstretched length. The shapes are those of a rod in the gravity
``g + force / k_rhoA``, exactly for uniform density: from shapes alone the two cannot be distinguished. Null: 0.
"""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.builders import XYZ
from scan2flex_jax.effects.entry import CatalogueEntry, SameShapes
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.rod.effect import AbstractEffect, Section
from scan2flex_jax.rod.loads import DeadLoad, distributed_load


class UniformLoad(AbstractEffect):
    """A dead load ``force`` (N/m) on the whole cable."""

    kind: ClassVar[str] = "uniform_load"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "a dead load along the whole cable"
    force: Float[Array, "3"] = parameter("N/m", 3)

    def dead_load(self, section: Section, gravity: Float[Array, "3"]) -> DeadLoad:
        """The load on all elements."""
        return distributed_load(section, jnp.broadcast_to(self.force, (section.s.shape[0], 3)))


ENTRY = CatalogueEntry(
    UniformLoad, XYZ,
    lambda c: np.full(3, 0.04 * c.force / c.length),  # two degrees of tilt of the scan frame
    signature="all poses lean to the same side of space",
    settle="check gravity with a plumb line in the scan frame, and scan once without draught",
    same_shapes=(SameShapes("gravity", "a tilt of the scan frame", always=True),
                 SameShapes("length_density", "the part along gravity, as a scale of all stiffnesses")),
)  # fmt: skip
