"""Moment: a shaft of fixed axis turns a section, as a weight on a drum, a lever or a motor does.

The azimuth ``phi`` of a material vector of the section at ``position`` (m), its angle about ``axis`` (-, scan frame), has the
energy ``-moment phi``. The vector is the tangent d3 or, with a ``lever`` (-, along d1, d2, d3), another one: a torque about the
cable itself needs ``lever = [1, 0, 0]``. A turn of the section about the axis always does the work ``moment`` times its angle,
so that the moment about the axis is exactly ``moment`` (N m), after any number of turns. While the cable bends in the plane
across the axis it is all of the moment; where the vector tilts out of that plane, the shaft carries the rest.

A moment of fixed direction without a shaft, and one that turns with the section (a follower), are not conservative in space
(Ziegler, "Principles of Structural Stability", 1968): they have no energy and no equilibrium in this sense. In a plane both are
this one. A couple of dead forces on arms is two `point_load` with opposite ``force`` and ``offset``.

Null: moment 0. The energy itself jumps by a turn's work at one azimuth, its derivatives do not.
"""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.builders import places
from scan2flex_jax.effects.entry import CatalogueEntry
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.rod.effect import AbstractEffect, Element


class Moment(AbstractEffect):
    """``moment`` (N m) about ``axis`` at ``position`` (m), on the azimuth of d3 or of ``lever``."""

    kind: ClassVar[str] = "moment"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "a shaft of fixed axis turns a section"
    position: Float[Array, ""] = parameter("m", domain="along_cable")
    axis: Float[Array, "3"] = parameter("-", 3, domain="unit", estimable=False)
    moment: Float[Array, ""] = parameter("N m")
    lever: Float[Array, "3"] | None = parameter("-", 3, domain="unit", estimable=False, default=None, optional=True)

    def element_potential(self, element: Element) -> Float[Array, ""]:
        """Energy (J) of the moment, in the element of its place."""
        u, own = element.share(self.position)
        lever = jnp.array([0.0, 0.0, 1.0]) if self.lever is None else self.lever
        first = jnp.cross(self.axis, jnp.eye(3)[jnp.argmin(jnp.abs(self.axis))])
        vector = jnp.where(own, element.arm(u, lever), first)
        azimuth = jnp.arctan2(vector @ jnp.cross(self.axis, first), vector @ first)
        return jnp.where(own, -self.moment * azimuth, 0.0)


ENTRY = CatalogueEntry(
    Moment, ("moment",),
    lambda c: np.array([0.05 * c.force * c.length]),  # as of a point load in the middle
    sites=lambda c: tuple({**site, "axis": np.array([0.0, 1.0, 0.0])} for site in places(c)),
    signature="the cable is turned at one place of it, in the same sense in all poses",
    settle="look for what turns the cable at the named place",
    searched=False,
)  # fmt: skip
