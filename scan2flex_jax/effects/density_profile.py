"""Density profile: a span is heavier or lighter.

The mass per length is ``factor`` (-) times as large in a box of ``width`` (m) about ``position`` (m). Null: factor 1.
"""

from typing import ClassVar

import equinox as eqx
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.builders import span
from scan2flex_jax.effects.entry import CatalogueEntry, SameShapes
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.effects.spans import box_means
from scan2flex_jax.rod.effect import AbstractEffect, Section


class DensityProfile(AbstractEffect):
    """Mass per length times ``factor`` (-) within ``width`` (m) about ``position`` (m)."""

    kind: ClassVar[str] = "density_profile"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "a span is heavier or lighter"
    position: Float[Array, ""] = parameter("m", domain="along_cable")
    width: Float[Array, ""] = parameter("m", domain="positive")
    factor: Float[Array, ""] = parameter("-", domain="positive")

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with the span's density."""
        box = box_means(section, self.position, self.width, length)
        return eqx.tree_at(lambda x: x.density, section, section.density * (1.0 + (self.factor - 1.0) * box))


ENTRY = CatalogueEntry(
    DensityProfile, size=lambda c: np.array([0.5]),  # a sleeve, or water in a hose
    **span(DensityProfile, lambda factor: factor - 1.0),
    signature="one span sags as if it were heavier (or lighter), always along gravity",
    settle="weigh or look at the named span",
    same_shapes=(SameShapes("point_mass", "a span that is short against the sag"),),
)  # fmt: skip
