"""Scan offset: measured shapes are shifted by the same vector in every pose. Null: 0.

The supports are not shifted: they do not come from the scan (a shift of both would be unobservable).
"""

from typing import ClassVar

import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.builders import XYZ
from scan2flex_jax.effects.entry import CatalogueEntry, SameShapes
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.rod.effect import AbstractEffect


class ScanOffset(AbstractEffect):
    """The scanner sees points shifted by ``offset`` (m, scan frame)."""

    kind: ClassVar[str] = "scan_offset"
    place: ClassVar[str] = "observation"
    words: ClassVar[str] = "measured shapes are shifted"
    rank: ClassVar[int] = 1
    offset: Float[Array, "3"] = parameter("m", 3)

    def observe(self, points: Float[Array, "*m 3"]) -> Float[Array, "*m 3"]:
        """Points as scanned (m)."""
        return points + self.offset


ENTRY = CatalogueEntry(
    ScanOffset, XYZ,
    lambda c: np.full(3, 0.002 * c.length),  # two millimetres on a metre: one side of the cable, a marker's base
    signature="all points of all poses are shifted alike, at the clamps too",
    settle="scan the clamps along with the cable",
    same_shapes=(SameShapes("clamp_offset", "the same shift of both clamps, when no pose turns them"),),
)  # fmt: skip
