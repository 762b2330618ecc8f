"""Unit quaternions for the blind generator: scalar first `[w, x, y, z]`, turning material vectors into the world.

`R(q) v = (w^2 - |u|^2) v + 2 (u . v) u + 2 w u x v` with `u = (x, y, z)`: the homogeneous form, polynomial in `q`, so
that its derivative is exact and complex steps (`f(x + i h)`) pass through. All functions take stacks of leading axes.
"""

import numpy as np


def product(a, b):
    """`a b`: first turn by `b`, then by `a`."""
    w = a[..., 0] * b[..., 0] - dot(a[..., 1:], b[..., 1:])
    u = a[..., :1] * b[..., 1:] + b[..., :1] * a[..., 1:] + cross(a[..., 1:], b[..., 1:])
    return np.concatenate([w[..., None], u], axis=-1)


def conjugate(q):
    return np.concatenate([q[..., :1], -q[..., 1:]], axis=-1)


def dot(a, b):
    return (a * b).sum(-1)


def cross(a, b):
    """The cross product, many times faster than numpy's on long stacks."""
    x = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    y = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    z = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return np.stack([x, y, z], axis=-1)


def skew(v):
    """The matrix of `v x`."""
    S = np.zeros((*v.shape, 3), v.dtype)
    S[..., 0, 1], S[..., 0, 2], S[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    S[..., 1, 0], S[..., 2, 0], S[..., 2, 1] = v[..., 2], -v[..., 1], v[..., 0]
    return S


def rotate(q, v):
    """`R(q) v`: material components into the world."""
    w, u = q[..., :1], q[..., 1:]
    return (w * w - dot(u, u)[..., None]) * v + 2 * dot(u, v)[..., None] * u + 2 * w * cross(u, v)


def unrotate(q, v):
    """`R(q)^T v`: world components into the material frame."""
    return rotate(conjugate(q), v)


def d_rotate(q, v):
    """The 3 x 4 derivative of `R(q) v` by `q`."""
    w, u = q[..., :1], q[..., 1:]
    by_w = 2 * w * v + 2 * cross(u, v)
    outer = u[..., :, None] * v[..., None, :]
    by_u = 2 * outer - 2 * np.swapaxes(outer, -1, -2) - 2 * w[..., None] * skew(v)
    by_u = by_u + 2 * dot(u, v)[..., None, None] * np.eye(3)
    return np.concatenate([by_w[..., None], by_u], axis=-1)


def d_unrotate(q, v):
    """The 3 x 4 derivative of `R(q)^T v` by `q`."""
    D = d_rotate(conjugate(q), v)
    D[..., 1:] *= -1
    return D


def left(q):
    """The 4 x 3 matrix with `q (0, k) = left(q) k`."""
    top = -q[..., None, 1:]
    return np.concatenate([top, q[..., :1, None] * np.eye(3) + skew(q[..., 1:])], axis=-2)


def right(k):
    """The 4 x 4 matrix with `q (0, k) = right(k) q`."""
    zero = np.zeros((*k.shape[:-1], 1, 1), k.dtype)
    top = np.concatenate([zero, -k[..., None, :]], axis=-1)
    return np.concatenate([top, np.concatenate([k[..., :, None], -skew(k)], axis=-1)], axis=-2)


def spin(q):
    """The 4 x 3 matrix that turns a small world rotation into the change of `q`: `(0, theta) q / 2`."""
    top = -q[..., None, 1:]
    return 0.5 * np.concatenate([top, q[..., :1, None] * np.eye(3) - skew(q[..., 1:])], axis=-2)


def exp(v):
    """The quaternion of the rotation vector `v` (power series of even functions, |v| below a turn)."""
    x = dot(v, v) / 4
    c, s, term = 1.0, 1.0, 1.0
    for k in range(1, 14):
        term = term * (-x) / ((2 * k - 1) * (2 * k))
        c, s = c + term, s + term / (2 * k + 1)
    return np.concatenate([(c + 0 * x)[..., None], 0.5 * (s + 0 * x)[..., None] * v], axis=-1)


def log_small(q):
    """The rotation vector of `q` for turns up to about 1 rad, by the series of arcsin (complex steps pass through)."""
    u = q[..., 1:] * np.where(q[..., :1].real < 0, -1.0, 1.0)
    x = dot(u, u)
    total, term = 1.0, 1.0
    for k in range(1, 24):
        term = term * x * (2 * k - 1) / (2 * k)
        total = total + term / (2 * k + 1)
    return 2 * total[..., None] * u


def between(a, b):
    """The least rotation that carries the unit vector `a` to the unit vector `b`."""
    q = np.concatenate([[1 + a @ b], np.cross(a, b)])
    return q / np.linalg.norm(q)


def roll(angle):
    """A turn about the cable's own tangent `d3`, in the material frame."""
    return np.array([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)])


def slerp(a, b, t):
    """From `a` (t = 0) to `b` (t = 1) on the shorter way."""
    c = a @ b
    b, c = (b, c) if c >= 0 else (-b, -c)
    w = np.arccos(min(c, 1.0))
    if w < 1e-9:
        return a
    return (np.sin((1 - t) * w) * a + np.sin(t * w) * b) / np.sin(w)
