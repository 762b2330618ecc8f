"""The last stage: the most probable smooth curve whose surface carries the points, and its uncertainty.

The unknowns are K points of the spline at even arc length, more than the data need; the smoothness is estimated from the
data. The objective is

    - sum_i log p(e_i) + lambda/2 int |curve'''|^2 dt

with ``e_i`` the distance of point i from the surface of radius r around the curve, ``p`` the sensor's noise model, and
lambda by maximum marginal likelihood (Fellner-Schall update). In a gap only the second term acts, and the
standard deviation grows. Points may slide along the curve freely; each step is damped in that direction only, then the
points are spaced evenly again.

Two forms of ``e_i``:
* *radial*, ``|p_i - curve| - r``, with Tukey's weights and sigma from the median absolute deviation: without viewpoints, and
  always in the first iterations. Noise along a ray also moves a point around the tube, which bends radial distances by
  ``noise^2/r``: right while the noise is well below r;
* *along the ray*, with known viewpoints: depth of the point behind the tube's surface on its ray. It is linear in
  the noise, so a point behind the axis does no harm, and flying pixels are separable from noise (`sensor_noise`).
  For rays that graze or miss the tube it is extrapolated linearly from the last well-defined depth.

A third form serves a handful of points set by hand (`marks`): all three coordinates of ``p_i - curve(t_i)``.

Symbols: r radius, sigma noise of a point, std: m; t spline parameter; ``n`` gradient of e_i with respect to curve(t_i).
Reference: Wood, Fasiolo, "A generalized Fellner-Schall method" (2017).
"""

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag

from scan2flex_jax.scan import sensor_noise, spline
from scan2flex_jax.scan.settings import USUAL

KNOTS = 40
_ITERATIONS = 100
_OF_MARKS = 40  # iterations with a handful of points: the curve never converges, it slides along itself and cuts its loops off
_RAY_FROM = 5  # iteration at which the residual type is chosen
_LEAST = 1e-3  # of r: smaller residuals are rounding of the scanner
_STIFF_START = 3.0  # share of the data's weight given to smoothness at the start
_NEARLY_ALL = 0.998  # share of the points near the cable within the window of the mixture
_FADING = 0.25  # of the distance of two spline points: range at each end of the curve over which weights fade
_ROUNDS = 3  # updates of the mixture per iteration


@dataclass(frozen=True)
class Refined:
    """Spline points (m), their covariance (m^2), noise (m), and per cloud point: parameter, residual (m), weight (-).

    ``residual`` is radial (infinite for padding). ``score`` (1/m) and ``information`` (1/m^2) are the first and second
    derivative of the objective by the axis at the point.
    """

    points: Float[np.ndarray, "K 3"]
    covariance: Float[np.ndarray, "K3 K3"]
    sigma: float
    parameter: Float[np.ndarray, " n"]
    residual: Float[np.ndarray, " n"]
    weight: Float[np.ndarray, " n"]
    converged: bool
    along_ray: bool
    facing: float
    score: Float[np.ndarray, "n 3"]
    information: Float[np.ndarray, "n 3 3"]


@jax.jit
def _beside(x, points):
    """Parameter of the nearest point, that point, its unit tangent, and spline weights W, for all points."""
    c = spline.coefficients(x)
    t = spline.nearest(c, points)
    v = spline.evaluate(c, t, 1)
    tangent = v / jnp.linalg.norm(v, axis=1, keepdims=True)
    return t, spline.evaluate(c, t), tangent, spline.weights(x.shape[0], t)


def _radial(points, q, r):
    """Distance (m) of points from the surface around ``q``, and its gradient by ``q``."""
    off = points - q
    away = np.linalg.norm(off, axis=1) + 1e-12
    return (away - r)[None], (-off / away[:, None])[None]


def along_ray(points, q, tangent, eyes, r):
    """Depth (m) of each point behind the surface on its ray from each eye; gradient by ``q``; blur factor; side (r)."""
    ray = spline.unit(points - eyes[:, None])
    across = ray - np.sum(ray * tangent, axis=2, keepdims=True) * tangent
    steep = np.sqrt(np.sum(across**2, axis=2) + 1e-6)
    across = across / steep[..., None]
    off = points - q
    off = off - np.sum(off * tangent, axis=1, keepdims=True) * tangent
    depth = np.sum(across * off, axis=2)
    aside = off - depth[..., None] * across
    side = np.linalg.norm(aside, axis=2) + 1e-12
    inner = np.minimum(side, USUAL.silhouette * r)
    root = np.sqrt(r**2 - inner**2)
    slope = -inner / root
    e = (depth + root + slope * (side - inner)) / steep
    n = -(across + (slope / side)[..., None] * aside) / steep[..., None]
    return e, n, np.sqrt(1.0 + (USUAL.blur * slope) ** 2), side / r


