"""The spline through K guide points, parametrised as in the paper: point k at parameter k, tangents at half-knots.

The paper writes a curve on ``[0, K]`` with tangents ``v_k = curve'(k - 1/2)`` and sums cosines of neighbours over
``k = 2..K-1``, divided by ``K - 2``. That count corresponds to K points at the unit-spaced parameters ``0, 1, .., K-1``: K-1
segments, one tangent in the middle of each. Unit spacing makes the speed ``|curve'|`` the arc length per segment, which
the penalty E_2 keeps even.

The curve is linear in the points: ``curve(t) = sum_k W_k(t) x_k`` with cardinal cubic splines W_k (not-a-knot ends), whose
polynomial coefficients scipy gives once per K. Evaluation is plain `jax.numpy`, differentiable in the points and in t.

Symbols: ``x`` (K, 3) points (m); ``t`` parameter (-); ``c`` (4, K-1, 3) polynomial coefficients, highest power first.
"""

from functools import lru_cache, partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from scan2flex_jax.geometry import curves

_PER_SEGMENT = 4  # samples of a segment in the search for the nearest point
_NEWTON_STEPS = 4
arc_length = partial(curves.arc_length, xp=np)  # (n,) of a polyline (n, 3)


@lru_cache(maxsize=32)
def cardinal(count: int) -> Float[np.ndarray, "4 segments count"]:
    """Polynomial coefficients of the ``count`` cardinal splines on every unit segment."""
    return CubicSpline(np.arange(count), np.eye(count), bc_type="not-a-knot").c


@lru_cache(maxsize=32)
def roughness(count: int) -> Float[np.ndarray, "count count"]:
    """``M`` with ``x^T M x = int |curve'''|^2 dt``: the rate of change of curvature, at unit spacing."""
    third = 6.0 * cardinal(count)[0]
    return third.T @ third


@jax.jit
def coefficients(x: Float[Array, "K 3"]) -> Float[Array, "4 segments 3"]:
    """Polynomials of the spline through ``x``."""
    return jnp.einsum("psk,kd->psd", cardinal(x.shape[0]), x)


def _split(t, segments):
    """Segment number of ``t`` and the offset inside it (the outer polynomials extrapolate)."""
    k = jnp.clip(jnp.floor(t).astype(int), 0, segments - 1)
    return k, t - k


@partial(jax.jit, static_argnames="order")
def evaluate(c: Float[Array, "4 segments 3"], t: Float[Array, "*n"], order: int = 0) -> Float[Array, "*n 3"]:
    """Position (order 0) or derivative (order 1, 2) of the curve at ``t``, in m per parameter unit."""
    k, u = _split(t, c.shape[1])
    a, b, d, e = (c[p][k] for p in range(4))
    u = u[..., None]
    if order == 0:
        return ((a * u + b) * u + d) * u + e
    return (3.0 * a * u + 2.0 * b) * u + d if order == 1 else 6.0 * a * u + 2.0 * b


@partial(jax.jit, static_argnums=0)
def weights(count: int, t: Float[Array, " n"]) -> Float[Array, "n K"]:
    """``W_k(t)``: the derivative of the curve with respect to its points."""
    k, u = _split(t, count - 1)
    powers = jnp.stack([u**3, u**2, u, jnp.ones_like(u)])
    table = jnp.asarray(cardinal(count))
    return jnp.asarray(sum(powers[p][:, None] * table[p][k] for p in range(4)))


def half_knot_tangents(c: Float[Array, "4 segments 3"]) -> Float[Array, "segments 3"]:
    """The paper's ``v_k = curve'(k - 1/2)`` (m)."""
    return 0.75 * c[0] + c[1] + c[2]


@jax.jit
def nearest(c: Float[Array, "4 segments 3"], p: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """Parameter of the curve's nearest point to each ``p``: the best of many samples, then safeguarded Newton steps.

    A constant in the derivative of a distance: at the nearest point the distance is stationary in t (envelope theorem), so its
    gradient with respect to the curve's points is exact.
    """
    c, p = jax.lax.stop_gradient((c, p))
    segments = c.shape[1]
    grid = jnp.linspace(0.0, segments, _PER_SEGMENT * segments + 1)
    q = evaluate(c, grid)
    t = grid[jnp.argmin(jnp.sum(q**2, axis=1) - 2.0 * p @ q.T, axis=1)]
    low, high = jnp.clip(t - 1.0 / _PER_SEGMENT, 0.0), jnp.clip(t + 1.0 / _PER_SEGMENT, max=float(segments))

    def newton(_, t):
        off, v, a = p - evaluate(c, t), evaluate(c, t, 1), evaluate(c, t, 2)
        speed = jnp.sum(v * v, axis=-1)
        bend = jnp.maximum(speed - jnp.sum(off * a, axis=-1), 0.25 * speed)
        return jnp.clip(t + jnp.sum(off * v, axis=-1) / bend, low, high)

    return jax.lax.fori_loop(0, _NEWTON_STEPS, newton, t)


def distances(c: Float[Array, "4 segments 3"], p: Float[Array, "n 3"]) -> Float[Array, " n"]:
    """Distance (m) of each point to the curve; zero distance has zero gradient."""
    square = jnp.sum((p - evaluate(c, nearest(c, p))) ** 2, axis=1)
    zero = square == 0.0
    return jnp.where(zero, 0.0, jnp.sqrt(jnp.where(zero, 1.0, square)))


def length(x: Float[np.ndarray, "n 3"]) -> float:
    """Length (m) of a polyline."""
    return float(arc_length(x)[-1])


def unit(v: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """The vectors at unit length; zero stays zero."""
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-12)


def tangents(x: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Unit tangents at the points of a polyline, by central differences."""
    return unit(np.gradient(x, axis=0))


def extended(x: Float[np.ndarray, "n 3"], by: int) -> Float[np.ndarray, "m 3"]:
    """The curve continued by ``by`` points at both ends, its own turned about the end, so that a filter keeps the ends."""
    return np.pad(x, ((by, by), (0, 0)), "reflect", reflect_type="odd")


def evenly(x: Float[np.ndarray, "n 3"], count: int) -> Float[np.ndarray, "count 3"]:
    """``count`` points at equal arc length on the spline through ``x`` (chord-length parametrised), ends kept."""
    chord = np.linalg.norm(np.diff(x, axis=0), axis=1)
    keep = np.concatenate([[True], chord > 1e-9 * chord.sum()])
    s = np.cumsum(np.concatenate([[0.0], chord[keep[1:]]]))
    spline = CubicSpline(s, x[keep]) if len(s) > 3 else (lambda a: np.column_stack([np.interp(a, s, y) for y in x[keep].T]))
    fine = spline(np.linspace(0.0, s[-1], 20 * count + 1))
    return along(fine, count)


def along(x: Float[np.ndarray, "n 3"], count: int) -> Float[np.ndarray, "count 3"]:
    """``count`` points at equal arc length on a polyline, ends kept."""
    s = arc_length(x)
    return np.column_stack([np.interp(np.linspace(0.0, s[-1], count), s, y) for y in x.T])
