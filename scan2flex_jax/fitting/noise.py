"""Model of the noise of measured curves: covariance of a white and of a correlated part (estimated in `likelihood`).

Covariance of one normal component of one pose: ``sw^2 I + sc^2 k(|s - s'|/l)``, ``k`` a Matern kernel of smoothness 3/2, 5/2
or infinity (a squared exponential): errors of a scanner may be as smooth as a spline through its points, and a rougher kernel
would take them for a signal. ``sw, sc, l`` and the smoothness maximise a likelihood that the caller gives, by a simplex from
several starts; `likelihood.estimate_noise` estimates them from the residuals of poses.
Reference: Rasmussen and Williams, "Gaussian Processes for Machine Learning" (2006), eqs. 4.17 and 5.8.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy import optimize

from scan2flex_jax.fitting.distance import NORMALS
from scan2flex_jax.fitting.settings import USUAL, NoiseSettings

_SMOOTHNESS = (1.5, 2.5, np.inf)
_FLOOR = 0.1  # least white part over the size of the residual
_MOST_OF_SIZE = 3.0  # largest total over the size: a fit absorbs part of a noise that is smooth over the whole cable
_REGULAR = 1e-3  # of the correlated part: least white part for the factorisation of a smooth kernel's matrix
FINEST = 1e-5  # of the length: least noise of a sensor
_ALONE = 1.1  # times that: no other part counts
_TRIED = 2  # starts of a search for both
_WIDE, _NARROW = 0.4, 0.15  # of the first simplex, in logarithms
_ALIKE_OVER = 0.7  # of a pose: length over which the error of a scan's axis is alike
_NEIGHBOURS = np.array([-2, -1, 1, 2])  # of a point, that predict it
_TINY = 1e-300
_STARTS = ((0.4, 0.9, 0.15), (0.8, 0.5, 0.08))  # white and correlated part in units of the size, and the length


@dataclass(frozen=True)
class Noise:
    """Standard deviations of one normal component (m) of the white and the correlated part, its length (m) and smoothness.

    ``alike`` (m): standard deviation of a third part, nearly constant along a pose, as where the radius of a cable is misjudged
    from one side: a squared exponential of length 0.7 of the pose. It is given, since few poses do not determine it.
    """

    white: float
    correlated: float
    correlation_length: float
    smoothness: float = 1.5
    alike: float = 0.0

    @classmethod
    def at(cls, u: np.ndarray, smoothness: float, alike: float = 0.0) -> "Noise":
        """From the logarithms of white, correlated (m) and length (m)."""
        white, correlated, length = (float(v) for v in np.exp(u))
        return cls(white, correlated, length, smoothness, alike)

    def moved(self, u: np.ndarray) -> "Noise":
        """One of other white, correlated (m) and length (m), by their logarithms."""
        return Noise.at(u, self.smoothness, self.alike)

    @property
    def total(self) -> float:
        """Standard deviation of one normal component (m), without the part alike along a pose."""
        return float(np.hypot(self.white, self.correlated))

    def assumed(self, length: float) -> bool:
        """Whether it is no more than that of the finest sensor assumed for this ``length`` (m): the data show less."""
        return self.total <= _ALONE * FINEST * length

    def to_json(self) -> dict:
        """As in the study format (m)."""
        return {"white": self.white, "correlated": self.correlated, "correlation_length": self.correlation_length}

    def covariance(self, s: np.ndarray) -> np.ndarray:
        """Covariance (m^2) at arc lengths ``s`` (m) of one pose."""
        smooth = self.correlated**2 * matern(s, self.correlation_length, self.smoothness)
        alike = self.alike**2 * matern(s, max(_ALIKE_OVER * np.ptp(s), _TINY), np.inf) if self.alike else 0.0
        return self.white**2 * np.eye(len(s)) + smooth + alike


def matern(s: np.ndarray, length: float, smoothness: float = 1.5) -> np.ndarray:
    """Matern correlation of smoothness 3/2, 5/2 or infinity of arc lengths ``s`` (m)."""
    d = np.abs(s[:, None] - s[None, :]) / length
    if smoothness == 1.5:
        a = np.sqrt(3.0) * d
        return (1.0 + a) * np.exp(-a)
    if smoothness == 2.5:
        a = np.sqrt(5.0) * d
        return (1.0 + a + a**2 / 3.0) * np.exp(-a)
    return np.exp(-0.5 * d**2)


def most_likely(negative, size: float, length: float, alike: float = 0.0) -> Noise:
    """The noise that minimises ``negative(noise, u)``, ``u`` the logarithms of its white, correlated (m) and length (m).

    ``size`` (m) and the cable's ``length`` (m) give the starts and bound the noise from both sides; ``alike`` (m) is that of
    `Noise`. The white part is at least that of the finest sensor, so that errors of the mesh in data without noise are none of
    the physics.
    """
    def objective(u, smoothness):
        noise = Noise.at(u, smoothness, alike)
        beyond = max(0.0, np.log(_FLOOR * size) - u[0]) ** 2 + max(0.0, np.log(noise.total / (_MOST_OF_SIZE * size))) ** 2
        return negative(noise, u) + 1e3 * beyond

    starts = [np.log([a * size, b * size, c * length]) for a, b, c in _STARTS]
    found = [_nearest(objective, _SMOOTHNESS[0], u, _WIDE) for u in starts]
    for smoothness in _SMOOTHNESS[1:]:  # other kernels have similar parameters
        found.append(_nearest(objective, smoothness, min(found, key=lambda f: f[0])[2], _NARROW))
    _, smoothness, u = min(found, key=lambda f: f[0])
    return _regular(Noise.at(u, smoothness, alike), length)


def nearest(negative, noise: Noise, length: float) -> Noise:
    """The noise near another, of the same smoothness, that minimises ``negative(noise, u)``; ``length`` (m) of the cable."""
    u = logarithms(noise)
    found = _nearest(lambda v, _: negative(_regular(noise.moved(v), length), v), noise.smoothness, u, _WIDE)
    return _regular(noise.moved(found[2]), length)


def _nearest(objective, smoothness, u, reach):
    """``(value, smoothness, u)`` of the minimum from ``u``, by a simplex that reaches ``reach`` in each logarithm."""
    options = {"xatol": 1e-2, "fatol": 1e-2, "maxiter": 120, "initial_simplex": u + np.vstack([np.zeros(3), reach * np.eye(3)])}
    f = optimize.minimize(objective, u, args=(smoothness,), method="Nelder-Mead", options=options)
    return f.fun, smoothness, f.x


def most_likely_with_discrepancy(
    negative, noise: Noise, usual: float, length: float, near: tuple[Noise, float] | None = None,
    settings: NoiseSettings = USUAL,
) -> tuple[Noise, float, float]:
    """``(noise, curvature, value)`` that minimise ``negative(noise, u, curvature)`` plus the prior of the curvature (1/m).

    ``usual`` is the median of that prior, which is log-normal. A discrepancy that gains too little (``settings``) over
    ``noise``, the most likely one without it, is none: the curvature is then zero, and ``value`` that of ``noise``.
    ``near``: a noise and a curvature to start from.
    """
    u = logarithms(noise)
    least = np.log(FINEST * length)

    def objective(v):
        found = _regular(noise.moved(v[:3]), length)
        low = max(0.0, least - v[0]) ** 2 + max(0.0, least - v[1]) ** 2
        prior = 0.5 * ((v[3] - np.log(usual)) / settings.discrepancy_spread) ** 2
        return negative(found, v[:3], float(np.exp(v[3]))) + prior + 1e3 * low

    if near is None:
        starts = [
            np.r_[np.maximum(u[:2] + np.log(finer), least), u[2], np.log(larger * usual)]
            for finer, larger in ((1.0, 1.0), (0.3, 4.0), (0.1, 20.0))
        ]
        starts, reach = sorted(starts, key=objective)[:_TRIED], _WIDE
    else:
        starts, reach = [np.r_[logarithms(near[0]), np.log(near[1])]], _NARROW
    ends = []
    for start in starts:
        simplex = start + np.vstack([np.zeros(4), reach * np.eye(4)])
        options = {"xatol": 2e-2, "fatol": 2e-2, "maxiter": 200, "initial_simplex": simplex}
        ends.append(optimize.minimize(objective, start, method="Nelder-Mead", options=options))
    found, without = min(ends, key=lambda end: end.fun), negative(noise, u, 0.0)
    if found.fun > without - settings.discrepancy_gain:
        return noise, 0.0, float(without)
    return _regular(noise.moved(found.x[:3]), length), float(np.exp(found.x[3])), float(found.fun)


def logarithms(noise: Noise) -> np.ndarray:
    """Of its white and correlated part (m) and its length (m)."""
    return np.log([noise.white, noise.correlated, noise.correlation_length])


def _regular(noise: Noise, length: float) -> Noise:
    """The noise with a white part large enough to factorise its covariance."""
    return replace(noise, white=max(noise.white, FINEST * length, _REGULAR * noise.correlated))


def stated_noise(study, of_all: bool = True) -> float | None:
    """The stated noise (m, one coordinate), pooled over the fitted poses; None if not all of them state it, or not ``of_all``
    but none does."""
    stated = [pose.noise for pose in study.fit_poses if pose.noise is not None]
    missing = len(stated) < len(study.fit_poses) if of_all else not stated
    return None if missing else float(np.sqrt(np.mean(np.square(stated))))


def sensor_noise(study) -> float:
    """White noise (m) of the fitted curves: the median over poses; infinite if they do not show it."""
    return float(np.median([white_noise(pose) for pose in study.fit_poses]))


def white_noise(pose) -> float:
    """Standard deviation (m) of the white noise of a coordinate of a measured curve: stated, or from its points.

    Each point is compared with the cubic through two neighbours on either side over the chords between them, across the curve
    only: along it, uneven distances between points would count as noise. Bends between the points raise it, so that a curve of
    few points casts no doubt; noise above the distance of points is found up to 20 % too small. Infinite if unknown.
    """
    if pose.noise is not None:
        return pose.noise
    if pose.curve is None:
        return np.inf
    points = np.asarray(pose.curve.points)
    apart = np.linalg.norm(np.diff(points, axis=0), axis=1)
    points = points[np.r_[True, apart > 0]]  # repeated points say nothing of the noise
    if len(points) < len(_NEIGHBOURS) + 1:
        return np.inf
    s = np.r_[0.0, np.cumsum(apart[apart > 0])]
    middle = np.arange(2, len(points) - 2)
    near = middle[:, None] + _NEIGHBOURS
    d = s[near] - s[middle, None]
    others = [np.delete(np.arange(len(_NEIGHBOURS)), k) for k in range(len(_NEIGHBOURS))]
    weight = np.stack([np.prod(d[:, o] / (d[:, o] - d[:, [k]]), axis=1) for k, o in enumerate(others)], axis=1)  # Lagrange's
    off = points[middle] - np.einsum("nk,nkc->nc", weight, points[near])
    along = points[near[:, -1]] - points[near[:, 0]]
    across = np.linalg.norm(off, axis=1) ** 2 - np.sum(off * along, axis=1) ** 2 / np.maximum(np.sum(along**2, axis=1), _TINY)
    return float(np.sqrt(np.mean(np.maximum(across, 0.0) / (NORMALS * (1.0 + np.sum(weight**2, axis=1))))))
