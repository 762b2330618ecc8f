"""Curvature profile: the cable is bent at rest, differently along s, as a drum, a clip and years in a machine leave it.

``curvature`` (1/m, about d1, d2, d3) at places ``s`` (m), smooth between them; without places on points evenly spaced from
s = 0 to L, linear between them. Null: 0.
"""

from typing import ClassVar

import equinox as eqx
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects._fields import places, values
from scan2flex_jax.effects._span import field_along
from scan2flex_jax.rod.effect import AbstractEffect, Section


class CurvatureProfile(AbstractEffect):
    """Natural curvature ``curvature`` (1/m) at places ``s`` (m) along the cable."""

    kind: ClassVar[str] = "curvature_profile"
    curvature: Float[Array, "m 3"] = values(3)
    s: Float[Array, " m"] | None = places()

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with the field added to their natural curvature."""
        field = field_along(section, self.curvature, self.s, length)
        return eqx.tree_at(lambda x: x.natural, section, section.natural.at[:, 3:].add(field))
