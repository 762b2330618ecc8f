"""Clamp rotation: a clamp is turned from where it is said to be, in the same way in every pose.

``rotation`` (rad) is one rotation vector per end, in the clamp's own frame: ``R exp(hat(rotation))``. Its third entry
is a roll about the tangent. Ends that hold no rotation do not feel it. Null: 0. An offset of the same clamp
(`clamp_offset`) is taken in the nominal frame, so it must act before (`effects.ordered`).
"""

from typing import ClassVar

import equinox as eqx
import jax
from jax import Array
from jaxtyping import Float

from scan2flex_jax.effects._fields import parameter
from scan2flex_jax.geometry import lie
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.effect import AbstractEffect


class ClampRotation(AbstractEffect):
    """Rotation vectors ``rotation`` (rad) of start and end clamp."""

    kind: ClassVar[str] = "clamp_rotation"
    rank: ClassVar[int] = 1
    rotation: Float[Array, "2 3"] = parameter(2, 3)

    def clamps(self, boundary: Boundary) -> Boundary:
        """The clamps turned."""
        return eqx.tree_at(lambda b: b.rotation, boundary, boundary.rotation @ jax.vmap(lie.so3_exp)(self.rotation))
