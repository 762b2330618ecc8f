"""Scan scale: every measured coordinate is off by one factor, about the origin of the scan frame. Null: factor 1."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.entry import CatalogueEntry
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.rod.effect import AbstractEffect


class ScanScale(AbstractEffect):
    """The scanner sees ``factor`` (-) times the true coordinates."""

    kind: ClassVar[str] = "scan_scale"
    place: ClassVar[str] = "observation"
    words: ClassVar[str] = "every measured coordinate is off by one factor"
    factor: Float[Array, ""] = parameter("-", domain="positive")

    def observe(self, points: Float[Array, "*m 3"]) -> Float[Array, "*m 3"]:
        """Points as scanned (m)."""
        return points * self.factor


ENTRY = CatalogueEntry(
    ScanScale, ("log factor",),
    lambda c: np.array([0.01]),  # one per cent, a poor calibration of the scanner
    build=lambda a, site, c: (ScanScale(jnp.exp(a[0])),),
    bounds_of=lambda c: (np.full(1, -0.3), np.full(1, 0.3)),
    signature="every coordinate is off in proportion to its distance from the origin, the clamps' surroundings too",
    settle="scan an object of known size",
)  # fmt: skip
