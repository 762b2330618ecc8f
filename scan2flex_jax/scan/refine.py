"""The last stage: the most probable smooth curve whose surface the points lie on, and how sure it is.

Unknowns are K points of the spline at even arc length, more than the data need; how smooth the curve is, the data decide.
Minimised is

    sum_i w_i e_i^2 / sigma^2 + lambda int |curve'''|^2 dt

with ``e_i`` the distance of point i from the surface of radius r around the curve, ``w_i`` Tukey's weights against
outliers, sigma from the residuals (median absolute deviation), and lambda by maximum marginal likelihood (Fellner-Schall
update). Where there is a gap the second term alone speaks, and the standard deviation grows. Points may slide along the
curve freely; each step is damped in that direction only, then the points are spaced evenly again.

Two forms of ``e_i``:
* *radial*, ``|p_i - curve| - r``: right while the noise is well below r;
* *along the ray*, when the noise is not (beyond 0.25 r) and the viewpoint is known: the depth at which the ray through
  p_i should have met the tube of radius r. It is linear in the noise, so a point thrown behind the axis does no harm,
  where the radial form would push the curve away from the sensor.

A third form serves a handful of points set by hand (`marks`): all three coordinates of ``p_i - curve(t_i)``.

Symbols: r radius, sigma noise of a point, std: m; t spline parameter; ``n`` gradient of e_i with respect to curve(t_i).
Reference: Wood, Fasiolo, "A generalized Fellner-Schall method" (2017).
"""

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from scan2flex_jax.scan import spline

KNOTS = 40
_ITERATIONS = 40
_RAY_FROM = 5  # iteration at which the kind of residual is chosen
_LEAST = 1e-3  # of r: smaller residuals are rounding of the scanner
_SETTLED = 0.1  # of sigma: a smaller step of any spline point, sliding included, ends the iteration
_WIDE, _NARROWING = 3.0, 0.7  # radii within which a point has a say at first, and how that shrinks per iteration
_TUKEY = 4.0  # standard deviations beyond which a point has no say
RAY_ABOVE = 0.25  # of r: noise above this is judged along the ray
_SILHOUETTE = 0.9  # of r: beyond this the depth of the surface changes too fast to tell anything
_STIFF_START = 3.0  # share of the data's weight given to smoothness at the start
_SLIDE = 1.0  # damping along the curve, in mean weights of a point of the spline


@dataclass(frozen=True)
class Refined:
    """Spline points (m), their covariance (m^2), noise (m), and per cloud point: parameter, radial residual (m), weight."""

    points: Float[np.ndarray, "K 3"]
    covariance: Float[np.ndarray, "K3 K3"]
    sigma: float
    parameter: Float[np.ndarray, " n"]
    residual: Float[np.ndarray, " n"]
    weight: Float[np.ndarray, " n"]
    settled: bool
    along_ray: bool


def _radial(q, tangent, p, eye, r):
    """Distance (m) of a point from the surface around the curve point ``q``."""
    off = p - q
    return jnp.sqrt(jnp.sum(off**2) + 1e-24) - r


def _along_ray(q, tangent, p, eye, r):
    """How far (m) behind the expected surface point the measured one lies on its ray."""
    ray = p - eye
    ray = ray / jnp.linalg.norm(ray)
    across = ray - (ray @ tangent) * tangent
    steep = jnp.sqrt(jnp.sum(across**2) + 1e-12)
    across = across / steep
    off = p - q - ((p - q) @ tangent) * tangent
    depth = off @ across
    side2 = jnp.minimum(jnp.sum(off**2) - depth**2, (_SILHOUETTE * r) ** 2)
    return (depth + jnp.sqrt(r**2 - side2)) / steep


def _side(q, tangent, p, eye):
    """Distance (m) of the ray from the axis, sideways."""
    ray = p - eye
    side = jnp.cross(tangent, ray)
    return (p - q) @ side / (jnp.linalg.norm(side) + 1e-12)


@eqx.filter_jit
def _linearised(x, points, real, eyes, r, sigma, form: str):
    """Residuals of all points at the curve through ``x``, their gradients, parameters, and spline weights W."""
    c = spline.coefficients(x)
    t = spline.nearest(c, points)
    q, v = spline.evaluate(c, t), spline.evaluate(c, t, 1)
    tangent = v / jnp.linalg.norm(v, axis=1, keepdims=True)
    radial = jax.vmap(_radial, (0, 0, 0, None, None))(q, tangent, points, eyes[0], r)
    if form == "mark":
        e, n = (points - q).T, jnp.broadcast_to(-jnp.eye(3)[:, None], (3, *q.shape))
        share = jnp.ones(e.shape)
    elif form == "radial":
        e, n = jax.vmap(jax.value_and_grad(_radial), (0, 0, 0, None, None))(q, tangent, points, eyes[0], r)
        share = jnp.ones((1, points.shape[0]))
        e, n = e[None], n[None]
    else:
        one = jax.vmap(jax.value_and_grad(_along_ray), (0, 0, 0, None, None))
        e, n = jax.vmap(one, (None, None, None, 0, None))(q, tangent, points, eyes, r)
        side = jax.vmap(jax.vmap(_side, (0, 0, 0, None)), (None, None, None, 0))(q, tangent, points, eyes)
        likely = jnp.exp(-0.5 * jnp.minimum((e / sigma) ** 2, 50.0)) * (jnp.abs(side) < 1.3 * r)
        share = likely / (jnp.sum(likely, axis=0) + 1e-12)
    return e, n, share * real, t, radial, spline.weights(x.shape[0], t)


