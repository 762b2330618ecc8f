"""Stiffness profile: a span is stiffer or softer (a sleeve, an overmould, a damaged place).

EI and GJ are ``factor`` (-) times as large in a box of ``width`` (m) about ``position`` (m). An element that contains an
edge gets the series stiffness of its two parts. Null: factor 1.
"""

from typing import ClassVar

import equinox as eqx
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.builders import span
from scan2flex_jax.effects.entry import CatalogueEntry, SameShapes
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.effects.spans import scaled_bending, series_factor
from scan2flex_jax.rod.effect import AbstractEffect, Section


class StiffnessProfile(AbstractEffect):
    """EI and GJ times ``factor`` (-) within ``width`` (m) about ``position`` (m)."""

    kind: ClassVar[str] = "stiffness_profile"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "a span is stiffer or softer"
    position: Float[Array, ""] = parameter("m", domain="along_cable")
    width: Float[Array, ""] = parameter("m", domain="positive")
    factor: Float[Array, ""] = parameter("-", domain="positive")

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with the span's stiffness."""
        factor = series_factor(section, self.position, self.width, self.factor, length)
        return eqx.tree_at(lambda x: x.stiffness, section, scaled_bending(section, factor))


ENTRY = CatalogueEntry(
    StiffnessProfile, size=lambda c: np.array([0.5]),  # a sleeve, a worn place: 0.6 to 1.6
    **span(StiffnessProfile, lambda factor: 1.0 / factor - 1.0),  # compliances add
    signature="one span bends less (or more) than it should in every pose",
    settle="look and feel at the named span, or bring it to where the cable is bent most",
    same_shapes=(SameShapes("elastic_clamp", "a span at a clamp"),
                 SameShapes("length_error", "a stiff span that begins at a clamp"),
                 SameShapes("stiffness_field", "when its ends are not sharp")),
)  # fmt: skip
