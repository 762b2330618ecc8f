"""Support: a roller, a pin or a hook holds a place of the cable.

The place at arc length ``position`` (m), the ends included, is held at ``anchor`` (m, scan frame): along ``direction`` (-), so
that it is free across it, or in all three directions where that is left out. The section turns freely. The support holds both
ways. No null: it holds, or is not there.
"""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from scan2flex_jax.effects.entry import CatalogueEntry
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.rod.effect import Element
from scan2flex_jax.rod.support import AbstractSupport


def in_direction(gap: Float[Array, "3"], direction: Float[Array, "3"]) -> Float[Array, "3"]:
    """The part of a gap (m) along a ``direction``; all of it where the direction is zero."""
    size = direction @ direction
    some = size > 0.0
    return jnp.where(some, gap @ direction / jnp.where(some, size, 1.0) * direction, gap)


class Support(AbstractSupport):
    """Holds the place at ``position`` (m) at ``anchor`` (m) along ``direction``, or wholly."""

    kind: ClassVar[str] = "support"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "a support holds a place of the cable"
    position: Float[Array, ""] = parameter("m", domain="along_cable")
    anchor: Float[Array, "3"] = parameter("m", 3)
    direction: Float[Array, "3"] = parameter("-", 3, domain="unit", estimable=False, optional=True)

    def held_at(self, element: Element) -> tuple[Float[Array, ""], Bool[Array, ""]]:
        """The place of the cable."""
        return element.share(self.position)

    def gap(self, element: Element, u: Float[Array, ""]) -> Float[Array, "3"]:
        """From the anchor to the place, in the held directions."""
        return in_direction(element.point(u) - self.anchor, self.direction)

    def hint(self, length: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, "3"]]:
        """The place."""
        return self.position, jnp.zeros(3)

    def lost(self, points: Float[Array, "nodes 3"]) -> Bool[Array, ""]:
        """Never: it holds a place of the cable itself."""
        return jnp.array(False)


ENTRY = CatalogueEntry(
    Support, ("anchor x", "anchor y", "anchor z"),
    lambda c: np.full(3, 0.01 * c.length),
    build=lambda a, site, c: (Support(site["position"], jnp.asarray(c.centre) + a),),
    sites=lambda c: ({"position": 0.5 * c.length},),
    signature="the cable passes through one point of space in every pose",
    settle="look for what holds the cable",
    searched=False,
)  # fmt: skip
