"""Rotations SO(3) and rigid motions SE(3): exponential, logarithm and their derivatives.

Symbols: ``w`` rotation vector (rad), ``t = |w|^2``, ``W`` the matrix with ``W x = w x x``; a twist ``x = (v, w)`` has the
translation (m) first; ``g = (r, R)`` is a rigid motion with position ``r`` (m) and rotation ``R`` (columns d1, d2, d3).

A twist is the dual vector ``w + eps v`` and a rigid motion is a dual rotation, so each SE(3) formula is the SO(3) one and
its derivative in the direction ``v``: the 6x6 matrices below are ``[[X, dX[v]], [0, X]]``.

Reference: Sola, Deray, Atchuthan, "A micro Lie theory for state estimation in robotics" (2018), eqs. 143-147, 172-180.
"""

from functools import reduce

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.geometry.small import cross, matmul, vecdot

HATS = np.cross(np.eye(3)[:, None], np.eye(3)[None]).transpose(0, 2, 1)
"""``hat`` of each unit vector; ``hat(w)_ij = HATS_ijk w_k`` in few traced operations."""
_SERIES_BELOW = 0.05  # t = |w|^2 under which six Taylor terms are exact to rounding (remainder t^6/12! < 1e-16)


def _even(t, coefficients, closed):
    """``closed(t)`` for large t, its Taylor polynomial in ``t`` below; the unused branch gets a harmless argument."""
    small = t < _SERIES_BELOW
    ts = jnp.where(small, t, 0.0)
    series = reduce(lambda total, c: total * ts + c, coefficients[::-1])
    return jnp.where(small, series, closed(jnp.where(small, 1.0, t)))


def sinc(t):
    """``sin(a)/a`` with ``t = a^2``."""
    return _even(t, [1, -1 / 6, 1 / 120, -1 / 5040, 1 / 362880, -1 / 39916800], lambda t: jnp.sin(jnp.sqrt(t)) / jnp.sqrt(t))


def versine(t):
    """``(1 - cos a)/a^2`` with ``t = a^2``."""
    series = [1 / 2, -1 / 24, 1 / 720, -1 / 40320, 1 / 3628800, -1 / 479001600]
    return _even(t, series, lambda t: (1.0 - jnp.cos(jnp.sqrt(t))) / t)


def _cubic(t):
    """``(a - sin a)/a^3`` with ``t = a^2``."""
    series = [1 / 6, -1 / 120, 1 / 5040, -1 / 362880, 1 / 39916800, -1 / 6227020800]
    return _even(t, series, lambda t: (1.0 - jnp.sin(jnp.sqrt(t)) / jnp.sqrt(t)) / t)


def _bernoulli(t):
    """``(1 - (a/2) cot(a/2))/a^2`` with ``t = a^2``; its Taylor coefficients are |B_2k|/(2k)!."""
    series = [1 / 12, 1 / 720, 1 / 30240, 1 / 1209600, 1 / 47900160, 691 / 1307674368000]

    def closed(t):
        half = 0.5 * jnp.sqrt(t)
        return (1.0 - half / jnp.tan(half)) / t

    return _even(t, series, closed)


