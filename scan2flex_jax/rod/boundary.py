"""Supports of the two ends: clamps in SE(3), ball joints, free ends, and the frame of a clamp from its quaternion.

A support holds some of the six motions of its end section: three translations and three rotations, in the section's own
axes. Quaternions are unit, scalar first ``[w, x, y, z]``, and turn material vectors into the scan frame.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.rod.reals import reals

_ORTHONORMAL = 1.0e-3  # of the entries of R R' - 1: the error of four written digits
CLAMP, BALL, FREE = (1.0,) * 6, (1.0,) * 3 + (0.0,) * 3, (0.0,) * 6


def rotation_of_quaternion(q: Float[Array | np.ndarray, "4"]):
    """Rotation matrix (3, 3) of a quaternion ``[w, x, y, z]``, normalised first; numpy in, numpy out."""
    xp = np if isinstance(q, np.ndarray) else jnp
    w, x, y, z = q / xp.linalg.norm(q)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return xp.stack([xp.stack(row) for row in rows])


class Boundary(eqx.Module):
    """The start (index 0) and the end (index 1) of the cable.

    ``position`` m; ``rotation`` with columns d1, d2, d3 (the tangent, pointing to growing arc length); ``held`` is 1 for a
    motion that the support prevents and 0 for a free one, translations first. Position and rotation of a free motion serve
    only as a start.
    """

    position: Float[Array, "2 3"]
    rotation: Float[Array, "2 3 3"]
    held: Float[Array, "2 6"]

    @staticmethod
    def of(start, end=None) -> "Boundary":
        """From ``(position, rotation)`` pairs.

        Args:
            start: Position (3,) in m, and rotation: a matrix (3, 3) with columns d1, d2, d3, a quaternion [w, x, y, z], or None
                for a ball joint; None is a free start.
            end: The same.

        Returns:
            Both supports.

        Raises:
            Scan2FlexError: A position or rotation that is not one.

        Examples:
            >>> Boundary.of(([0, 0, 0], [1, 0, 0, 0])).held.tolist()[1]
            [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        """
        p, R, h = zip(*[_support(x) for x in (start, end)], strict=True)
        plain = all(isinstance(x, np.ndarray) for x in (*p, *R))
        xp = np if plain else jnp
        return Boundary(*(jnp.asarray(x) for x in (xp.stack(p), xp.stack(R), np.array(h))))


def _support(pair):
    if pair is None:
        return np.zeros(3), np.eye(3), FREE
    position, rotation = pair
    position = reals(position, "Boundary: a position", (3,))
    if rotation is None:
        return position, np.eye(3), BALL
    rotation = reals(rotation, "Boundary: a rotation", (4,), (3, 3))
    if not isinstance(rotation, jax.core.Tracer):
        _check_rotation(np.asarray(rotation))
    return position, rotation_of_quaternion(rotation) if rotation.shape == (4,) else rotation, CLAMP


def _check_rotation(rotation):
    if rotation.shape == (4,):
        if not 0.0 < np.linalg.norm(rotation) < np.inf:
            raise Scan2FlexError(f"Boundary: the quaternion {rotation.tolist()} is no rotation: give [w, x, y, z].")
    elif not (np.allclose(rotation @ rotation.T, np.eye(3), atol=_ORTHONORMAL) and np.linalg.det(rotation) > 0.0):
        raise Scan2FlexError("Boundary: a 3x3 matrix is no rotation: its columns d1, d2, d3 must be unit and right-handed.")
