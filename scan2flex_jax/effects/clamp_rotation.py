"""Clamp rotation: a clamp is rotated from its stated orientation, by the same rotation in every pose.

``rotation`` (rad) is one rotation vector per end, in the clamp's own frame: ``R exp(hat(rotation))``. Its third entry
is a roll about the tangent. Inactive at ends whose rotation is free. Null: 0. An offset of the same clamp
(`clamp_offset`) refers to the nominal frame, so it is applied first (`effects.ordered`).
"""

from typing import ClassVar

import equinox as eqx
import jax
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.builders import ends, ends_without
from scan2flex_jax.effects.entry import CatalogueEntry, SameShapes
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.geometry import lie
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.effect import AbstractEffect
from scan2flex_jax.study.kinds import ENDS


class ClampRotation(AbstractEffect):
    """Rotation vectors ``rotation`` (rad) of start and end clamp."""

    kind: ClassVar[str] = "clamp_rotation"
    place: ClassVar[str] = "clamps"
    words: ClassVar[str] = "a clamp is turned from where it is said to be"
    rank: ClassVar[int] = 1
    rotation: Float[Array, "2 3"] = parameter("rad", 3, per_end=True)

    def clamps(self, boundary: Boundary) -> Boundary:
        """The clamps turned."""
        return eqx.tree_at(lambda b: b.rotation, boundary, boundary.rotation @ jax.vmap(lie.so3_exp)(self.rotation))


ENTRY = CatalogueEntry(
    ClampRotation, tuple(f"{end} about {d}" for end in ENDS for d in ("d1", "d2", "d3")),
    lambda c: np.full(6, 0.03),  # rad: two degrees, a typical error of an unmeasured bracket
    sites=ends, inactive_of=ends_without(3), bounds_of=lambda c: (np.full(6, -0.8), np.full(6, 0.8)),
    signature="the misfit is largest next to a clamp, turns with the clamp and is alike in all poses",
    settle="scan the clamps and their roll marks along with the cable",
    same_shapes=(SameShapes("natural_curvature", "a roll of one end and natural twist", always=True),),
)  # fmt: skip
