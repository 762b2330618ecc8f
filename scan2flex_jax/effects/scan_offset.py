"""Scan offset: measured shapes are shifted by the same vector in every pose. Null: 0.

The supports are not: they come from elsewhere than the scan (else nothing could be seen of it).
"""

from typing import ClassVar

from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects._fields import parameter
from scan2flex_jax.rod.effect import AbstractEffect


class ScanOffset(AbstractEffect):
    """The scanner sees points shifted by ``offset`` (m, scan frame)."""

    kind: ClassVar[str] = "scan_offset"
    rank: ClassVar[int] = 1
    offset: Float[Array, "3"] = parameter(3)

    def observe(self, points: Float[Array, "*m 3"]) -> Float[Array, "*m 3"]:
        """Points as scanned (m)."""
        return points + self.offset
