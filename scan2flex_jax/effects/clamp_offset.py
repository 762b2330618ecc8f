"""Clamp offset: a clamp is shifted from where it is said to be, in the same way in every pose.

``offset`` (m) is one vector per end, in the frame of the nominal clamp: ``r + R offset``, before any `clamp_rotation`
(`effects.ordered`). An end without a clamp has the entry 0. Null: 0.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects._fields import parameter
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.effect import AbstractEffect


class ClampOffset(AbstractEffect):
    """Shifts ``offset`` (m) of start and end clamp."""

    kind: ClassVar[str] = "clamp_offset"
    offset: Float[Array, "2 3"] = parameter(2, 3)

    def clamps(self, boundary: Boundary) -> Boundary:
        """The clamps shifted."""
        shift = jnp.einsum("eij,ej->ei", boundary.rotation, self.offset)
        return eqx.tree_at(lambda b: b.position, boundary, boundary.position + shift)
