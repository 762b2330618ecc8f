"""Rotations for the reference solutions, all batched over leading axes.

A rotation is a 3x3 matrix whose columns are the directors (d1, d2, d3), d3 along the tangent of an unsheared rod, or a
quaternion (w, x, y, z), scalar first. A rotation vector phi has the length of the angle (rad) and the direction of the
axis.

Source: J. Sola, J. Deray, D. Atchuthan, "A micro Lie theory for state estimation in robotics" (2018), appendix B.
"""

import numpy as np

SMALL_ANGLE = 1e-4  # rad; below it the series below are exact to rounding
_PAIRS = ((2, 1), (0, 2), (1, 0))


def hat(a):
    """Skew matrices (..., 3, 3) of vectors (..., 3): hat(a) @ b = a x b."""
    a = np.asarray(a, float)
    zero = np.zeros(a.shape[:-1])
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    rows = [zero, -z, y, z, zero, -x, -y, x, zero]
    return np.stack(rows, axis=-1).reshape((*a.shape[:-1], 3, 3))


def exp(phi):
    """Rotation matrices (..., 3, 3) of rotation vectors (..., 3) (rad), Rodrigues' formula."""
    phi = np.asarray(phi, float)
    angle = np.linalg.norm(phi, axis=-1)[..., None, None]
    W = hat(phi)
    half = np.sinc(angle / (2 * np.pi))  # sin(angle/2) / (angle/2), smooth at zero
    return np.eye(3) + np.sinc(angle / np.pi) * W + 0.5 * half**2 * (W @ W)


def log(R):
    """Rotation vectors (..., 3) in rad of matrices (..., 3, 3), for angles below pi."""
    axis_sin = np.stack([R[..., i, j] - R[..., j, i] for i, j in _PAIRS], axis=-1) / 2
    sine = np.linalg.norm(axis_sin, axis=-1)
    angle = np.arctan2(sine, (np.trace(R, axis1=-2, axis2=-1) - 1) / 2)
    small = angle < SMALL_ANGLE
    factor = np.where(small, 1 + angle**2 / 6, angle / np.where(small, 1.0, sine))
    return factor[..., None] * axis_sin


def about(axis, angle):
    """Rotation (3, 3) by `angle` (rad), right-handed, about the unit vector `axis`."""
    return exp(angle * np.asarray(axis, float))


def quaternion(R):
    """Unit quaternion (4,), scalar first, of one matrix (3, 3); any angle, pi included (Bar-Itzhack 2000)."""
    trace = np.trace(R)
    anti = np.array([R[i, j] - R[j, i] for i, j in _PAIRS])
    form = np.block([[np.full((1, 1), trace), anti[None]], [anti[:, None], R + R.T - trace * np.eye(3)]])
    return np.linalg.eigh(form)[1][:, -1]


def matrix(q):
    """Rotation matrix with components leading, (3, 3, ...), of quaternions (4, ...); any length of q does."""
    w, x, y, z = q / np.sqrt(np.sum(q * q, axis=0))
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def multiply(p, q):
    """Quaternion product with components leading, (4, ...)."""
    scalar = p[0] * q[0] - np.einsum("i...,i...->...", p[1:], q[1:])
    vector = p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:], axis=0)
    return np.concatenate([scalar[None], vector])
