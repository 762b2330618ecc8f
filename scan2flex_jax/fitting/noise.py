"""The noise of measured curves: a white part and a part correlated along the cable, estimated from residuals.

Covariance of one normal component of one pose: ``sw^2 I + sc^2 k(|s - s'|/l)``, ``k`` a Matern kernel of smoothness 3/2, 5/2
or infinity (a squared exponential): errors of a scanner may be as smooth as a spline that was laid through its points, and a
kernel that is rougher than they are takes them for a signal. ``sw, sc, l`` and the smoothness maximise the restricted
likelihood: what the base model's sensitivities explain is projected out, so fitting parameters does not make the noise look
smaller. Weak log-normal priors keep each from running away where the data say nothing.
Reference: Rasmussen and Williams, "Gaussian Processes for Machine Learning" (2006), eqs. 4.17 and 5.8; Patterson and
Thompson (1971) for the restricted likelihood.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import linalg, optimize

from scan2flex_jax.fitting.discrepancy import SPREAD, foreshortening, principal
from scan2flex_jax.fitting.distance import NORMALS

_MOST = 72  # points of a pose that enter the likelihood: they resolve any correlation that matters
USUAL, FACTOR = 1e-3, np.log(5.0)  # noise over length of a scan, and by what factor (one sigma) scans differ
LARGEST = 5e-3  # of the length: noise of a scan
_SMOOTHNESS = (1.5, 2.5, np.inf)
_FLOOR = 0.1  # white part over the size of the residual: nothing finer is asked of a model of the cable
_OPEN = 1e-9  # of the largest eigenvalue of the scaled information: a direction that no pose feels
_MOST_OF_SIZE = 3.0  # total over the size: what a fit absorbs of a noise that is smooth over the whole cable, no more
_WORTH = 2.0  # nats that a discrepancy has to gain
_REGULAR = 1e-3  # of the correlated part: a white part that lets the matrix of a smooth kernel be factored
_UNFELT = 1e-5  # of the largest column: one that no pose feels
_FINEST = 1e-5  # of the length: no sensor's noise is smaller
_TRIED = 2  # starts of a search for both
_WIDE, _NARROW = 0.4, 0.15  # of the first simplex, in logarithms
_STARTS = ((0.4, 0.9, 0.15), (0.8, 0.5, 0.08))  # white and correlated part in units of the size, and the length


@dataclass(frozen=True)
class Noise:
    """Standard deviations of one normal component (m) of the white and the correlated part, its length (m) and smoothness.

    ``alike`` (m): standard deviation of a third part, which is one and the same along a whole pose, as where the radius of a
    cable is misjudged from one side. It is given and not estimated: few poses do not tell it.
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
        """Standard deviation of one normal component (m), without the part that is alike along a pose."""
        return float(np.hypot(self.white, self.correlated))

    def to_json(self) -> dict:
        """As in the study format (m)."""
        return {"white": self.white, "correlated": self.correlated, "correlation_length": self.correlation_length}

    def covariance(self, s: np.ndarray) -> np.ndarray:
        """Covariance (m^2) at arc lengths ``s`` (m) of one pose."""
        smooth = self.correlated**2 * matern(s, self.correlation_length, self.smoothness)
        return self.white**2 * np.eye(len(s)) + smooth + self.alike**2


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
    `Noise`.
    """
    def objective(u, smoothness):
        noise = Noise.at(u, smoothness, alike)
        beyond = max(0.0, np.log(_FLOOR * size) - u[0]) ** 2 + max(0.0, np.log(noise.total / (_MOST_OF_SIZE * size))) ** 2
        return negative(noise, u) + 1e3 * beyond

    starts = [np.log([a * size, b * size, c * length]) for a, b, c in _STARTS]
    found = [_nearest(objective, _SMOOTHNESS[0], u, _WIDE) for u in starts]
    for smoothness in _SMOOTHNESS[1:]:  # other kernels differ little in their numbers
        found.append(_nearest(objective, smoothness, min(found, key=lambda f: f[0])[2], _NARROW))
    _, smoothness, u = min(found, key=lambda f: f[0])
    return Noise.at(u, smoothness, alike)


def nearest(negative, noise: Noise, length: float) -> Noise:
    """The noise near another, of the same smoothness, that minimises ``negative(noise, u)``; ``length`` (m) of the cable."""
    u = _logarithms(noise)
    found = _nearest(lambda v, _: negative(_regular(noise.moved(v), length), v), noise.smoothness, u, _WIDE)
    return _regular(noise.moved(found[2]), length)


def _nearest(objective, smoothness, u, reach):
    """``(value, smoothness, u)`` of the minimum from ``u``, by a simplex that reaches ``reach`` in each logarithm."""
    options = {"xatol": 1e-2, "fatol": 1e-2, "maxiter": 120, "initial_simplex": u + np.vstack([np.zeros(3), reach * np.eye(3)])}
    f = optimize.minimize(objective, u, args=(smoothness,), method="Nelder-Mead", options=options)
    return f.fun, smoothness, f.x


def most_likely_with_discrepancy(
    negative, noise: Noise, usual: float, length: float, near: tuple[Noise, float] | None = None
) -> tuple[Noise, float, float]:
    """``(noise, curvature, value)`` that minimise ``negative(noise, u, curvature)`` plus the prior of the curvature (1/m).

    ``usual`` is the median of that prior, which is log-normal. A discrepancy that explains no more than `_WORTH` nats beside
    ``noise``, the most likely one without it, is none: the curvature is then zero, and ``value`` that of ``noise``.
    ``near``, a noise and a curvature close to the sought ones, is where to begin.
    """
    u = _logarithms(noise)
    least = np.log(_FINEST * length)

    def objective(v):
        found = _regular(noise.moved(v[:3]), length)
        low = max(0.0, least - v[0]) ** 2 + max(0.0, least - v[1]) ** 2
        prior = 0.5 * ((v[3] - np.log(usual)) / SPREAD) ** 2
        return negative(found, v[:3], float(np.exp(v[3]))) + prior + 1e3 * low

    if near is None:
        starts = [
            np.r_[np.maximum(u[:2] + np.log(finer), least), u[2], np.log(larger * usual)]
            for finer, larger in ((1.0, 1.0), (0.3, 4.0), (0.1, 20.0))
        ]
        starts, reach = sorted(starts, key=objective)[:_TRIED], _WIDE
    else:
        starts, reach = [np.r_[_logarithms(near[0]), np.log(near[1])]], _NARROW
    ends = []
    for start in starts:
        simplex = start + np.vstack([np.zeros(4), reach * np.eye(4)])
        options = {"xatol": 2e-2, "fatol": 2e-2, "maxiter": 200, "initial_simplex": simplex}
        ends.append(optimize.minimize(objective, start, method="Nelder-Mead", options=options))
    found, without = min(ends, key=lambda end: end.fun), negative(noise, u, 0.0)
    if found.fun > without - _WORTH:
        return noise, 0.0, float(without)
    return _regular(noise.moved(found.x[:3]), length), float(np.exp(found.x[3])), float(found.fun)


def _logarithms(noise: Noise) -> np.ndarray:
    """Of its white and correlated part (m) and its length (m)."""
    return np.log([noise.white, noise.correlated, noise.correlation_length])


def _regular(noise: Noise, length: float) -> Noise:
    """The noise with a white part that lets its covariance be factored."""
    return replace(noise, white=max(noise.white, _FINEST * length, _REGULAR * noise.correlated))


def white_noise(pose) -> float:
    """Standard deviation (m) of the white noise of a coordinate of a measured curve: stated, or from fourth differences.

    Bends between the points raise it, so that a curve of few points casts no doubt. Infinite where nothing tells it.
    """
    if pose.noise is not None:
        return pose.noise
    if pose.curve is None:
        return np.inf
    fourth = np.diff(pose.curve.points, n=4, axis=0)
    return float(np.sqrt(np.mean(fourth**2) / 70.0)) if len(fourth) else np.inf


class Residual(NamedTuple):
    """What a likelihood of the noise needs of one pose: arc lengths ``s`` (m,), residual ``r`` (m, c), columns ``X`` (m, c, k)
    of the numbers that stand ``at`` (k,) in the vector of all, and those of its discrepancy, ``Z`` (m, c, q); lengths in m.

    The components c are those along the normals, two or the one in the plane of a picture, and the last one that along the
    tangent, which counts for points that are ``marked`` (m,)."""

    s: np.ndarray
    r: np.ndarray
    X: np.ndarray
    at: np.ndarray
    Z: np.ndarray | None = None
    marked: np.ndarray | None = None

    def thinned(self, most: int = _MOST) -> "Residual":
        """With at most ``most`` points, in their order along the cable."""
        keep = thinned(self.s, most)
        Z = None if self.Z is None else self.Z[keep]
        marked = None if self.marked is None else self.marked[keep]
        return Residual(self.s[keep], self.r[keep], self.X[keep], self.at, Z, marked)

    def over(self, scale: float) -> "Residual":
        """In units of ``scale``, that of the noise of this pose."""
        Z = None if self.Z is None else self.Z / scale
        return self._replace(r=self.r / scale, X=self.X / scale, Z=Z)

    def in_plane(self) -> "Residual":
        """With the normal in its plane alone, of a pose that was measured in one."""
        u = plane_of(self.r)
        Z = None if self.Z is None else projected(self.Z, u)
        return self._replace(r=projected(self.r, u), X=projected(self.X, u), Z=Z)


def thinned(s: np.ndarray, most: int) -> np.ndarray:
    """Indices of at most ``most`` of the arc lengths (m,), in their order along the cable and evenly among them."""
    order = np.argsort(s, kind="stable")
    return order[np.unique(np.round(np.linspace(0, len(order) - 1, min(len(order), most))).astype(int))]


def estimate_noise(poses: list[Residual], length: float, stated: float | None = None) -> Noise:
    """Restricted maximum likelihood; ``stated`` is the total that the user states (m), held to within 15 %."""
    thin = _felt([p.thinned() for p in poses])
    free = np.zeros(thin[0].X.shape[-1])
    r = np.concatenate([p.r[:, :-1].ravel() for p in thin])
    X = np.concatenate([p.X[:, :-1].reshape(p.r[:, :-1].size, len(free)) for p in thin])
    left = r - X @ np.linalg.lstsq(X, r, rcond=None)[0] if X.shape[1] else r
    size = max(np.sqrt(np.mean(left**2)), 1e-12 * length)
    return most_likely(_with_priors(thin, length, stated), stated or size, length)


def _felt(poses: list[Residual]) -> list[Residual]:
    """The poses without columns that none of them feels: rounding errors are no directions of a model."""
    size = np.sqrt(sum(np.sum(p.X**2, axis=(0, 1)) for p in poses))
    keep = np.flatnonzero(size > _UNFELT * np.max(size, initial=0.0))
    return [p._replace(X=p.X[:, :, keep], at=np.arange(len(keep))) for p in poses]


def noise_and_discrepancy(
    poses: list[Residual], noise: Noise, length: float, stated: float | None, usual: float
) -> tuple[Noise, float]:
    """Noise and size (1/m) of the discrepancy by restricted maximum likelihood, begun at the ``noise`` that is likeliest alone.

    ``usual`` (1/m): the median of the prior of that size.
    """
    likely = _with_priors(_felt([p.thinned() for p in poses]), length, stated)

    def negative(noise, u, curvature=0.0):
        return likely(noise, u, curvature) + (0.0 if stated else scanner_prior(noise, length) + too_large(noise, length))

    return most_likely_with_discrepancy(negative, noise, usual, length)[:2]


def scanner_prior(noise: Noise, length: float) -> float:
    """Negative log prior of the noise of a scan that nobody stated."""
    return 0.5 * (np.log(noise.total / (USUAL * length)) / FACTOR) ** 2


def too_large(noise: Noise, length: float) -> float:
    """Negative log prior beside a discrepancy: what exceeds `LARGEST` is no noise that anybody left unsaid."""
    return 1e2 * max(0.0, np.log(noise.total / (LARGEST * length))) ** 2


def _with_priors(poses, length, stated):
    """The negative log likelihood of a noise at ``u`` and a discrepancy, with weak priors."""
    free = np.zeros(poses[0].X.shape[-1])
    shortest = max(spacing_of([p.s for p in poses]), 0.01 * length)

    def negative(noise, u, curvature=0.0):
        prior = 0.5 * ((u[2] - np.log(0.07 * length)) / 0.8) ** 2 + 0.02 * ((u[1] - u[0]) ** 2)
        prior += 0.5 * ((np.log(noise.total) - np.log(stated)) / 0.15) ** 2 if stated else 0.0
        bound = 1e3 * max(0.0, np.log(shortest) - u[2]) ** 2 + 1e3 * max(0.0, u[2] - np.log(0.5 * length)) ** 2
        return restricted_likelihood(poses, noise, free, free, curvature) + prior + bound

    return negative


def spacing_of(stations) -> float:
    """The usual distance (m) of neighbours among the arc lengths (m) of several poses; 0 where each has one point."""
    steps = np.concatenate([np.diff(s) for s in stations])
    return float(np.median(steps)) if len(steps) else 0.0


def plane_of(residual: np.ndarray) -> np.ndarray:
    """The direction (2,) among the normals in which the residual (m, 3) of a flat pose lies."""
    return np.linalg.svd(residual[:, :NORMALS], full_matrices=False)[2][0]


def projected(columns: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Columns (m, 3, ...) with the one normal ``u`` in place of both, (m, 2, ...)."""
    return np.concatenate([np.einsum("mc...,c->m...", columns[:, :NORMALS], u)[:, None], columns[:, NORMALS:]], axis=1)


