"""Support plane: the cable rests on a plane; its centre curve stays at ``normal . x >= offset`` (m). No friction.

A node at depth ``p`` is pushed back with ``contact_stiffness * f(p)`` per length, ``f = p^2/(2 d)`` up to
``p = d`` and ``p - d/2`` beyond, ``d = 4 %`` of an element. The energy is thus twice continuously differentiable, and the
plane is softer for a light cable than for a heavy one: with a sharper onset Newton's method switches nodes on and off
indefinitely. Measured depth of a 1 m cable of 0.98 N/m in 40 elements: 0.5 to 1.8e-4 of its length. From a start far
from the solution, solve with a hundredth of the stiffness first. ``normal`` is normalised.
Null: an offset below the cable, or contact_stiffness 0.
"""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float
from scipy.spatial import ConvexHull

from scan2flex_jax.effects.entry import CatalogueEntry, SameShapes
from scan2flex_jax.effects.format import leaf, parameter
from scan2flex_jax.rod.effect import AbstractEffect, Node

CONTACT = 1.0e6  # N/m^2: heavy hoses of 50 N/m then sink by less than a millimetre
ROUNDING = 0.04  # of an element: depth over which contact sets in


class SupportPlane(AbstractEffect):
    """A one-sided plane ``normal . x >= offset`` (m), of ``contact_stiffness`` (N/m^2)."""

    kind: ClassVar[str] = "support_plane"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "the cable rests on a plane"
    normal: Float[Array, "3"] = parameter("-", 3, domain="unit")
    offset: Float[Array, ""] = parameter("m")
    contact_stiffness: Float[Array, ""] = leaf(default=CONTACT)

    def node_potential(self, node: Node) -> Float[Array, ""]:
        """Energy (J) of the contact of one node."""
        depth = self.offset - self.normal @ node.r / jnp.linalg.norm(self.normal)
        d = ROUNDING * node.ds
        p = jnp.clip(depth, 0.0, d)
        past = jnp.maximum(depth - d, 0.0)
        return node.weight * self.contact_stiffness * (p**3 / (6.0 * d) + 0.5 * past * (past + d))


_LIFTS, _TILT = (-0.002, 0.0, 0.002, 0.005), 0.2  # of the length, above a plane; largest tilt of a table from the level
_PLANES, _LEAN, _TOUCHING, _OTHER = 4, 0.12, 0.002, 0.01  # count; tilt; of the length; tilt that makes a plane distinct


def _ground(c):
    """Candidate planes, each at several offsets. Only the scanner's noise puts points below a hard plane.

    A hard plane is therefore a facet of the hull of all measured points. Tables are level to a few degrees: of the facets that
    are tilted less, those with most points on them, and the level plane through the lowest point.
    """
    axes = _level_axes(c.up)
    planes = [(0.0, 0.0, c.lowest), *_facets(c, axes)]
    planes += planes[:1] * (_PLANES - len(planes))
    return tuple(
        {"offset": part * c.length, "tilt_1": a, "tilt_2": b, "place": place, "axes": axes}
        for a, b, place in planes for part in _LIFTS
    )  # fmt: skip


def _level_axes(up):
    """Two unit vectors (2, 3) across ``up``."""
    first = np.cross(up, np.eye(3)[np.argmin(np.abs(up))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(up, first)])


def _facets(c, axes):
    """Lower facets ``(tilt, tilt, a point)`` of the hull of all measured points, by decreasing number of points on them."""
    if len(c.points) < 4:
        return []
    hull = ConvexHull(c.points, qhull_options="QJ")  # joggled: plane poses have no volume
    lower = hull.equations[-hull.equations[:, :3] @ c.up > np.cos(_LEAN)]
    order = sorted(lower, key=lambda e: -np.sum(c.points @ e[:3] + e[3] > -_TOUCHING * c.length))
    out: list = []
    for e in order:
        tilt = axes @ e[:3] / (e[:3] @ c.up)
        touching = c.points[c.points @ e[:3] + e[3] > -_TOUCHING * c.length]
        if all(np.linalg.norm(tilt - other[:2]) > _OTHER for other in out):
            out.append((*tilt, touching.mean(axis=0)))
    return out[: _PLANES - 1]


def _tilts(c):
    return -_TILT, _TILT


def _plane(site, up):
    """Unit normal, and the offset (m) of a plane at a site."""
    lean = up + site["tilt_1"] * site["axes"][0] + site["tilt_2"] * site["axes"][1]
    normal = lean / jnp.linalg.norm(lean)
    return normal, normal @ (site["place"] + site["offset"] * up)


def _table(a, site, c):
    normal, offset = _plane(site, jnp.asarray(c.up))
    return (SupportPlane(normal, offset, a[0]),)


ENTRY = CatalogueEntry(
    SupportPlane, ("contact stiffness",),
    lambda c: np.array([20.0 * c.force / c.length**2]),  # N/m^2: its weight at a depth of 5 % of the length
    build=_table,
    sites=_ground, one_sided=(True,), bounds_of=lambda c: (np.zeros(1), np.array([CONTACT])),
    moving={"offset": lambda c: (_LIFTS[0] * c.length, _LIFTS[-1] * c.length), "tilt_1": _tilts, "tilt_2": _tilts},
    start_site=lambda site, noise: {**site, "offset": noise},  # only the noise puts points below a hard plane
    continuation=(20.0, 400.0, 1.0e4),
    signature="low poses are flat below one level, poses above it are untouched",
    settle="scan the table along with the cable",
    same_shapes=(SameShapes("elastic_support", "when every pose lies below the level"),),
)  # fmt: skip