def _step(x, score, n, info, W, rough, stiff, known):
    """Step for scores and information per viewpoint and point, with smoothness ``stiff``, damped along the curve by the mean
    weight of a point of the spline; covariance of x; traces for lambda.

    The step is that of expectation-maximisation: it uses the complete-data information of every point, and never overshoots
    if all points are honest. The covariance uses the ``known`` share, as ``info`` does.
    """
    K = len(x)
    J = [W[:, :, None] * nv[:, None, :] for nv in n]
    J = [j.reshape(-1, 3 * K) for j in J]
    H = sum(j.T @ (j * i[:, None]) for j, i in zip(J, info, strict=True))
    g = sum(j.T @ s for j, s in zip(J, score, strict=True))
    S = np.kron(rough, np.eye(3))
    tau = spline.tangents(x)
    scale = np.trace(H) / (3 * K)
    held = stiff * S + 1e-9 * scale * np.eye(3 * K) + scale * block_diag(*(tau[:, :, None] * tau[:, None]))
    cov = np.linalg.inv(H + held)
    dx = -np.linalg.solve(H / known + held, g + stiff * (S @ x.ravel()))
    return dx.reshape(K, 3), cov, np.sum(cov * S), x.ravel() @ S @ x.ravel()


class _Tukey:
    """Tukey's weights: zero far from the surface, in a window that shrinks from iteration to iteration."""

    known = 1.0  # share of the information that remains under the unknown classification

    def __init__(self, radius, noise, marks):
        self.radius, self.noise, self.marks = radius, noise, marks
        self.sigma = noise or 0.3 * radius
        self.cut = 2.0 * radius + 2.0 * self.sigma
        self.wide = USUAL.tube * radius

    def __call__(self, e, inside):
        """Score and information (1, n), weight (n,)."""
        r = self.radius
        seen = np.abs(e)[(np.abs(e) < self.cut) & inside]
        self.sigma = max(1.4826 * float(np.median(seen)), _LEAST * r) if len(seen) else np.inf
        if self.marks and self.noise:  # too few residuals to separate noise from shape
            self.sigma = self.noise
        self.cut = max(USUAL.tukey * self.sigma, self.wide)
        weight = np.where((np.abs(e) < self.cut) & inside, (1.0 - (e / self.cut) ** 2) ** 2, 0.0)
        self.wide *= USUAL.narrowing
        return weight * e / self.sigma**2, weight / self.sigma**2, np.max(weight, axis=0)

    @property
    def narrow(self):
        return self.wide < USUAL.tukey * self.sigma


class _Sensor:
    """Noise model of the sensor: points are honest, flying, or strays (`sensor_noise`)."""

    narrow = True
    known = 1.0
    mixture: Any

    def __init__(self, radius, sigma, breadth):
        """``breadth`` (m): largest distance of points from the axis, strays included."""
        self.radius, self.first, self.band, self.mixture = radius, sigma, radius / max(breadth, radius), None

    @property
    def sigma(self):
        return self.mixture.sigma

    def __call__(self, e, blur, side, inside):
        """Score and information (v, n), weight (n,)."""
        used = inside & (side < USUAL.stray)
        if self.mixture is None:  # all points this near to the surface must be covered by the mixture
            near = np.min(np.where(used, np.abs(e), np.inf), axis=0)
            near = near[np.isfinite(near)]
            window = max(3.0 * self.radius, 6.0 * self.first, float(np.quantile(near, _NEARLY_ALL)) if len(near) else 0.0)
            self.mixture = sensor_noise.first_guess(self.first, window, len(e), self.band)
        for _ in range(_ROUNDS):
            judged = sensor_noise.judge(e, blur, side, used, self.mixture)
            self.mixture = sensor_noise.update(self.mixture, judged, e, inside, _LEAST * self.radius)
        s2 = (self.mixture.sigma * blur) ** 2
        judged = sensor_noise.judge(e, blur, side, used, self.mixture)
        self.known = judged.known
        return judged.weight * judged.noise / s2, judged.known * judged.weight / s2, np.sum(judged.weight, axis=0)


