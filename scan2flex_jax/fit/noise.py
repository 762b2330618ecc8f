"""The noise of measured curves: a white part and a part correlated along the cable, estimated from residuals.

Covariance of one normal component of one pose: ``sw^2 I + sc^2 k(|s - s'|/l)``, ``k`` the Matern-3/2 kernel. ``sw, sc, l``
maximise the restricted likelihood: what the base model's sensitivities explain is projected out, so fitting parameters
does not make the noise look smaller. Weak log-normal priors keep each from running away where the data say nothing.
Reference: Rasmussen and Williams, "Gaussian Processes for Machine Learning" (2006), eqs. 4.17 and 5.8; Patterson and
Thompson (1971) for the restricted likelihood.
"""

from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize

_MOST = 72  # points of a pose that enter the likelihood: they resolve any correlation that matters
_NORMALS = 2


@dataclass(frozen=True)
class Noise:
    """Standard deviations of one normal component (m) of the white and the correlated part, and its length (m)."""

    white: float
    correlated: float
    correlation_length: float

    @property
    def total(self) -> float:
        """Standard deviation of one normal component (m)."""
        return float(np.hypot(self.white, self.correlated))

    def covariance(self, s: np.ndarray) -> np.ndarray:
        """Covariance (m^2) at arc lengths ``s`` (m) of one pose."""
        return self.white**2 * np.eye(len(s)) + self.correlated**2 * matern(s, self.correlation_length)


def matern(s: np.ndarray, length: float) -> np.ndarray:
    """Matern-3/2 correlation of arc lengths ``s`` (m)."""
    a = np.sqrt(3.0) * np.abs(s[:, None] - s[None, :]) / length
    return (1.0 + a) * np.exp(-a)


def estimate_noise(curves, length: float, stated: float | None = None) -> Noise:
    """Restricted maximum likelihood.

    ``curves`` holds per pose ``(s (m,), residual (m, 2), sensitivities (m, 2, p))``; ``stated`` is the total that the user
    states (m), held to within 15 %.
    """
    thin = [_thin(*c) for c in curves]
    size = np.sqrt(np.mean(np.concatenate([r.ravel() for _, r, _ in thin]) ** 2))
    size = max(size, 1e-12 * length)
    spacing = np.median(np.concatenate([np.diff(s) for s, _, _ in thin]))
    shortest = max(spacing, 0.01 * length)

    def negative(u):
        noise = Noise(*np.exp(u))
        prior = 0.5 * ((u[2] - np.log(0.07 * length)) / 0.8) ** 2 + 0.02 * ((u[1] - u[0]) ** 2)
        prior += 0.5 * ((np.log(noise.total) - np.log(stated)) / 0.15) ** 2 if stated else 0.0
        bound = 1e3 * max(0.0, np.log(shortest) - u[2]) ** 2 + 1e3 * max(0.0, u[2] - np.log(0.5 * length)) ** 2
        return restricted_likelihood(thin, noise) + prior + bound

    guess = stated or size
    starts = [(0.8, 0.5, 0.08), (0.4, 0.9, 0.15)]
    options = {"xatol": 1e-2, "fatol": 1e-2, "maxiter": 120}
    found = [
        optimize.minimize(negative, np.log([a * guess, b * guess, c * length]), method="Nelder-Mead", options=options)
        for a, b, c in starts
    ]
    return Noise(*(float(v) for v in np.exp(min(found, key=lambda f: f.fun).x)))


def restricted_likelihood(curves, noise: Noise) -> float:
    """Negative logarithm of the restricted likelihood of the curves' residuals (up to a constant)."""
    columns = curves[0][2].shape[2]
    XX, Xr, total = np.zeros((columns, columns)), np.zeros(columns), 0.0
    for s, r, X in curves:
        factor = linalg.cholesky(noise.covariance(s), lower=True, check_finite=False)
        white = linalg.solve_triangular(factor, np.column_stack([r, X.reshape(len(s), -1)]), lower=True, check_finite=False)
        wr, wX = white[:, :_NORMALS], white[:, _NORMALS:].reshape(len(s), _NORMALS, columns)
        total += _NORMALS * np.sum(np.log(np.diag(factor))) + 0.5 * np.sum(wr**2)
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
