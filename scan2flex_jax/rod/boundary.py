"""Supports of the two ends: clamps in SE(3), ball joints, free ends.

A support holds some of the six motions of its end section: three translations and three rotations, in the section's own
axes. Quaternions are unit, scalar first ``[w, x, y, z]``, and turn material vectors into the scan frame.
"""

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jaxtyping import Float

CLAMP, BALL, FREE = (1.0,) * 6, (1.0,) * 3 + (0.0,) * 3, (0.0,) * 6


def rotation_of_quaternion(q: Float[Array, "4"]) -> Float[Array, "3 3"]:
    """Rotation matrix of a quaternion ``[w, x, y, z]``, normalised first."""
    w, x, y, z = q / jnp.linalg.norm(q)
    return jnp.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


class Boundary(eqx.Module):
    """The start (index 0) and the end (index 1) of the cable.

    ``position`` m; ``rotation`` with columns d1, d2, d3 (the tangent, pointing to growing arc length); ``held`` is 1 for a
    motion that the support prevents and 0 for a free one, translations first. Values at unheld motions are only where a
    start may begin.
    """

    position: Float[Array, "2 3"]
    rotation: Float[Array, "2 3 3"]
    held: Float[Array, "2 6"]

    @staticmethod
    def of(start, end=None) -> "Boundary":
        """From ``(position, rotation)`` pairs; ``rotation`` is a matrix, a quaternion or None (ball joint); no end = free."""
        p, R, h = zip(*[_support(x) for x in (start, end)], strict=True)
        return Boundary(jnp.stack(p), jnp.stack(R), jnp.array(h))


def _support(pair):
    if pair is None:
        return jnp.zeros(3), jnp.eye(3), FREE
    position, rotation = pair
    position = jnp.asarray(position, float)
    if rotation is None:
        return position, jnp.eye(3), BALL
    rotation = jnp.asarray(rotation, float)
    return position, rotation_of_quaternion(rotation) if rotation.shape == (4,) else rotation, CLAMP
