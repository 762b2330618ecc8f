"""Space curves given by points: arc length, resampling, tangents and rotation-minimising frames.

A rotation-minimising frame has no rotation about the tangent. Its discrete form carries it from node to node by the
smallest rotation between neighbouring tangents (Bishop 1975; error of second order in the spacing).
"""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.geometry.lie import hat
from scan2flex_jax.geometry.small import cross, matmul, vecdot


def arc_length(points: Float[Array | np.ndarray, "n 3"], xp: Any = jnp) -> Float[Array | np.ndarray, " n"]:
    """Length of the polygon from the first point to each point (m), in the array namespace ``xp``."""
    steps = xp.linalg.norm(xp.diff(points, axis=0), axis=1)
    return xp.concatenate([xp.zeros(1), xp.cumsum(steps)])


def resample(points: Float[Array, "n 3"], count: int) -> Float[Array, "count 3"]:
    """``count`` points equally spaced along the polygon, its ends included."""
    s = arc_length(points)
    at = jnp.linspace(0.0, 1.0, count) * s[-1]
    return jnp.stack([jnp.interp(at, s, points[:, k]) for k in range(3)], axis=1)


def tangents(points: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    """Unit tangents by central differences, one-sided at the ends."""
    inner = points[2:] - points[:-2]
    t = jnp.concatenate([points[1:2] - points[:1], inner, points[-1:] - points[-2:-1]])
    return t / jnp.linalg.norm(t, axis=1, keepdims=True)


def smallest_rotation(a: Float[Array, "3"], b: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """Rotation of unit ``a`` to unit ``b`` about their common normal (for opposite vectors: about some normal)."""
    v, c = cross(a, b), vecdot(a, b)
    V = hat(v)
    opposite = c < -1.0 + 1e-9
    turn = np.eye(3) + V + matmul(V, V) / jnp.where(opposite, 1.0, 1.0 + c)
    normal = cross(a, jnp.eye(3)[jnp.argmin(jnp.abs(a))])
    normal = normal / jnp.linalg.norm(normal)
    return jnp.where(opposite, 2.0 * jnp.outer(normal, normal) - np.eye(3), turn)


def transported_frames(tangent: Float[Array, "n 3"], first: Float[Array, "3 3"]) -> Float[Array, "n 3 3"]:
    """Rotation-minimising frames along unit tangents, starting from ``first`` turned onto the first tangent."""
    first = matmul(smallest_rotation(first[:, 2], tangent[0]), first)

    def carry(R, pair):
        R = matmul(smallest_rotation(*pair), R)
        return R, R

    _, rest = jax.lax.scan(carry, first, (tangent[:-1], tangent[1:]))
    return jnp.concatenate([first[None], rest])


def frame_on(tangent: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """A frame with this unit tangent as d3, otherwise arbitrary."""
    return smallest_rotation(jnp.array([0.0, 0.0, 1.0]), tangent)


def turned_about_tangent(frames: Float[Array, "n 3 3"], angle: Float[Array, " n"]) -> Float[Array, "n 3 3"]:
    """Frames turned by ``angle`` (rad) about their own d3."""
    c, s = jnp.cos(angle)[:, None], jnp.sin(angle)[:, None]
    d1, d2, d3 = frames[:, :, 0], frames[:, :, 1], frames[:, :, 2]
    return jnp.stack([c * d1 + s * d2, c * d2 - s * d1, d3], axis=2)