def refine(x, points, real, radius: float, eyes=None, noise: float | None = None, marks: bool = False) -> Refined:
    """The smooth curve (through K points near ``x``) that explains the points; ``eyes`` are viewpoints (m), if known.

    ``marks``: the points are few, set by hand on the cable, and sample the axis up to noise.
    """
    x, real, host = np.array(x), np.asarray(real), np.asarray(points)
    rough, rank = spline.roughness(len(x)), 3 * (len(x) - 3)
    stiff, converged, facing, sensor = None, False, 1.0, None
    tukey = _Tukey(radius, noise, marks)
    for k in range(_OF_MARKS if marks else _ITERATIONS):
        t, q, tangent, W = (np.asarray(a) for a in _beside(jnp.asarray(x), points))
        inside = real & _inner(t, len(x))
        e, n = _radial(host, q, radius)
        if marks:
            e, n = (host - q).T, np.broadcast_to(-np.eye(3)[:, None], (3, *q.shape))
        if sensor is None:
            residual = e
            noisy: _Sensor | _Tukey = tukey
            score, info, weight = tukey(e, inside)
        else:
            residual, n, blur, side = along_ray(host, q, tangent, eyes, radius)
            noisy = sensor
            score, info, weight = sensor(residual, blur, side, inside)
        if not marks:
            score, info = score * _heard(t, len(x)), info * _heard(t, len(x))
        if stiff is None:
            stiff = _STIFF_START * np.sum(info) / len(x)
        dx, cov, leverage, bend = _step(x, score, n, info, W, rough, stiff, noisy.known)
        wanted = max(rank - stiff * leverage, 1e-3) / max(bend, 1e-300)
        stiff = float(np.clip(wanted, stiff / 10.0, stiff * 10.0))
        dx = dx if marks else _held(dx, x)
        size = np.linalg.norm(dx, axis=1).max()
        before, x = x, spline.evenly(x + dx * min(1.0, 0.7 * radius / max(size, 1e-300)), len(x))
        moved = np.linalg.norm(x - before, axis=1).max()
        if eyes is not None and not marks and k == _RAY_FROM:
            facing = _faced(host, q, eyes, weight > USUAL.certain, tukey.sigma > USUAL.noisy * radius)
            if facing > USUAL.face_eye:
                breadth = np.quantile(np.linalg.norm(host - q, axis=1)[inside], _NEARLY_ALL)
                sensor = _Sensor(radius, tukey.sigma, float(breadth))
        elif k > _RAY_FROM + 3 and noisy.narrow and moved < max(USUAL.converged * noisy.sigma, USUAL.still * radius):
            converged = True
            break
    away = np.where(real, np.linalg.norm(host - q, axis=1) - radius, np.inf)
    asked = np.einsum("vn,vni->ni", score, n), np.einsum("vn,vni,vnj->nij", info, n, n)
    return Refined(x, cov, noisy.sigma, t, away, weight * real, converged, sensor is not None, facing, *asked)


def _held(dx, x):
    """The step without the motion of the ends along the curve, which surface points do not determine: it would drift."""
    for k, step in ((0, x[1] - x[0]), (-1, x[-1] - x[-2])):
        dx[k] -= (dx[k] @ spline.unit(step)) * spline.unit(step)
    return dx


def _faced(points, q, eyes, on, noisy) -> float:
    """Share of the points on the cable that face one of the eyes; 1 if the noise is too large to decide."""
    if noisy or not on.any():
        return 1.0
    out, look = points[on] - q[on], eyes[:, None] - points[on]
    return float(np.mean(np.any(np.sum(out * look, axis=2) > 0.0, axis=0)))


def _heard(t, count):
    """Weight of a point, fading towards the ends of the curve: a point that is inside now and beyond the end after the next
    step would make the end oscillate."""
    return np.clip(np.minimum(t, count - 1 - t) / _FADING, 0.0, 1.0)


def _inner(t, count):
    """Mask of points that project inside the curve, not on its ends."""
    return (t > 1e-6) & (t < count - 1 - 1e-6)
