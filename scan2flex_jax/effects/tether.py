"""Tether: a string or a spring from a fixed point to a place on the cable, slack when shorter than its rest length.

The place at arc length ``position`` (m) is tied to ``anchor`` (m, scan frame) by a spring of ``stiffness`` (N/m) and
``rest_length`` (m): energy ``1/2 k max(distance - rest_length, 0)^2``, continuously differentiable.

The place lies between two nodes. Each of them carries the energy of a point ahead of (behind) it along its tangent,
``r + ds u/(1 + 2|u|) d3`` with ``u = (position - s)/ds``, with weight ``1 - 3u^2 + 2|u|^3``: the weights add to one
and the weighted mean of the two points is the cubic Hermite curve. Second order in the mesh, smooth in position.
Null: stiffness 0.
"""

from typing import ClassVar

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects._fields import parameter
from scan2flex_jax.rod.effect import AbstractEffect, Node

TINY = 1.0e-24  # m^2: keeps the derivative of a distance of zero finite


def place_on_cable(node: Node, position: Float[Array, ""]):
    """``(point, weight)``: what this node contributes to the place at ``position`` (m); the weights add to one."""
    u = (position - node.s) / node.ds
    v = jnp.minimum(jnp.abs(u), 1.0)
    return node.r + node.ds * jnp.clip(u, -1.0, 1.0) / (1.0 + 2.0 * v) * node.R[:, 2], 1.0 + v**2 * (2.0 * v - 3.0)


class Tether(AbstractEffect):
    """A spring of ``stiffness`` (N/m) and ``rest_length`` (m) from ``anchor`` (m) to the cable at ``position`` (m)."""

    kind: ClassVar[str] = "tether"
    position: Float[Array, ""] = parameter()
    anchor: Float[Array, "3"] = parameter(3)
    stiffness: Float[Array, ""] = parameter()
    rest_length: Float[Array, ""] = parameter(default=0.0)

    def node_potential(self, node: Node) -> Float[Array, ""]:
        """Energy (J) of the spring, as far as it hangs on this node."""
        point, weight = place_on_cable(node, self.position)
        span = point - self.anchor
        longer = jnp.maximum(jnp.sqrt(span @ span + TINY) - self.rest_length, 0.0)
        return 0.5 * weight * self.stiffness * longer**2
