"""Elastic support: the cable lies in or is glued to a soft bed that holds it on both sides (foam, a curtain of
threads).

A spring of ``stiffness`` (N/m per length, N/m^2) draws the centre line to the plane ``normal . x = offset`` (m);
along the plane it moves freely. ``normal`` (-) is normalised. Null: stiffness 0.
"""

from typing import ClassVar

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects._fields import parameter
from scan2flex_jax.rod.effect import AbstractEffect, Node


class ElasticSupport(AbstractEffect):
    """A two-sided spring bed of ``stiffness`` (N/m^2) about the plane ``normal . x = offset`` (m)."""

    kind: ClassVar[str] = "elastic_support"
    normal: Float[Array, "3"] = parameter(3)
    offset: Float[Array, ""] = parameter()
    stiffness: Float[Array, ""] = parameter()

    def node_potential(self, node: Node) -> Float[Array, ""]:
        """Energy (J) of the springs of one node."""
        lift = self.normal @ node.r / jnp.linalg.norm(self.normal) - self.offset
        return 0.5 * node.weight * self.stiffness * lift**2
