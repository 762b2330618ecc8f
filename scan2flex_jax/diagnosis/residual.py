"""The whitened residual: what the fit leaves, in units of the noise, with what the base model can absorb taken out.

Per pose the two normal components (m) at arc lengths ``s`` (m), and the tangential one of markers, have covariance ``C(s)``
(`fitting.noise`); with ``C = L L'`` the whitened residual is ``L^-1 r`` and so are the columns. Poses are stacked; below them
stand the priors of what is known only nearly (pseudo-rows of unit variance). ``M = I - Q Q'``, ``Q`` an orthonormal basis of
the base model's columns, takes out what refitting the base numbers would.

Noise is estimated by restricted likelihood in the complement of base columns *and* of a low-rank basis of all signatures,
so that an effect in the data does not make the noise look larger.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import linalg

from scan2flex_jax.fitting.distance import NORMALS
from scan2flex_jax.fitting.noise import Noise, most_likely, spacing_of

_MOST = 64  # points of a pose that enter the likelihood of the noise
_RANK = 24  # directions of all signatures together that are kept out of the noise
_KNOTS = 25  # of the residual that repeated scans of a pose share
_SMALL = 0.03  # singular value, over the largest, below which a direction of the signatures is not
_USUAL, _FACTOR = 1e-3, np.log(5.0)  # noise over length of a scan, and by what factor (one sigma) scans differ
_OPEN = 1e-7  # of a unit column: a base number that no pose feels


@dataclass(frozen=True)
class Whitened:
    """Residual ``r`` (n,), columns ``J`` (n, b) of all base numbers, and per pose the factor L of its points, that of its
    markers and which points they are, and its rows: of both normals, then of the tangents at markers."""

    r: np.ndarray
    J: np.ndarray
    factors: tuple
    tangents: tuple
    rows: tuple
    real: tuple
    priors: int

    @property
    def normals(self) -> tuple[np.ndarray, ...]:
        """Per pose the rows of both normals."""
        return tuple(rows[: NORMALS * len(factor)] for rows, factor in zip(self.rows, self.factors, strict=True))

    def squares(self, i: int, values: np.ndarray) -> float:
        """Sum of the squared lengths (m^2) of all residuals of pose ``i``, from its whitened rows."""
        factor, (_, along) = self.factors[i], self.tangents[i]
        normal, tangential = np.split(values, [NORMALS * len(factor)])
        return float(np.sum((factor @ normal.reshape(len(factor), NORMALS)) ** 2) + np.sum((along @ tangential) ** 2))

    def stack(self, columns) -> np.ndarray:
        """Columns (m, 3, K) per pose, whitened and stacked, (n, K)."""
        out = np.zeros((len(self.r), columns[0].shape[-1]))
        parts = zip(self.factors, self.tangents, self.rows, self.real, columns, strict=True)
        for factor, tangents, rows, real, c in parts:
            out[rows] = _whiten_pose(factor, tangents, c[real])
        return out

    @property
    def base(self) -> np.ndarray:
        """Orthonormal basis of the base columns."""
        return orthonormal(self.J, _OPEN)


def whiten(shapes, real, numbers, vector, noise: Noise) -> Whitened:
    """From solved shapes (columns of the base numbers first) at ``vector``."""
    factors, tangents, rows, at = [], [], [], 0
    for shape, keep in zip(shapes, real, strict=True):
        factors.append(linalg.cholesky(noise.covariance(shape.s[keep]), lower=True))
        tangents.append(_tangents(shape, keep, noise))
        count = NORMALS * int(keep.sum()) + len(tangents[-1][0])
        rows.append(np.arange(at, at + count))
        at += count
    known = np.r_[numbers.nearly_known]
    r, J = np.zeros(at + len(known)), np.zeros((at + len(known), numbers.count))
    for i, (shape, keep) in enumerate(zip(shapes, real, strict=True)):
        r[rows[i]] = _whiten_pose(factors[i], tangents[i], shape.residual[keep][:, :, None])[:, 0]
        own = numbers.of_pose(i)
        J[np.ix_(rows[i], own)] = _whiten_pose(factors[i], tangents[i], shape.columns[keep][:, :, : len(own)])
    r[at:] = (vector[known] - numbers.prior_mean) / numbers.prior_std
    J[at + np.arange(len(known)), known] = 1.0 / numbers.prior_std
    return Whitened(r, J, tuple(factors), tuple(tangents), tuple(rows), tuple(real), len(known))


def _tangents(shape, keep, noise):
    """Which of a pose's points are markers, and the factor of their covariance: what they tell along the cable."""
    marks = np.zeros(0, int) if shape.marked is None else np.flatnonzero(np.asarray(shape.marked)[keep] > 0)
    return marks, linalg.cholesky(noise.covariance(shape.s[keep][marks]), lower=True) if len(marks) else np.zeros((0, 0))


