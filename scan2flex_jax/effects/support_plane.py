"""Support plane: the cable rests on a plane; its centre curve stays at ``normal . x >= offset`` (m). No friction.

A node that sinks by ``p`` is pushed back with ``contact_stiffness * f(p)`` per length, ``f = p^2/(2 d)`` up to
``p = d`` and ``p - d/2`` beyond, ``d = 4 %`` of an element. So the energy is twice continuously differentiable, and a
light cable feels a softer plane than a heavy one: a sharper onset makes Newton's method switch nodes on and off for
ever. Measured with 1 m of 0.98 N/m in 40 elements: it sinks by 0.5 to 1.8e-4 of its length. From a start that is far
from the solution solve with a hundredth of the stiffness first. ``normal`` is normalised.
Null: an offset below the cable, or contact_stiffness 0.
"""

from typing import ClassVar

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects._fields import parameter
from scan2flex_jax.rod.effect import AbstractEffect, Node

CONTACT = 1.0e6  # N/m^2: heavy hoses of 50 N/m then sink by less than a millimetre
ROUNDING = 0.04  # of an element: the depth over which contact sets in


class SupportPlane(AbstractEffect):
    """A one-sided plane ``normal . x >= offset`` (m), of ``contact_stiffness`` (N/m^2)."""

    kind: ClassVar[str] = "support_plane"
    normal: Float[Array, "3"] = parameter(3)
    offset: Float[Array, ""] = parameter()
    contact_stiffness: Float[Array, ""] = parameter(default=CONTACT)

    def node_potential(self, node: Node) -> Float[Array, ""]:
        """Energy (J) of the contact of one node."""
        depth = self.offset - self.normal @ node.r / jnp.linalg.norm(self.normal)
        d = ROUNDING * node.ds
        p = jnp.clip(depth, 0.0, d)
        past = jnp.maximum(depth - d, 0.0)
        return node.weight * self.contact_stiffness * (p**3 / (6.0 * d) + 0.5 * past * (past + d))