def hat(w: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """Cross-product matrix: ``hat(w) @ x == cross(w, x)``."""
    return jnp.sum(HATS.astype(w.dtype) * w, axis=-1)


def unhat(W: Float[Array, "3 3"]) -> Float[Array, "3"]:
    """The vector of the antisymmetric part of a matrix: ``unhat(hat(w)) == w``."""
    return 0.5 * jnp.sum(HATS.astype(W.dtype) * W[:, :, None], axis=(0, 1))


def so3_exp(w: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """Rotation about ``w`` by ``|w|`` rad (Rodrigues)."""
    t = vecdot(w, w)
    W = hat(w)
    return np.eye(3, dtype=w.dtype) + sinc(t) * W + versine(t) * matmul(W, W)


def so3_log(R: Float[Array, "3 3"]) -> Float[Array, "3"]:
    """Rotation vector of ``R``, for angles below pi (an element of a resolved rod turns by far less)."""
    u = unhat(R)
    sine2 = vecdot(u, u)
    cosine = 0.5 * (jnp.sum(np.eye(3, dtype=R.dtype) * R) - 1.0)
    small = (sine2 < 1e-4) & (cosine > 0)
    series = 1.0 + sine2 * (1 / 6 + sine2 * (3 / 40 + sine2 * (5 / 112 + sine2 * (35 / 1152))))  # asin(x)/x
    sine = jnp.sqrt(jnp.where(small, 1.0, sine2))
    return u * jnp.where(small, series, jnp.arctan2(sine, jnp.where(small, 0.0, cosine)) / sine)


def se3_exp(x: Float[Array, "6"]) -> tuple[Float[Array, "3"], Float[Array, "3 3"]]:
    """Rigid motion ``(r, R)`` reached by following the constant body twist ``x = (v, w)`` for unit time: a helix."""
    v, w = x[:3], x[3:]
    t = vecdot(w, w)
    c = cross(w, v)
    return v + versine(t) * c + _cubic(t) * cross(w, c), so3_exp(w)


def se3_log(r: Float[Array, "3"], R: Float[Array, "3 3"]) -> Float[Array, "6"]:
    """Twist whose helix reaches ``(r, R)`` in unit time; inverse of `se3_exp` for angles below pi."""
    w = so3_log(R)
    c = cross(w, r)
    return jnp.concatenate([r - 0.5 * c + _bernoulli(vecdot(w, w)) * cross(w, c), w])


def adjoint_inverse(r: Float[Array, "3"], R: Float[Array, "3 3"]) -> Float[Array, "6 6"]:
    """``Ad(g^-1)``: carries a body twist through ``g``, ``exp(a) g = g exp(Ad(g^-1) a)``."""
    return jnp.block([[R.T, -matmul(R.T, hat(r))], [jnp.zeros((3, 3), R.dtype), R.T]])


def right_jacobian_inverse(x: Float[Array, "6"]) -> Float[Array, "6 6"]:
    """``T`` with ``log(exp(x) exp(c)) = x + T c + O(c^2)``; with ``-x`` it is the left one."""
    v, w = x[:3], x[3:]
    t = vecdot(w, w)
    V, W = hat(v), hat(w)
    g, dg = _bernoulli(t), _bernoulli_slope(t)
    WW = matmul(W, W)
    rotation = np.eye(3, dtype=x.dtype) + 0.5 * W + g * WW
    derivative = 0.5 * V + g * (matmul(V, W) + matmul(W, V)) + 2.0 * dg * vecdot(w, v) * WW
    return jnp.block([[rotation, derivative], [jnp.zeros((3, 3), x.dtype), rotation]])


def right_jacobian_inverse_slope(x: Float[Array, "6"], m: Float[Array, "6"]) -> Float[Array, "6 6"]:
    """Derivative of ``T(x)' m`` with respect to ``x``, for a fixed wrench ``m = (force, moment)``.

    Six tangents through `right_jacobian_inverse` give the same, but XLA then recomputes most of it for every entry.
    """
    v, w = x[:3], x[3:]

    def rotational(w, f):  # of f + 1/2 f x w + g w x (w x f)
        t, along = vecdot(w, w), vecdot(w, f)
        turned = 0.5 * hat(f) + _bernoulli(t) * (along * np.eye(3, dtype=w.dtype) + jnp.outer(w, f) - 2.0 * jnp.outer(f, w))
        return turned + 2.0 * _bernoulli_slope(t) * jnp.outer(along * w - t * f, w)

    slope, change = jax.jvp(lambda w: rotational(w, m[:3]), (w,), (v,))
    return jnp.block([[jnp.zeros((3, 3), x.dtype), slope], [slope, change + rotational(w, m[3:])]])


def _bernoulli_slope(t):
    """Derivative of `_bernoulli` with respect to ``t``."""
    series = [1 / 720, 2 / 30240, 3 / 1209600, 4 / 47900160, 5 * 691 / 1307674368000, 6 / 74724249600]

    def closed(t):
        half = 0.5 * jnp.sqrt(t)
        cot = 1.0 / jnp.tan(half)
        return (0.125 * t * (1.0 + cot**2 - cot / half) - (1.0 - half * cot)) / t**2

    return _even(t, series, closed)


def bracket_matrix(p: Float[Array, "6"]) -> Float[Array, "6 6"]:
    """``M`` with ``a^T M b = p . [a, b]``, the Lie bracket of twists paired with the wrench ``p = (force, moment)``."""
    F, M = hat(p[:3]), hat(p[3:])
    return jnp.block([[jnp.zeros((3, 3), p.dtype), -F], [-F, -M]])