def _whiten_pose(factor, tangents, columns):
    """Rows of one pose from columns (m, 3, K): both normals of all points, then the tangents of markers."""
    marks, along = tangents
    normal = _whiten(factor, columns[:, :NORMALS])
    if not len(marks):
        return normal
    return np.concatenate([normal, linalg.solve_triangular(along, columns[marks, NORMALS], lower=True)])


def _whiten(factor, columns):
    """Both normals, one after the other."""
    m, _, k = columns.shape
    return linalg.solve_triangular(factor, columns.reshape(m, -1), lower=True).reshape(m * NORMALS, k)


def orthonormal(X: np.ndarray, small: float = 1e-10) -> np.ndarray:
    """Orthonormal basis of the columns, each taken at unit length first."""
    size = np.linalg.norm(X, axis=0)
    if not np.any(size > 0):
        return np.zeros((len(X), 0))
    U, d, _ = np.linalg.svd(X[:, size > 0] / size[size > 0], full_matrices=False)
    return U[:, d > small * d[0]]


def signature_basis(columns: np.ndarray, base: np.ndarray, rank: int = _RANK) -> np.ndarray:
    """Orthonormal directions that carry the signatures, each signature at unit length beyond the base."""
    X = columns - base @ (base.T @ columns)
    size, full = np.linalg.norm(X, axis=0), np.linalg.norm(columns, axis=0)
    X = X[:, size > 1e-6 * full.max(initial=1e-300)]
    X = X / np.linalg.norm(X, axis=0)
    gram = X.T @ X
    values, vectors = np.linalg.eigh(gram)
    keep = np.argsort(values)[::-1][:rank]
    keep = keep[values[keep] > _SMALL**2 * values[-1]]
    return X @ (vectors[:, keep] / np.sqrt(values[keep]))


