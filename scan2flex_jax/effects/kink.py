"""Kink: a set bend, local in s.

``angle`` (rad, about d1, d2, d3) is the total set bend, spread as natural curvature over a box of ``width`` (m)
about ``position`` (m) with smoothed edges; for a smaller width the smoothing itself sets the extent.
On every mesh the curvatures integrate to ``angle`` and their centroid is ``position``; a free weightless cable turns
by the angle. Null: angle 0.
"""

from typing import ClassVar

import equinox as eqx
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.builders import AXES
from scan2flex_jax.effects.entry import CatalogueEntry, SameShapes, along_cable, positions
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.effects.spans import bell_means
from scan2flex_jax.rod.effect import AbstractEffect, Section


class Kink(AbstractEffect):
    """A set bend ``angle`` (rad) over ``width`` (m) at ``position`` (m)."""

    kind: ClassVar[str] = "kink"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "a set bend, local in s"
    position: Float[Array, ""] = parameter("m", domain="along_cable")
    angle: Float[Array, "3"] = parameter("rad", 3)
    width: Float[Array, ""] = parameter("m", domain="nonnegative", default=0.0)

    def section(self, section: Section, length: Float[Array, ""]) -> Section:
        """Sections with the kink's curvature in their natural one."""
        bend = bell_means(section, self.position, self.width, length)[:, None] * self.angle
        return eqx.tree_at(lambda x: x.natural, section, section.natural.at[:, 3:].add(bend))


_BENDS = (0.02, 0.12)  # of the length: widths of set bends to scan

ENTRY = CatalogueEntry(
    Kink, AXES,
    lambda c: np.full(3, 0.15),  # rad: a cable bent by hand keeps five to ten degrees
    sites=lambda c: tuple({"position": s, "width": w * c.length} for w in _BENDS for s in positions(c)),
    moving={"position": along_cable, "width": lambda c: (0.5 * (_BENDS[0] * c.length), 1.5 * (_BENDS[-1] * c.length))},
    bounds_of=lambda c: (np.full(3, -3.0), np.full(3, 3.0)),
    signature="a corner at the same place of the cable in all poses that turns with the cable",
    settle="look at the named place, or scan with both clamps rolled by 180 degrees",
    same_shapes=(SameShapes("clamp_rotation", "a kink at a clamp"),),
)  # fmt: skip
