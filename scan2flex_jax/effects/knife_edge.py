"""Knife edge: an edge, a roller, a groove or an eyelet fixed in space, over which the cable slides without friction.

It holds the cable where the centre curve crosses the plane through ``anchor`` (m, scan frame) with the normal ``along`` (-),
the direction of the cable there: along ``direction`` (-), as an edge or a roller does, or in all directions of that plane where
it is left out, as a groove or an eyelet does. The edge lies across ``along`` and ``direction``, and the cable is free to move
along it.

With ``r(s)`` the centre curve, ``(r - anchor) . along = 0`` determines ``s``, and the energy is that of the remaining distance.
Its derivative by ``r`` has no part along the tangent: the reaction is normal to the cable, as it is without friction. The edge
holds both ways. A cable that has slid off its end, or crosses the plane more than once, is no equilibrium (`statics.verdict`).
"""

from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float

from scan2flex_jax.effects.entry import CatalogueEntry
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.effects.support import in_direction
from scan2flex_jax.rod.effect import Element
from scan2flex_jax.rod.support import AbstractSupport

_STEPS, _DIFFERENTIATED = 5, 3  # of Newton's method to the crossing; those last ones carry its derivatives, up to the seventh
_TINY = 1.0e-300


class KnifeEdge(AbstractSupport):
    """Holds the cable where it crosses the plane across ``along`` at ``anchor`` (m): along ``direction``, or in that plane."""

    kind: ClassVar[str] = "knife_edge"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "the cable slides over an edge or through an eyelet"
    anchor: Float[Array, "3"] = parameter("m", 3)
    along: Float[Array, "3"] = parameter("-", 3, domain="unit", estimable=False)
    direction: Float[Array, "3"] = parameter("-", 3, domain="unit", estimable=False, optional=True)

    def held_at(self, element: Element) -> tuple[Float[Array, ""], Bool[Array, ""]]:
        """Where the element crosses the plane; before the start and beyond the end of the cable on its tangent there."""
        before, after = (element.r - self.anchor) @ self.along
        first, last = element.ds * element.R[:, :, 2] @ self.along
        crosses = ((before <= 0.0) & (after > 0.0)) | ((before >= 0.0) & (after < 0.0))
        ahead = element.first & (before * first > 0.0) & ~crosses
        behind = element.last & (after * last <= 0.0) & ~crosses
        cubic = (before, first, 3.0 * (after - before) - 2.0 * first - last, 2.0 * (before - after) + first + last)
        u = self._crossing(cubic, crosses, before / self._advance(before - after, crosses))
        u = jnp.where(ahead, -before / self._advance(first, ahead), u)
        return jnp.where(behind, 1.0 - after / self._advance(last, behind), u), crosses | ahead | behind

    def _crossing(self, cubic, crosses, u):
        """The root of a cubic, from ``u``, by Newton's method."""
        a, b, c, d = cubic
        u = jax.lax.stop_gradient(jnp.where(crosses, u, 0.5))
        for k in range(_STEPS):
            height, slope = a + u * (b + u * (c + u * d)), b + u * (2.0 * c + 3.0 * u * d)
            moved = u - jnp.where(crosses, height / self._advance(slope, crosses), 0.0)
            u = moved if k >= _STEPS - _DIFFERENTIATED else jax.lax.stop_gradient(jnp.clip(moved, 0.0, 1.0))
        return u

    @staticmethod
    def _advance(slope, counts):
        """``slope`` (m), away from zero where it ``counts``, and one elsewhere, so that no derivative divides by zero."""
        return jnp.where(counts & (jnp.abs(slope) > _TINY), slope, 1.0)

    def gap(self, element: Element, u: Float[Array, ""]) -> Float[Array, "3"]:
        """From the anchor to the crossing, in the held directions; on the tangent beyond an end of the cable."""
        inside = jnp.clip(u, 0.0, 1.0)
        beyond = jnp.where(u > 0.5, element.R[1, :, 2], element.R[0, :, 2]) * element.ds * (u - inside)
        away = element.point(inside) + beyond - self.anchor
        return in_direction(away - away @ self.along * self.along, self.direction)

    def hint(self, length: Float[Array, ""]) -> tuple[Float[Array, ""], Float[Array, "3"]]:
        """The direction of the cable."""
        return jnp.array(jnp.nan), self.along

    def lost(self, points: Float[Array, "nodes 3"]) -> Bool[Array, ""]:
        """Whether the nodes do not pass from one side of the plane to the other exactly once."""
        side = (points - self.anchor) @ self.along >= 0.0
        return jnp.sum(side[1:] != side[:-1]) != 1


ENTRY = CatalogueEntry(
    KnifeEdge, ("anchor x", "anchor y", "anchor z"),
    lambda c: np.full(3, 0.01 * c.length),
    build=lambda a, site, c: (KnifeEdge(jnp.asarray(c.centre) + a, site["along"]),),
    sites=lambda c: ({"along": np.array([1.0, 0.0, 0.0])},),
    signature="the cable passes through one point of space in every pose, at another place of it in each",
    settle="look for what the cable slides over",
    searched=False,
)  # fmt: skip