class Complement:
    """Restricted likelihood of the noise in the complement of the model's numbers (under their priors) and signatures.

    ``signatures`` (per pose (m, 2, K)) are directions that carry them. Poses that were scanned again (``repeats``, groups of
    indices) share a residual of any shape, of which only their differences are noise. Long curves are thinned first.
    """

    def __init__(self, shapes, real, numbers, vector, signatures, length, stated=None, repeats=()):
        """Thinned curves and columns, each with where its columns stand."""
        self.length, self.stated, self.curves = length, stated, []
        extra = signatures[0].shape[-1]
        self.columns = numbers.count + extra + len(repeats) * NORMALS * _KNOTS
        for i, (shape, keep) in enumerate(zip(shapes, real, strict=True)):
            own = numbers.of_pose(i)
            X = np.concatenate([shape.columns[keep][:, :NORMALS, : len(own)], signatures[i]], axis=-1)
            thin = np.unique(np.round(np.linspace(0, len(X) - 1, min(len(X), _MOST))).astype(int))
            order = np.argsort(shape.s[keep], kind="stable")[thin]
            at = np.r_[own, numbers.count + np.arange(extra)]
            for k in [k for k, group in enumerate(repeats) if i in group]:
                hats = np.clip(1 - np.abs(shape.s[keep][:, None] * (_KNOTS - 1) / length - np.arange(_KNOTS)), 0, 1)
                X = np.concatenate([X, np.einsum("mk,ab->mabk", hats, np.eye(NORMALS)).reshape(len(X), NORMALS, -1)], axis=-1)
                at = np.r_[at, numbers.count + extra + k * NORMALS * _KNOTS + np.arange(NORMALS * _KNOTS)]
            self.curves.append((shape.s[keep][order], shape.residual[keep][order][:, :NORMALS], X[order], at))
        self.prior = np.zeros(self.columns)
        self.prior[numbers.nearly_known] = numbers.prior_std**-2
        self.vector = np.r_[vector, np.zeros(self.columns - numbers.count)]
        self.vector[numbers.nearly_known] -= numbers.prior_mean
        size = np.sqrt(np.mean([np.mean(r**2) for _, r, _, _ in self.curves]))
        self.size = max(size, 1e-12 * length)
        self.shortest = max(spacing_of([s for s, *_ in self.curves]), 0.01 * length)

    def __call__(self, noise: Noise, u) -> float:
        """Negative log likelihood with weak priors at ``u`` = logarithms of white, correlated (m) and length (m) of a noise."""
        total = 0.0
        XX, Xr = np.diag(self.prior), self.prior * self.vector
        for s, r, X, at in self.curves:
            factor = linalg.cholesky(noise.covariance(s), lower=True, check_finite=False)
            both = _whiten(factor, np.concatenate([r[:, :, None], X], axis=-1))
            total += NORMALS * np.sum(np.log(np.diag(factor))) + 0.5 * both[:, 0] @ both[:, 0]
            XX[np.ix_(at, at)] += both[:, 1:].T @ both[:, 1:]
            Xr[at] += both[:, 1:].T @ both[:, 0]
        scale = np.sqrt(np.diag(XX)) + 1e-150
        values, vectors = np.linalg.eigh(XX / np.outer(scale, scale))
        keep = values > 1e-9 * values[-1]
        projected = vectors[:, keep].T @ (Xr / scale)
        total += -0.5 * np.sum(projected**2 / values[keep]) + 0.5 * np.sum(np.log(values[keep])) + np.sum(np.log(scale))
        return total + self._prior(u, noise)

    def _prior(self, u, noise):
        L = self.length
        prior = 0.5 * ((u[2] - np.log(0.07 * L)) / 0.6) ** 2 + 0.02 * (u[1] - u[0]) ** 2
        expected, spread = (self.stated, 0.15) if self.stated else (_USUAL * L, _FACTOR)
        prior += 0.5 * (np.log(noise.total / expected) / spread) ** 2
        beyond = max(0.0, np.log(self.shortest) - u[2]) ** 2 + max(0.0, u[2] - np.log(0.3 * L)) ** 2
        return prior + 1e3 * beyond

    @cached_property
    def estimate(self) -> Noise:
        """The most likely noise."""
        return most_likely(self, self.stated or self.size, self.length)

    def draws(self, noise: Noise, count: int, rng) -> list[Noise]:
        """Noises as likely as the estimated one: a normal law in their logarithms with the likelihood's curvature."""
        u, h, E = np.log([noise.white, noise.correlated, noise.correlation_length]), 0.08, np.eye(3)
        H = np.zeros((3, 3))

        def at(v):
            return self(Noise.at(v, noise.smoothness), v)

        for i in range(3):
            for j in range(i + 1):
                a, b = h * E[i], h * E[j]
                H[i, j] = H[j, i] = (at(u + a + b) - at(u + a - b) - at(u - a + b) + at(u - a - b)) / (4 * h * h)
        values, vectors = np.linalg.eigh(H)
        spread = vectors / np.sqrt(np.maximum(values, 4.0))
        found = [u + np.clip(spread @ rng.standard_normal(3), -0.7, 0.7) for _ in range(count)]
        return [Noise.at(v, noise.smoothness) for v in found]


def noise_like(white: Whitened, shapes, noises, count: int, rng) -> np.ndarray:
    """``count`` draws (n, count) of pure noise of the given laws, whitened as the residual was; priors' rows too."""
    out = rng.standard_normal((len(white.r), count))
    share = np.array_split(np.arange(count), len(noises))
    for noise, mine in zip(noises, share, strict=True):
        parts = zip(white.factors, white.tangents, white.rows, white.normals, white.real, shapes, strict=True)
        for factor, (marks, along), rows, normals, real, shape in parts:
            L = linalg.cholesky(noise.covariance(shape.s[real]), lower=True)
            drawn = (L @ out[np.ix_(normals, mine)].reshape(len(L), -1)).reshape(len(L), NORMALS, len(mine))
            out[np.ix_(normals, mine)] = _whiten(factor, drawn)
            if len(marks):
                last = np.ix_(rows[len(normals) :], mine)
                L = linalg.cholesky(noise.covariance(shape.s[real][marks]), lower=True)
                out[last] = linalg.solve_triangular(along, L @ out[last], lower=True)
    return out
