"""Curvature profile: a natural curvature that varies along s, such as a drum, a clip or years in a machine leave.

``curvature`` (1/m, about d1, d2, d3) at places ``s`` (m), smooth between them; without ``s``, at points evenly spaced from
s = 0 to L and linear between them. Null: 0.
"""

from typing import ClassVar

import equinox as eqx
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.builders import along
from scan2flex_jax.effects.entry import CatalogueEntry, SameShapes
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.effects.spans import field_along
from scan2flex_jax.geometry.fields import POINTS
from scan2flex_jax.rod.effect import AbstractEffect, Section


class CurvatureProfile(AbstractEffect):
    """Natural curvature ``curvature`` (1/m) at places ``s`` (m) along the cable."""

    kind: ClassVar[str] = "curvature_profile"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "the cable is bent at rest, differently along s"
    s: Float[Array, " m"] | None = parameter("m", per_point=True, domain="along_cable", estimable=False, default=None)
    curvature: Float[Array, "m 3"] = parameter("1/m", 3, per_point=True)

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with the field added to their natural curvature."""
        field = field_along(section, self.curvature, self.s, length)
        return eqx.tree_at(lambda x: x.natural, section, section.natural.at[:, 3:].add(field))


ENTRY = CatalogueEntry(
    CurvatureProfile,
    size=lambda c: np.full(3 * POINTS, 0.5 / c.length),  # as for a homogeneous natural curvature
    **along("curvature", CurvatureProfile),
    signature="a bow that differs along the cable and turns with it when both clamps are rolled",
    settle="scan one pose again with both clamps rolled by 180 degrees, or with one end free",
    same_shapes=(SameShapes("natural_curvature", "when it is alike all along"),),
)  # fmt: skip
