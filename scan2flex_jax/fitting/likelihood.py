"""Estimation of the noise of measured curves from residuals: its restricted likelihood with priors, for `fit` and `explain`.

The residuals are projected off the model's sensitivities, under the priors of its parameters, so that fitting parameters does
not reduce the noise. Symbols as in `noise`; a discrepancy is that of `discrepancy`.
Reference: Patterson and Thompson, "Recovery of inter-block information when block sizes are unequal" (1971).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import linalg

from scan2flex_jax.fitting.discrepancy import foreshortening, principal
from scan2flex_jax.fitting.distance import NORMALS
from scan2flex_jax.fitting.noise import Noise, most_likely, most_likely_with_discrepancy
from scan2flex_jax.fitting.settings import USUAL, NoiseSettings

_MOST = 72  # points of a pose that enter the likelihood: enough to resolve the correlation
_OPEN = 1e-9  # of the largest eigenvalue of the scaled information: an unidentifiable direction
_TINY = 1e-12
_UNFELT = 1e-5  # of the largest column: an unidentifiable parameter


class Residual(NamedTuple):
    """Input of a likelihood of the noise for one pose: arc lengths ``s`` (m,), residual ``r`` (m, c), columns ``X`` (m, c, k)
    of the parameters at the indices ``at`` (k,), and those of its discrepancy, ``Z`` (m, c, q); lengths in m.

    The components c are those along the normals, two or the one in the plane of a picture, and the last one that along the
    tangent, used for points that are ``marked`` (m,)."""

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

    def in_plane(self, u: np.ndarray) -> "Residual":
        """With the in-plane normal ``u`` (m, 2) only (`in_plane_normal`), for a pose measured in one plane."""
        Z = None if self.Z is None else projected(self.Z, u)
        return self._replace(r=projected(self.r, u), X=projected(self.X, u), Z=Z)


def thinned(s: np.ndarray, most: int) -> np.ndarray:
    """Indices of at most ``most`` of the arc lengths (m,), in their order along the cable and evenly among them."""
    order = np.argsort(s, kind="stable")
    return order[np.unique(np.round(np.linspace(0, len(order) - 1, min(len(order), most))).astype(int))]


@dataclass(frozen=True)
class NoisePrior:
    """Weak log-normal priors of a noise by its ``settings``, as negative logarithms up to a constant.

    ``length`` (m) of the cable; ``stated`` total (m) of the noise, if any; ``shortest`` correlation length (m). ``scanner``: an
    unstated total has the prior of a scan.
    """

    length: float
    stated: float | None
    shortest: float
    scanner: bool
    settings: NoiseSettings = USUAL

    def __call__(self, noise: Noise, u: np.ndarray, discrepancy: bool = False) -> float:
        """At a noise of logarithms ``u``; with a ``discrepancy`` an unstated noise is bounded."""
        L, own = self.length, self.settings
        prior = 0.5 * ((u[2] - np.log(own.usual_correlation * L)) / own.correlation_spread) ** 2 + 0.02 * (u[1] - u[0]) ** 2
        if self.stated:
            prior += 0.5 * (np.log(noise.total / self.stated) / own.stated_spread) ** 2
        elif self.scanner or discrepancy:
            prior += 0.5 * (np.log(noise.total / (own.usual_noise * L)) / np.log(own.noise_factor)) ** 2
        if discrepancy and not self.stated:
            prior += 1e2 * max(0.0, np.log(noise.total / (own.most_noise * L))) ** 2
        beyond = max(0.0, np.log(self.shortest) - u[2]) ** 2 + max(0.0, u[2] - np.log(own.longest_correlation * L)) ** 2
        return prior + 1e3 * beyond


@dataclass(frozen=True)
class RestrictedLikelihood:
    """Negative logarithm of the restricted likelihood of a noise with its prior, given the residuals of all poses.

    ``precision`` (K,) and ``pull`` (K,) are those of `restricted_likelihood`.
    """

    poses: list[Residual]
    prior: NoisePrior
    precision: np.ndarray
    pull: np.ndarray

    def __call__(self, noise: Noise, u: np.ndarray) -> float:
        """Of a noise of logarithms ``u`` alone."""
        return restricted_likelihood(self.poses, noise, self.precision, self.pull) + self.prior(noise, u)

    def with_discrepancy(self, noise: Noise, u: np.ndarray, curvature: float = 0.0) -> float:
        """Of a noise of logarithms ``u`` with a discrepancy of size ``curvature`` (1/m)."""
        likelihood = restricted_likelihood(self.poses, noise, self.precision, self.pull, curvature)
        return likelihood + self.prior(noise, u, discrepancy=True)


def shortest_of(poses: list[Residual], length: float) -> float:
    """The shortest correlation length (m) that the points of the poses resolve."""
    return max(spacing_of([p.s for p in poses]), 0.01 * length)


def estimate_noise(
    poses: list[Residual], length: float, stated: float | None = None, settings: NoiseSettings = USUAL
) -> Noise:
    """Restricted maximum likelihood; ``stated`` is the total that the user states (m)."""
    thin = _felt([p.thinned() for p in poses])
    columns = thin[0].X.shape[-1]
    r = np.concatenate([p.r[:, :-1].ravel() for p in thin])
    X = np.concatenate([p.X[:, :-1].reshape(p.r[:, :-1].size, columns) for p in thin])
    left = r - X @ np.linalg.lstsq(X, r, rcond=None)[0] if columns else r
    size = max(np.sqrt(np.mean(left**2)), 1e-12 * length)
    return most_likely(_of_fit(thin, length, stated, settings), stated or size, length)


def _felt(poses: list[Residual]) -> list[Residual]:
    """The poses without columns of unidentifiable parameters, which are rounding errors."""
    size = np.sqrt(sum(np.sum(p.X**2, axis=(0, 1)) for p in poses))
    keep = np.flatnonzero(size > _UNFELT * np.max(size, initial=0.0))
    return [p._replace(X=p.X[:, :, keep], at=np.arange(len(keep))) for p in poses]


def noise_and_discrepancy(
    poses: list[Residual], noise: Noise, length: float, stated: float | None, usual: float, settings: NoiseSettings = USUAL
) -> tuple[Noise, float, float]:
    """Noise and size (1/m) of the discrepancy by restricted maximum likelihood, starting from the most likely ``noise`` alone,
    and the negative logarithm (nats) of that likelihood with the priors.

    ``usual`` (1/m): the median of the prior of that size.
    """
    likelihood = _of_fit(_felt([p.thinned() for p in poses]), length, stated, settings)
    return most_likely_with_discrepancy(likelihood.with_discrepancy, noise, usual, length, settings=settings)


def _of_fit(poses, length, stated, settings) -> RestrictedLikelihood:
    """The likelihood given a fit, whose parameters are free."""
    free = np.zeros(poses[0].X.shape[-1])
    prior = NoisePrior(length, stated, shortest_of(poses, length), scanner=False, settings=settings)
    return RestrictedLikelihood(poses, prior, free, free)


def spacing_of(stations) -> float:
    """The usual distance (m) of neighbours among the arc lengths (m) of several poses; 0 where each has one point."""
    steps = np.concatenate([np.diff(s) for s in stations])
    return float(np.median(steps)) if len(steps) else 0.0


def in_plane_normal(axes: np.ndarray, across: np.ndarray) -> np.ndarray:
    """The direction (m, 2) among the normals, the first rows of ``axes`` (m, 3, 3), in the plane with the normal ``across``
    (3,)."""
    first, second = np.moveaxis(axes[:, :NORMALS] @ across, 1, 0)
    return np.stack([second, -first], axis=1) / np.maximum(np.hypot(first, second), _TINY)[:, None]


def projected(columns: np.ndarray, u: np.ndarray) -> np.ndarray:
    """Columns (m, 3, ...) with the one normal ``u`` (m, 2) in place of both, (m, 2, ...)."""
    return np.concatenate([np.einsum("mc...,mc->m...", columns[:, :NORMALS], u)[:, None], columns[:, NORMALS:]], axis=1)


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

    The parameters (K,) have a normal prior of this ``precision`` (K,), 0 for none, with the gradient ``pull`` (K,).
    ``curvature`` (1/m) is the size of the discrepancy (`fitting.discrepancy`).
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
