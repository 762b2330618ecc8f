"""Elastic support: the cable lies in or is glued to a soft two-sided bed (foam, a curtain of threads).

A spring of ``stiffness`` (N/m per length, N/m^2) pulls the centre line to the plane ``normal . x = offset`` (m);
motion along the plane is free. ``normal`` (-) is normalised. Null: stiffness 0.
"""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects.entry import CatalogueEntry
from scan2flex_jax.effects.format import parameter
from scan2flex_jax.rod.effect import AbstractEffect, Node


class ElasticSupport(AbstractEffect):
    """A two-sided spring bed of ``stiffness`` (N/m^2) about the plane ``normal . x = offset`` (m)."""

    kind: ClassVar[str] = "elastic_support"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "a soft bed holds the cable on both sides of a plane"
    normal: Float[Array, "3"] = parameter("-", 3, domain="unit")
    offset: Float[Array, ""] = parameter("m")
    stiffness: Float[Array, ""] = parameter("N/m^2", domain="nonnegative")

    def node_potential(self, node: Node) -> Float[Array, ""]:
        """Energy (J) of the springs of one node."""
        lift = self.normal @ node.r / jnp.linalg.norm(self.normal) - self.offset
        return 0.5 * node.weight * self.stiffness * lift**2


def _levels(c):
    """Heights of soft supports, from the lowest measured point to slightly above the highest of the poses' lowest points."""
    least, largest = _level_range(c)
    return tuple({"offset": h} for h in np.linspace(least, largest, 13))


def _level_range(c):
    """Least and largest height (m) of a soft support."""
    low, high = c.lowest_range
    margin = 0.02 * c.length
    return low - 0.25 * margin, max(high, low) + 2.0 * margin


ENTRY = CatalogueEntry(
    ElasticSupport, ("stiffness",),
    lambda c: np.array([2.0 * c.force / c.length**2]),  # N/m^2: its weight at half the length, a soft curtain
    build=lambda a, site, c: (ElasticSupport(jnp.asarray(c.up), site["offset"], a[0]),),
    sites=_levels, moving={"offset": _level_range}, one_sided=(True,),
    signature="all poses are drawn to one level, from above and from below",
    settle="look for what the cable lies in",
)  # fmt: skip
