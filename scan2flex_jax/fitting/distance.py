"""Distances between a measured centre curve and the modelled one.

The modelled curve is the cubic Hermite curve through the rod's nodes with their tangents d3. Three distances:
*normal*, from each measured point to the closest point of the modelled curve, along its two rotation-minimising normals,
independent of the parametrisation and the ends of the measured curve; *integrated*, the paper's Pi (Eq. 10), at equal arc
length; *Hausdorff*, the largest distance from any point of one curve to the other.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.geometry import curves
from scan2flex_jax.geometry.small import cross

NORMALS = 2  # of the three components of a residual: the first two, across the curve
_WINDOW = 0.25  # of the length: the closest point is searched within this distance of the expected arc length
_REFINEMENTS = 6  # Gauss-Newton steps for the closest point, from the nearest node: converged to rounding


def curve_at(r: Float[Array, "n 3"], d3: Float[Array, "n 3"], ds, s):
    """Point (m) and unit-speed tangent of the Hermite curve at arc length ``s`` (m); linear in ``r`` and ``d3``."""
    i = jnp.clip(jnp.floor(s / ds), 0, r.shape[0] - 2).astype(int)
    t = s / ds - i
    (a, b), (u, v) = (jax.lax.dynamic_slice_in_dim(x, i, 2) for x in (r, d3))
    rest, chord = 1.0 - t, (b - a) / ds
    point = a + ds * (t * t * (3.0 - 2.0 * t) * chord + t * rest * (rest * u - t * v))
    return point, 6.0 * t * rest * chord + rest * (1.0 - 3.0 * t) * u + t * (3.0 * t - 2.0) * v


def closest_arc_length(r, d3, ds, point: Float[Array, "3"], expected: Float[Array, ""]) -> Float[Array, ""]:
    """Arc length (m) of the point of the curve closest to ``point``, near the ``expected`` one."""
    length = ds * (r.shape[0] - 1)
    s = ds * jnp.arange(r.shape[0])
    far = jnp.abs(s - expected) > _WINDOW * length
    s = s[jnp.argmin(jnp.sum((r - point) ** 2, axis=1) + jnp.where(far, 1e3 * length**2, 0.0))]

    def refine(_, s):
        x, slope = curve_at(r, d3, ds, s)
        return jnp.clip(s + (point - x) @ slope / (slope @ slope), 0.0, length)

    return jax.lax.fori_loop(0, _REFINEMENTS, refine, s)


def normal_residuals(r, d3, ds, points: Float[Array, "m 3"], expected: Float[Array, " m"], observe, axes_at=None):
    """``(residual (m, 3), s (m,))``: measured minus modelled (m) along two rotation-minimising normals, and along the
    tangent only where the closest point is an end of the rod.

    Closest points and frames are constant under differentiation; the gradient of the squared distance is still exact, since
    the distance is stationary at the closest point. ``axes_at``: the `held_axes`, if they are known.
    """
    fixed_r, fixed_d3, fixed_ds = jax.lax.stop_gradient((observe(r), d3, ds))
    axes_at = axes_at or held_axes(r, d3, ds, observe)
    length = fixed_ds * (r.shape[0] - 1)

    def one(point, expected):
        s = jax.lax.stop_gradient(closest_arc_length(fixed_r, fixed_d3, fixed_ds, point, expected))
        x, _ = curve_at(r, d3, ds, s * ds / fixed_ds)
        beyond = (s <= 0.0) | (s >= length)
        d = axes_at(s) @ (point - observe(x))
        return d * jnp.array([1.0, 1.0, 1.0]).at[2].set(jnp.where(beyond, 1.0, 0.0)), s

    return jax.vmap(one)(points, expected)


def closest_residuals(r, d3, ds, points: Float[Array, "m 3"], expected: Float[Array, " m"], observe, axes_at=None):
    """``(residual (m, 3), s (m,))``: measured minus modelled (m) at the closest point, whose movement is differentiated.

    Normals and tangent are constant, so that the squared length of each residual has exact first and second derivatives;
    those of `normal_residuals` omit terms of the order of residual times curvature (Gauss-Newton).
    """
    fixed_r, fixed_d3, fixed_ds = jax.lax.stop_gradient((observe(r), d3, ds))
    axes_at = axes_at or held_axes(r, d3, ds, observe)
    length = fixed_ds * (r.shape[0] - 1)

    def one(point, expected):
        s = jax.lax.stop_gradient(closest_arc_length(fixed_r, fixed_d3, fixed_ds, point, expected))

        def off(u):  # at u elements from the start
            return point - observe(curve_at(r, d3, ds, u * ds)[0])

        def slope(u):  # of half the squared distance; zero at the closest point
            d, change = jax.jvp(off, (u,), (jnp.ones(()),))
            return d @ change

        u = s / fixed_ds
        at, curvature = jax.lax.stop_gradient(jax.jvp(slope, (u,), (jnp.ones(()),)))
        inside = (s > 0.0) & (s < length) & (curvature > 0.0)
        u = u - jnp.where(inside, (slope(u) - at) / jnp.where(inside, curvature, 1.0), 0.0)  # implicit function theorem
        return axes_at(s) @ off(u), s

    return jax.vmap(one)(points, expected)


def hausdorff_residuals(r, d3, ds, points: Float[Array, "m 3"], expected: Float[Array, " m"], observe, axes_at=None):
    """Like `normal_residuals`, zero except at the farthest point: its length is the Hausdorff distance (m) from the measured
    curve to the model (directed, since a measured curve may end before the clamps). Not smooth."""
    residual, s = normal_residuals(r, d3, ds, points, expected, observe, axes_at)
    farthest = jnp.argmax(jnp.sum(residual**2, axis=1))
    return residual * (jnp.arange(len(points)) == farthest)[:, None], s


def integrated_residuals(r, d3, ds, points: Float[Array, "m 3"], expected: Float[Array, " m"], observe, axes_at=None):
    """``(residual (m, 3), s (m,))`` at equal arc length, weighted so that the mean square is Pi (paper, Eq. 10).

    Along the two normals and the tangent, as in `normal_residuals`, so that the first two measure the noise in any pose.
    Points that repeat the one before them, such as padding, have zero weight.
    """
    axes_at = axes_at or held_axes(r, d3, ds, observe)

    def one(point, s):
        return axes_at(jax.lax.stop_gradient(s)) @ (point - observe(curve_at(r, d3, ds, s)[0]))

    edges = jnp.concatenate([expected[:1], 0.5 * (expected[1:] + expected[:-1]), expected[-1:]])
    share = jnp.abs(jnp.diff(edges))
    mean = jnp.sum(share) / jnp.maximum(jnp.sum(share > 0), 1)
    return jax.vmap(one)(points, expected) * jnp.sqrt(share / mean)[:, None], expected


def marker_residuals(
    r, d3, ds, points: Float[Array | np.ndarray, "m 3"], at: Float[Array | np.ndarray, " m"], observe, axes_at,
    rows: Float[Array | np.ndarray, "3 3"] | None = None, beside: Float[Array, "m 3"] | float = 0.0,
) -> Float[Array, "m 3"]:  # fmt: skip
    """``residual (m, 3)``: measured minus modelled (m) at known arc lengths ``at`` (m), all three components alike; ``beside``
    (m): from the axis to the marks.

    Along the two normals and the tangent, as in `normal_residuals`; along ``rows`` that are not all zero, where some
    coordinates were measured only.
    """

    def one(point, s, beside):
        axes = axes_at(s) if rows is None else jnp.where(jnp.any(rows != 0.0), rows, axes_at(s))
        return axes @ (point - observe(curve_at(r, d3, ds, s)[0] + beside))

    return jax.vmap(one)(points, at, jnp.broadcast_to(jnp.asarray(beside), jnp.shape(points)))


def held_axes(r, d3, ds, observe):
    """Function of arc length (m) to two rotation-minimising normals and the tangent (rows) of the observed curve there: the
    axes of these residuals, without derivatives."""
    r, d3, ds = jax.lax.stop_gradient((observe(r), d3, ds))
    frames = curves.transported_frames(d3, curves.frame_on(d3[0]))

    def at(s):
        _, t = curve_at(r, d3, ds, s)
        t = t / jnp.linalg.norm(t)
        n1 = frames[jnp.clip(jnp.round(s / ds), 0, r.shape[0] - 1).astype(int), :, 0]
        n1 = n1 - (n1 @ t) * t
        n1 = n1 / jnp.linalg.norm(n1)
        return jax.lax.stop_gradient(jnp.stack([n1, cross(t, n1), t]))

    return at
