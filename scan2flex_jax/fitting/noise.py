"""The noise of measured curves: a white part and a part correlated along the cable, estimated from residuals.

Covariance of one normal component of one pose: ``sw^2 I + sc^2 k(|s - s'|/l)``, ``k`` a Matern kernel of smoothness 3/2, 5/2
or infinity (a squared exponential): errors of a scanner may be as smooth as a spline that was laid through its points, and a
kernel that is rougher than they are takes them for a signal. ``sw, sc, l`` and the smoothness maximise the restricted
likelihood: what the base model's sensitivities explain is projected out, so fitting parameters does not make the noise look
smaller. Weak log-normal priors keep each from running away where the data say nothing.
Reference: Rasmussen and Williams, "Gaussian Processes for Machine Learning" (2006), eqs. 4.17 and 5.8; Patterson and
Thompson (1971) for the restricted likelihood.
"""

from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize

from scan2flex_jax.fitting.distance import NORMALS

_MOST = 72  # points of a pose that enter the likelihood: they resolve any correlation that matters
_SMOOTHNESS = (1.5, 2.5, np.inf)
_FLOOR = 0.1  # white part over the size of the residual: nothing finer is asked of a model of the cable
_MOST_OF_SIZE = 3.0  # total over the size: what a fit absorbs of a noise that is smooth over the whole cable, no more
_WIDE, _NARROW = 0.4, 0.15  # of the first simplex, in logarithms
_STARTS = ((0.4, 0.9, 0.15), (0.8, 0.5, 0.08))  # white and correlated part in units of the size, and the length


@dataclass(frozen=True)
class Noise:
    """Standard deviations of one normal component (m) of the white and the correlated part, its length (m) and smoothness."""

    white: float
    correlated: float
    correlation_length: float
    smoothness: float = 1.5

    @classmethod
    def at(cls, u: np.ndarray, smoothness: float) -> "Noise":
        """From the logarithms of white, correlated (m) and length (m)."""
        white, correlated, length = (float(v) for v in np.exp(u))
        return cls(white, correlated, length, smoothness)

    @property
    def total(self) -> float:
        """Standard deviation of one normal component (m)."""
        return float(np.hypot(self.white, self.correlated))

    def to_json(self) -> dict:
        """As in the study format (m)."""
        return {"white": self.white, "correlated": self.correlated, "correlation_length": self.correlation_length}

    def covariance(self, s: np.ndarray) -> np.ndarray:
        """Covariance (m^2) at arc lengths ``s`` (m) of one pose."""
        return self.white**2 * np.eye(len(s)) + self.correlated**2 * matern(s, self.correlation_length, self.smoothness)


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


def most_likely(negative, size: float, length: float) -> Noise:
    """The noise that minimises ``negative(noise, u)``, ``u`` the logarithms of its white, correlated (m) and length (m).

    ``size`` (m) and the cable's ``length`` (m) give the starts and bound the noise from both sides.
    """
    def objective(u, smoothness):
        noise = Noise.at(u, smoothness)
        beyond = max(0.0, np.log(_FLOOR * size) - u[0]) ** 2 + max(0.0, np.log(noise.total / (_MOST_OF_SIZE * size))) ** 2
        return negative(noise, u) + 1e3 * beyond

    starts = [np.log([a * size, b * size, c * length]) for a, b, c in _STARTS]
    found = [_nearest(objective, _SMOOTHNESS[0], u, _WIDE) for u in starts]
    for smoothness in _SMOOTHNESS[1:]:  # other kernels differ little in their numbers
        found.append(_nearest(objective, smoothness, min(found, key=lambda f: f[0])[2], _NARROW))
    _, smoothness, u = min(found, key=lambda f: f[0])
    return Noise.at(u, smoothness)


def _nearest(objective, smoothness, u, reach):
    """``(value, smoothness, u)`` of the minimum from ``u``, by a simplex that reaches ``reach`` in each logarithm."""
    options = {"xatol": 1e-2, "fatol": 1e-2, "maxiter": 120, "initial_simplex": u + np.vstack([np.zeros(3), reach * np.eye(3)])}
    f = optimize.minimize(objective, u, args=(smoothness,), method="Nelder-Mead", options=options)
    return f.fun, smoothness, f.x


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


def estimate_noise(curves, length: float, stated: float | None = None) -> Noise:
    """Restricted maximum likelihood.

    ``curves`` holds per pose ``(s (m,), residual (m, 2), sensitivities (m, 2, p))``; ``stated`` is the total that the user
    states (m), held to within 15 %.
    """
    thin = [_thin(*c) for c in curves]
    r = np.concatenate([r.ravel() for _, r, _ in thin])
    X = np.concatenate([X.reshape(NORMALS * len(X), X.shape[2]) for _, _, X in thin])
    left = r - X @ np.linalg.lstsq(X, r, rcond=None)[0] if X.shape[1] else r
    size = max(np.sqrt(np.mean(left**2)), 1e-12 * length)
    shortest = max(spacing_of([s for s, _, _ in thin]), 0.01 * length)

    def negative(noise, u):
        prior = 0.5 * ((u[2] - np.log(0.07 * length)) / 0.8) ** 2 + 0.02 * ((u[1] - u[0]) ** 2)
        prior += 0.5 * ((np.log(noise.total) - np.log(stated)) / 0.15) ** 2 if stated else 0.0
        bound = 1e3 * max(0.0, np.log(shortest) - u[2]) ** 2 + 1e3 * max(0.0, u[2] - np.log(0.5 * length)) ** 2
        return restricted_likelihood(thin, noise) + prior + bound

    return most_likely(negative, stated or size, length)


def spacing_of(stations) -> float:
    """The usual distance (m) of neighbours among the arc lengths (m) of several poses; 0 where each has one point."""
    steps = np.concatenate([np.diff(s) for s in stations])
    return float(np.median(steps)) if len(steps) else 0.0


def restricted_likelihood(curves, noise: Noise) -> float:
    """Negative logarithm of the restricted likelihood of the curves' residuals (up to a constant)."""
    columns = curves[0][2].shape[2]
    XX, Xr, total = np.zeros((columns, columns)), np.zeros(columns), 0.0
    for s, r, X in curves:
        factor = linalg.cholesky(noise.covariance(s), lower=True, check_finite=False)
        white = linalg.solve_triangular(factor, np.column_stack([r, X.reshape(len(s), -1)]), lower=True, check_finite=False)
        wr, wX = white[:, :NORMALS], white[:, NORMALS:].reshape(len(s), NORMALS, columns)
        total += NORMALS * np.sum(np.log(np.diag(factor))) + 0.5 * np.sum(wr**2)
        XX += np.einsum("mnp,mnq->pq", wX, wX)
        Xr += np.einsum("mnp,mn->p", wX, wr)
    if columns == 0:
        return total
    values, vectors = np.linalg.eigh(XX)
    keep = values > 1e-10 * max(values[-1], 1e-300)
    projected = vectors[:, keep].T @ Xr
    return total - 0.5 * np.sum(projected**2 / values[keep]) + 0.5 * np.sum(np.log(values[keep]))


def _thin(s, r, X):
    order = np.argsort(s, kind="stable")
    keep = order[np.unique(np.round(np.linspace(0, len(s) - 1, min(len(s), _MOST))).astype(int))]
    return s[keep], r[keep], X[keep]
