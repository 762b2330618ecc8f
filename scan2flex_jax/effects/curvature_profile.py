"""Curvature profile: a natural curvature field along s. It describes what no kind explains; it is not physics.

``values`` (1/m, about d1, d2, d3) on points evenly spaced from s = 0 to L, linear between them. Null: 0.
"""

from typing import ClassVar

import equinox as eqx
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects._fields import values
from scan2flex_jax.effects._span import hat_field
from scan2flex_jax.rod.effect import AbstractEffect, Section


class CurvatureProfile(AbstractEffect):
    """Natural curvature ``values`` (1/m) on points evenly along the cable."""

    kind: ClassVar[str] = "curvature_profile"
    values: Float[Array, "m 3"] = values(3)

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with the field added to their natural curvature."""
        field = hat_field(section, self.values, length)
        return eqx.tree_at(lambda x: x.natural, section, section.natural.at[:, 3:].add(field))
