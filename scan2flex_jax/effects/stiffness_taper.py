"""Stiffness taper: EI and GJ grow from start to end by ``exp(taper (2 s/L - 1))``. ``taper`` (-) is half the
logarithm of the ratio of the stiffnesses at the two ends; the middle is unchanged. Null: 0.
"""

from typing import ClassVar

import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.entry import CatalogueEntry, SameShapes
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.effects.spans import grown
from scan2flex_jax.rod.effect import AbstractEffect, Section

MOST_TAPER = 5.0  # a factor of 20,000 from end to end: a fly rod of bamboo has 300


class StiffnessTaper(AbstractEffect):
    """Stiffness times ``exp(taper (2 s/L - 1))``."""

    kind: ClassVar[str] = "stiffness_taper"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "stiffness grows from start to end"
    taper: Float[Array, ""] = parameter("-")

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with tapered stiffness."""
        return grown(section, lambda s: self.taper * (2.0 * s / length - 1.0))


ENTRY = CatalogueEntry(
    StiffnessTaper, ("taper",),
    lambda c: np.array([0.5]),  # ends that differ in stiffness by a factor of e: the shafts of catheters, brushes, stems
    bounds_of=lambda c: (np.full(1, -MOST_TAPER), np.full(1, MOST_TAPER)),
    signature="one half of the cable bends more than the other, whichever way round it hangs",
    settle="swap the two ends of the cable in one pose",
    same_shapes=(SameShapes("stiffness_field", "when its logarithm grows evenly"),),
)  # fmt: skip
