"""Stiffness taper: EI and GJ grow from start to end by ``exp(taper (2 s/L - 1))``. ``taper`` (-) is half the
logarithm of the ratio of the stiffnesses at the two ends; the middle is unchanged. Null: 0.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.builders import plain
from scan2flex_jax.effects.entry import CatalogueEntry
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.effects.spans import scaled_bending
from scan2flex_jax.rod.effect import AbstractEffect, Section


class StiffnessTaper(AbstractEffect):
    """Stiffness times ``exp(taper (2 s/L - 1))``."""

    kind: ClassVar[str] = "stiffness_taper"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "stiffness grows from start to end"
    taper: Float[Array, ""] = parameter("-")

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with tapered stiffness."""
        factor = jnp.exp(self.taper * (2.0 * section.s / length - 1.0))
        return eqx.tree_at(lambda x: x.stiffness, section, scaled_bending(section, factor))


ENTRY = CatalogueEntry(
    StiffnessTaper, ("taper",),
    lambda c: np.array([0.2]),  # ends that differ in stiffness by half
    **plain("taper", StiffnessTaper), bounds_of=lambda c: (np.full(1, -2.0), np.full(1, 2.0)),
    signature="one half of the cable bends more than the other, whichever way round it hangs",
    settle="swap the two ends of the cable in one pose",
)  # fmt: skip