def _white_rows(noise, s, columns, marked, nearer):
    """White rows of columns (m, c, K), and half the log determinant of their covariance."""
    factor = linalg.cholesky(noise.covariance(s), lower=True, check_finite=False)
    normals = columns.shape[1] - 1
    normal = np.ascontiguousarray(columns[:, :normals]).reshape(len(s), -1)
    rows = linalg.solve_triangular(factor, normal, lower=True, check_finite=False).reshape(normals * len(s), -1)
    log_det = normals * np.sum(np.log(np.diag(factor)))
    if marked is None or not np.any(marked):
        return rows, log_det
    C = noise.covariance(s[marked]) + (0.0 if nearer is None else np.diag(nearer[marked] ** 2))
    factor = linalg.cholesky(C, lower=True, check_finite=False)
    along = linalg.solve_triangular(factor, columns[marked, -1], lower=True, check_finite=False)
    return np.concatenate([rows, along]), log_det + np.sum(np.log(np.diag(factor)))


def restricted_likelihood(
    poses: list[Residual], noise: Noise, precision: np.ndarray, pull: np.ndarray, curvature: float = 0.0
) -> float:
    """Negative logarithm of the restricted likelihood of the poses' residuals (up to a constant).

    The numbers (K,) behind the columns have a normal prior of this ``precision`` (K,), 0 for none, whose gradient is ``pull``
    (K,). ``curvature`` (1/m) is the size of the discrepancy (`fitting.discrepancy`).
    """
    XX, Xr, total = np.diag(precision), pull.copy(), 0.0
    for s, r, X, at, Z, marked in poses:
        parts, nearer = [r[:, :, None], X], None
        if Z is not None and curvature:
            parts, nearer = [*parts, curvature * Z], foreshortening(curvature, Z, s)
        both, log_det = _white_rows(noise, s, np.concatenate(parts, axis=-1), marked, nearer)
        both, wZ = both[:, : 1 + X.shape[-1]], both[:, 1 + X.shape[-1] :]
        if wZ.shape[1]:  # a discrepancy has few directions
            U, d = principal(wZ)
            both = both + U @ ((1.0 / np.sqrt(1.0 + d**2) - 1.0)[:, None] * (U.T @ both))
            log_det += 0.5 * np.sum(np.log1p(d**2))
        wr, wX = both[:, 0], both[:, 1:]
        total += log_det + 0.5 * wr @ wr
        XX[np.ix_(at, at)] += wX.T @ wX
        Xr[at] += wX.T @ wr
    if not len(Xr):
        return float(total)
    scale = np.sqrt(np.maximum(np.diag(XX), 0.0)) + 1e-150
    values, vectors = np.linalg.eigh(XX / np.outer(scale, scale))
    keep = values > _OPEN * values[-1]
    projected = vectors[:, keep].T @ (Xr / scale)
    total += -0.5 * np.sum(projected**2 / values[keep]) + 0.5 * np.sum(np.log(values[keep])) + np.sum(np.log(scale))
    return float(total)
