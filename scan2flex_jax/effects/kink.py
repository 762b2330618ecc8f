"""Kink: a set bend, local in s.

``angle`` (rad, about d1, d2, d3) is the set bend in total, spread as natural curvature over a box of ``width`` (m)
about ``position`` (m) with the edges of a span, or over what smoothing makes of a point when the width is smaller.
Whatever the mesh, the curvatures add up to ``angle`` and their centre is ``position``; a free weightless cable turns
by the angle. Null: angle 0.
"""

from typing import ClassVar

import equinox as eqx
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects._fields import parameter
from scan2flex_jax.effects._span import bell_means
from scan2flex_jax.rod.effect import AbstractEffect, Section


class Kink(AbstractEffect):
    """A set bend ``angle`` (rad) over ``width`` (m) at ``position`` (m)."""

    kind: ClassVar[str] = "kink"
    position: Float[Array, ""] = parameter()
    angle: Float[Array, "3"] = parameter(3)
    width: Float[Array, ""] = parameter(default=0.0)

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with the kink's curvature in their natural one."""
        bend = bell_means(section, self.position, self.width, length)[:, None] * self.angle
        return eqx.tree_at(lambda x: x.natural, section, section.natural.at[:, 3:].add(bend))
