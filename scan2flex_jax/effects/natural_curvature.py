"""Natural curvature: the cable is bent (or twisted) at rest, alike along s.

``curvature`` is added to Omega_0 (1/m, about d1, d2, d3), so a section carries ``K_Omega (Omega - Omega_0)``. It
turns with the cable: rolling both clamps rolls it. Null: 0.
Source: paper, Eq. 3, where Omega_0 stands but is set to zero.
"""

from typing import ClassVar

import equinox as eqx
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects._fields import parameter
from scan2flex_jax.rod.effect import AbstractEffect, Section


class NaturalCurvature(AbstractEffect):
    """Set curvature ``curvature`` (1/m) of the whole cable."""

    kind: ClassVar[str] = "natural_curvature"
    curvature: Float[Array, "3"] = parameter(3)

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with the curvature added to their natural one."""
        return eqx.tree_at(lambda x: x.natural, section, section.natural.at[:, 3:].add(self.curvature))
