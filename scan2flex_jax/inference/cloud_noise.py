"""Noise of a direct fit: residual displacements along the cable, their correlation, and the covariance of the estimates.

Thousands of points of one scan are not independent measurements of the shape: errors of neighbours are correlated. A
point's residual is ``n_i . f(s_i) + noise``, ``n_i`` its direction from the axis, ``f`` a random displacement of the axis
in two normals with the covariance ``sc^2 k(|s - s'|/l)`` (Matern 3/2), and the noise of points is white. Per station along
the cable the points give a displacement ``u`` with its own white covariance ``V`` (large along directions not scanned).
``a`` (a factor on V), ``sc`` and ``l`` maximise the restricted likelihood of the u with the parameters' influence projected
out, as in `fitting.noise` for curves. The covariance of the estimates is the sandwich ``A^-1 B A^-1`` with the points' own
``A = J' W J`` and ``B = a t^2 J' W^2 J + sc^2 G' k G``, ``G`` the sum of ``w_i n_i J_i`` per station.
"""

from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize

from scan2flex_jax.fitting.cloud import STATIONS, CloudEvaluator
from scan2flex_jax.fitting.noise import Noise, matern
from scan2flex_jax.inference.determined import Uncertainty, uncertainty
from scan2flex_jax.inference.settings import Settings

_SPREAD = 0.4  # standard deviation of the logarithm of the noise of points about their scatter
_LONGEST = 0.5  # of the length: correlation length
_FEWEST = 6.0  # least weight of points for a displacement at a station
_ROUND = 0.02  # least ratio of the smaller to the larger information of a station: below it, one direction is unobserved


@dataclass(frozen=True)
class Stations:
    """One pose: arc length (m), displacement u (n, 2) of the cable from the model (m), its white covariance V (n, 2, 2),
    Jacobian of u by the pose's parameters and its offset (n, 2, p), scatter of points t (m)."""

    s: np.ndarray
    u: np.ndarray
    white: np.ndarray
    slope: np.ndarray | None
    scatter: float


@dataclass(frozen=True)
class FieldNoise:
    """The noise as a `Noise` per normal of a typical station, and the factor ``a`` on the white covariances."""

    noise: Noise
    factor: float


def stations(evaluator: CloudEvaluator, e, length: float) -> list[Stations]:
    """Displacements of the cable from the model along every pose of an evaluation under the evaluator's weights."""
    return [_stations_of(evaluator.weights, e.raw, i, length) for i in range(len(e.raw.s))]


def _stations_of(weights, raw, i, length):
    w, k = weights.weight[i], _nearest_station(raw.s[i], length)
    n, e, left, Z = _rows(weights, raw, i)
    t2 = float(np.sum(w**2 * left**2) / max(np.sum(w**2), 1e-300))
    D, V = _per_station(k, w[:, None, None] * _outer(n, n)), _per_station(k, (w**2)[:, None, None] * _outer(n, n))
    size = np.linalg.eigvalsh(D)
    good = (size[:, 0] > _ROUND * np.median(size[:, 1][size[:, 1] > 0])) & (_per_station(k, w) > _FEWEST)
    inverse = np.linalg.inv(D[good])
    s = _per_station(k, w * raw.s[i])[good] / _per_station(k, w)[good]
    u = np.einsum("bij,bj->bi", inverse, _per_station(k, (w * e)[:, None] * n)[good])
    slope = None
    if Z is not None:
        slope = np.einsum("bij,bjp->bip", inverse, _per_station(k, w[:, None, None] * _outer(n, Z))[good])
    return Stations(s, u, t2 * inverse @ V[good] @ inverse, slope, np.sqrt(t2))


def _rows(weights, raw, i):
    """Per point of a pose: direction (m, 2), residual (m), residual at the field (m), and Jacobian with the offset's column."""
    n = np.einsum("mci,mi->mc", raw.normals[i], weights.direction[i])
    left = weights.distance[i] + weights.swell[i] * weights.offset[i]
    Z = None
    if raw.slope is not None:
        Z = np.concatenate([np.einsum("mc,mcx->mx", n, raw.slope[i]), weights.swell[i][:, None]], axis=1)
    return n, left + np.sum(n * raw.off[i], axis=1), left, Z


def _nearest_station(s, length):
    return np.clip(np.round(s / length * (STATIONS - 1)).astype(int), 0, STATIONS - 1)


def _outer(a, b):
    return a[:, :, None] * b[:, None, :]


def _per_station(k, values):
    """Sums (STATIONS, ...) of the points' values at their stations."""
    flat = values.reshape(len(k), -1)
    return np.stack([np.bincount(k, column, STATIONS) for column in flat.T], axis=1).reshape(STATIONS, *values.shape[1:])


