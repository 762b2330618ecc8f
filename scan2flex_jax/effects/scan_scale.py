"""Scan scale: every measured coordinate is off by one factor, about the origin of the scan frame. Null: factor 1."""

from typing import ClassVar

from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects._fields import parameter
from scan2flex_jax.rod.effect import AbstractEffect


class ScanScale(AbstractEffect):
    """The scanner sees ``factor`` (-) times the true coordinates."""

    kind: ClassVar[str] = "scan_scale"
    factor: Float[Array, ""] = parameter()

    def observe(self, points: Float[Array, "*m 3"]) -> Float[Array, "*m 3"]:
        """Points as scanned (m)."""
        return points * self.factor