def _step(x, e, n, w, W, rough, stiff):
    """Gauss-Newton step with smoothness ``stiff`` and damping along the curve; its covariance; traces for lambda."""
    K = len(x)
    H, g = np.zeros((3 * K, 3 * K)), np.zeros(3 * K)
    for ev, nv, wv in zip(e, n, w, strict=True):
        J = (W[:, :, None] * nv[:, None, :]).reshape(-1, 3 * K)
        Jw = J * wv[:, None]
        H += Jw.T @ J
        g += Jw.T @ ev
    S = np.kron(rough, np.eye(3))
    tau = np.gradient(x, axis=0)
    tau /= np.linalg.norm(tau, axis=1, keepdims=True)
    scale = np.trace(H) / (3 * K)
    held = H + stiff * S + 1e-9 * scale * np.eye(3 * K)
    for k in range(K):
        held[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] += _SLIDE * scale * np.outer(tau[k], tau[k])
    cov = np.linalg.inv(held)
    dx = -cov @ (g + stiff * (S @ x.ravel()))
    dx = dx.reshape(K, 3)
    return dx, cov, np.sum(cov * S), x.ravel() @ S @ x.ravel()


def _spread(e, w) -> float:
    """Standard deviation of residuals by the median absolute deviation about zero, over points with a say."""
    e = np.abs(e[w > 0])
    return float(1.4826 * np.median(e)) if len(e) else np.inf


def refine(x, points, real, radius: float, eyes=None, noise: float | None = None, marks: bool = False) -> Refined:
    """The smooth curve (through K points near ``x``) that explains the points; ``eyes`` are viewpoints (m), if known.

    ``marks``: the points are few and were set by hand on the cable: they are the axis but for noise.
    """
    x, real_host = np.array(x), np.asarray(real)
    rough, rank = spline.roughness(len(x)), 3 * (len(x) - 3)
    looks = jnp.asarray(eyes) if eyes is not None else jnp.zeros((1, 3))
    form, stiff, settled = "mark" if marks else "radial", None, False
    sigma = noise or 0.3 * radius
    cut = 2.0 * radius + 2.0 * sigma
    for k in range(_ITERATIONS):
        out = _linearised(jnp.asarray(x), points, real, looks, jnp.asarray(radius), jnp.asarray(sigma), form)
        e, n, share, t, radial, W = (np.asarray(a) for a in out)
        sigma = max(_spread(e, (np.abs(e) < cut) & (share > 0.2)), _LEAST * radius)
        sigma = noise if marks and noise else sigma  # a handful of residuals cannot tell the noise from the shape
        wide = _WIDE * radius * _NARROWING**k
        cut = max(_TUKEY * sigma, wide)
        w = np.where(np.abs(e) < cut, (1.0 - (e / cut) ** 2) ** 2, 0.0) * share / sigma**2
        w = np.where(_inner(t, len(x)), w, 0.0)
        if stiff is None:
            stiff = _STIFF_START * np.sum(w) / len(x)
        dx, cov, leverage, bend = _step(x, e, n, w, W, rough, stiff)
        wanted = max(rank - stiff * leverage, 1e-3) / max(bend, 1e-300)
        stiff = float(np.clip(wanted, stiff / 10.0, stiff * 10.0))
        size = np.linalg.norm(dx, axis=1).max()
        x = spline.evenly(x + dx * min(1.0, 0.7 * radius / max(size, 1e-300)), len(x))
        if eyes is not None and form == "radial" and k == _RAY_FROM and max(noise or 0.0, sigma) > RAY_ABOVE * radius:
            form, cut = "ray", 2.0 * _TUKEY * sigma
        elif k > _RAY_FROM + 3 and wide < _TUKEY * sigma and size < _SETTLED * sigma:
            settled = True
            break
    weight = np.max(w, axis=0) * sigma**2 * real_host
    return Refined(x, cov, sigma, t, radial, weight, settled, form == "ray")


def _inner(t, count):
    """Points that project inside the curve, not on its ends."""
    return (t > 1e-6) & (t < count - 1 - 1e-6)