def estimate_field(found: list[Stations], shared: int, length: float, settings: Settings) -> FieldNoise:
    """Restricted maximum likelihood; the first ``shared`` columns of the Jacobians are common to all poses."""
    slopes = [one.slope for one in found if one.slope is not None]
    own = slopes[0].shape[2] - shared
    columns = shared + own * len(found)
    blocks = []
    for i, one in enumerate(found):
        X = np.zeros((2 * len(one.s), columns))
        X[:, :shared] = slopes[i].reshape(-1, shared + own)[:, :shared]
        X[:, shared + own * i : shared + own * (i + 1)] = slopes[i].reshape(-1, shared + own)[:, shared:]
        blocks.append((one.s, linalg.block_diag(*one.white), one.u.ravel(), X))
    typical = np.sqrt(np.mean(np.concatenate([np.diagonal(one.white, axis1=1, axis2=2).ravel() for one in found])))
    shortest, longest = 0.01 * length, _LONGEST * length

    def negative(v):
        factor, correlated, reach = np.exp(2 * v[0]), np.exp(v[1]), np.exp(v[2])
        prior = 0.5 * (v[0] / _SPREAD) ** 2 + 0.02 * (v[1] - np.log(typical)) ** 2
        prior += 0.5 * ((v[2] - np.log(settings.correlation * length)) / settings.correlation_spread) ** 2
        bound = 1e3 * max(0.0, np.log(shortest) - v[2]) ** 2 + 1e3 * max(0.0, v[2] - np.log(longest)) ** 2
        return _restricted(blocks, factor, correlated, reach) + prior + bound

    starts = [(0.0, np.log(0.5 * typical), np.log(0.08 * length)), (0.0, np.log(3.0 * typical), np.log(0.15 * length))]
    options = {"xatol": 1e-2, "fatol": 1e-2, "maxiter": 150}
    best = min((optimize.minimize(negative, v, method="Nelder-Mead", options=options) for v in starts), key=lambda f: f.fun).x
    factor = float(np.exp(2 * best[0]))
    return FieldNoise(Noise(float(np.sqrt(factor) * typical), float(np.exp(best[1])), float(np.exp(best[2]))), factor)


def _restricted(blocks, factor, correlated, reach):
    """Negative logarithm of the restricted likelihood, up to a constant."""
    total, XX, Xr = 0.0, 0.0, 0.0
    for s, white, u, X in blocks:
        C = factor * white + correlated**2 * np.kron(matern(s, reach), np.eye(2))
        root = linalg.cholesky(C, lower=True, check_finite=False)
        scaled = linalg.solve_triangular(root, np.column_stack([u, X]), lower=True, check_finite=False)
        r, Z = scaled[:, 0], scaled[:, 1:]
        total += np.sum(np.log(np.diag(root))) + 0.5 * r @ r
        XX, Xr = XX + Z.T @ Z, Xr + Z.T @ r
    scale = np.sqrt(np.diag(XX)) + 1e-300
    values, vectors = np.linalg.eigh(XX / np.outer(scale, scale))
    keep = values > 1e-10 * max(values[-1], 1e-300)
    projected = vectors[:, keep].T @ (Xr / scale)
    return total - 0.5 * np.sum(projected**2 / values[keep]) + 0.5 * np.sum(np.log(values[keep]))


def information(evaluator: CloudEvaluator, e, field: FieldNoise, offset_spread: float, length: float):
    """Per pose ``A`` (m^2-free: in units of the points' variance) and ``B`` of the sandwich, the offset eliminated."""
    out, weights = [], evaluator.weights
    for i in range(len(e.raw.s)):
        w, s2 = weights.weight[i], weights.sigma[i] ** 2
        n, _, left, Z = _rows(weights, e.raw, i)
        t2 = np.sum(w**2 * left**2) / max(np.sum(w**2), 1e-300)
        A, B = (Z * w[:, None]).T @ Z, field.factor * t2 * (Z * (w**2)[:, None]).T @ Z
        G = _per_station(_nearest_station(e.raw.s[i], length), w[:, None, None] * _outer(n, Z))
        K = matern(np.linspace(0.0, length, STATIONS), field.noise.correlation_length)
        B += field.noise.correlated**2 * np.einsum("akp,ab,bkq->pq", G, K, G, optimize=True)
        A[-1, -1] += s2 / offset_spread**2
        B[-1, -1] += s2**2 / offset_spread**2
        T = np.vstack([np.eye(len(A) - 1), -A[-1:, :-1] / A[-1, -1]])
        out.append((T.T @ A @ T / s2, T.T @ B @ T / s2**2))
    return out


def inflation(parts, unknowns: int) -> float:
    """Factor on the points' standard deviation that weighs them correctly against the priors: the median of ``B / A``."""
    A, B = (np.sum([np.diag(p[k])[:unknowns] for p in parts], axis=0) for k in (0, 1))
    seen = A / np.max(A, initial=1e-300) > 1e-12
    return float(np.sqrt(max(1.0, np.median(B[seen] / A[seen])))) if seen.any() else 1.0


def cloud_uncertainty(layout, parts, factor: float) -> Uncertainty:
    """Covariance and open directions, from ``A`` and ``B`` of every pose and the ``factor`` that inflated the fit."""
    n, k = layout.shared, layout.local
    size = n + k * len(parts)
    prior = np.r_[layout.prior.precision(n), np.ones(size - n)]
    whole = np.diag(prior), np.diag(prior)
    for i, part in enumerate(parts):
        own = np.r_[np.arange(n), n + i * k + np.arange(k)]
        for total, one, power in zip(whole, part, (2, 4), strict=True):
            total[np.ix_(own, own)] += one / factor**power
    return uncertainty(layout, *whole)
