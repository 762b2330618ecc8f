"""The whitened residual: the residual in units of the noise, projected off the columns of the base parameters.

Per pose the two normal components (m) at arc lengths ``s`` (m), and the tangential one of markers, have covariance ``C(s)``
(`fitting.noise`); with ``C = L L'`` the residual and the columns are whitened by ``L^-1``. Poses are stacked; the priors of the
nuisance parameters follow as pseudo-rows of unit variance. ``M = I - Q Q'``, ``Q`` an orthonormal basis of the base columns,
removes the part of a residual that a refit of the base parameters would remove.

Noise is estimated by restricted likelihood in the complement of base columns *and* of a low-rank basis of all signatures,
so that an effect in the data does not inflate the noise.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy import linalg

from scan2flex_jax.diagnosis.settings import USUAL
from scan2flex_jax.fitting.discrepancy import foreshortening, principal
from scan2flex_jax.fitting.distance import NORMALS
from scan2flex_jax.fitting.likelihood import (
    NoisePrior,
    Residual,
    RestrictedLikelihood,
    in_plane_normal,
    projected,
    shortest_of,
    thinned,
)
from scan2flex_jax.fitting.noise import Noise, logarithms, most_likely, most_likely_with_discrepancy, nearest
from scan2flex_jax.fitting.settings import NoiseSettings

_MOST, _FEWER = 64, 40  # points of a pose that enter the likelihood of the noise, and of noise with discrepancy
_RANK = 24  # directions of the signature basis
_KNOTS = 25  # of the residual shared by repeated scans of a pose
_SMALL = 0.03  # singular value, over the largest, below which a direction of the signatures is dropped
_OPEN = 1e-7  # of a unit column: an unidentifiable base parameter


@dataclass(frozen=True)
class Law:
    """The distribution of the residual of each pose: the sensor's ``noise``, and a discrepancy of the pose's own.

    ``curvature`` (1/m) is the size of that discrepancy, and ``scatter`` per pose its columns (m, 3, k) in the residual
    (`fitting.discrepancy`); empty without a discrepancy. ``log_prior`` (nats): log prior density of the sizes.
    ``across``: the normal (3,) of the plane in which all poses were measured, if any: across it nothing was.
    ``most``: points of a pose that are used, evenly along it, as many as in the estimate of the sizes; 0 for all.
    ``scales``: standard deviation of the sensor's noise in each pose over that of ``noise``; empty if all poses are alike.
    ``places``: the points that the law was estimated from. It then is one covariance for every residual: were it evaluated at
    the arc lengths of each model, the least cost would not be where the derivatives of the residual put it.
    """

    noise: Noise
    curvature: float = 0.0
    scatter: tuple[np.ndarray, ...] = ()
    log_prior: float = 0.0
    across: np.ndarray | None = None
    most: int = 0
    scales: tuple[float, ...] = ()
    places: tuple["Place", ...] = ()

    def only(self, which) -> "Law":
        """The law of the poses ``which``, in this order."""
        every = (self.scatter, self.scales, self.places)
        scatter, scales, places = (tuple(values[i] for i in which) if values else () for values in every)
        return replace(self, scatter=scatter, scales=scales, places=places)

    def metrics(self, shapes, real) -> tuple["Metric", ...]:
        """The metrics of all poses: at the law's own places, or else at the real points of the shapes."""
        return self._own if self.places else tuple(map(self._metric, range(len(real)), self.at(shapes, real)))

    def at(self, shapes, real) -> tuple["Place", ...]:
        """The places of the points that the law uses of shapes."""
        return tuple(Place.of(shape, keep, self.most, self.across) for shape, keep in zip(shapes, real, strict=True))

    @cached_property
    def _own(self):
        return tuple(self._metric(i, place) for i, place in enumerate(self.places))

    def covariance(self, i: int, s: np.ndarray) -> np.ndarray:
        """Covariance (m, m), in m^2, of the sensor's noise of pose ``i`` at arc lengths (m)."""
        return (self.scales[i] if self.scales else 1.0) ** 2 * self.noise.covariance(s)

    def _metric(self, i, place):
        pick, keep, s, _, marks, flat = place
        factor = linalg.cholesky(self.covariance(i, s), lower=True)
        along = np.zeros((0, 0))
        if len(marks):
            C = self.covariance(i, s[marks])
            if self.curvature:
                C = C + np.diag(foreshortening(self.curvature, self.scatter[i][keep], s)[marks] ** 2)
            along = linalg.cholesky(C, lower=True)
        sensor = Metric(pick, factor, marks, along, flat)
        if not self.curvature:
            return sensor
        Z = replace(sensor, pick=np.arange(len(pick))).white(self.scatter[i][keep])
        U, d = principal(Z)
        return replace(sensor, U=U, spread=self.curvature * d)


class Place(NamedTuple):
    """The points of one pose that a law uses: their indices among the real points (``pick``) and among all (``keep``), arc
    lengths ``s`` (m,), the ``axes`` (m, 3, 3) of their residual, the markers ``marks`` among them, and the in-plane normals
    ``flat`` (m, 2) of a pose measured in one plane."""

    pick: np.ndarray
    keep: np.ndarray
    s: np.ndarray
    axes: np.ndarray
    marks: np.ndarray
    flat: np.ndarray | None

    @classmethod
    def of(cls, shape, keep: np.ndarray, most: int, across: np.ndarray | None) -> "Place":
        """At most ``most`` (0: all) of the points of a shape that ``keep`` marks as real; ``across`` as in `Law`."""
        pick = thinned(shape.s[keep], most) if most else np.arange(int(np.sum(keep)))
        at = np.flatnonzero(keep)[pick]
        marks = np.zeros(0, int) if shape.marked is None else np.flatnonzero(np.asarray(shape.marked)[at] > 0)
        flat = None if across is None else in_plane_normal(shape.axes[at], across)
        return cls(pick, at, shape.s[at], shape.axes[at], marks, flat)

    def take(self, shape, columns: np.ndarray) -> np.ndarray:
        """Columns (points, 3, K) in the residual of any shape, at these points (m, 3, K) and along these axes."""
        return turned(columns[self.keep], shape.axes[self.keep], self.axes)


@dataclass(frozen=True)
class Metric:
    """Whitening of the residual of one pose: rows of its normals at all points, then of the tangents at markers.

    ``pick`` (m,): the points used. ``factor`` (m, m) and ``along`` (k, k) are Cholesky factors of the sensor's covariance, of
    points and of the ``marks`` among them; ``plane`` (m, 2) holds the in-plane normals of a pose measured in one plane. In rows
    whitened by these, the discrepancy adds the variance ``spread**2`` along each column of ``U``.
    """

    pick: np.ndarray
    factor: np.ndarray
    marks: np.ndarray
    along: np.ndarray
    plane: np.ndarray | None = None
    U: np.ndarray | None = None
    spread: np.ndarray | None = None

    @property
    def normals(self) -> int:
        """Number of rows of the normals."""
        return len(self.factor) * (NORMALS if self.plane is None else 1)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.normals + len(self.marks)

    @property
    def log_det(self) -> float:
        """Half the logarithm of the determinant of the covariance."""
        total = self.normals * np.mean(np.log(np.diag(self.factor))) + np.sum(np.log(np.diag(self.along)))
        return float(total + (0.0 if self.spread is None else 0.5 * np.sum(np.log1p(self.spread**2))))

    def white(self, columns: np.ndarray) -> np.ndarray:
        """Whitened rows of columns (points, 3, K)."""
        columns = columns[self.pick]
        normal = columns[:, :NORMALS] if self.plane is None else projected(columns, self.plane)[:, :1]
        rows = _whiten(self.factor, normal)
        if len(self.marks):
            tangent = linalg.solve_triangular(self.along, columns[self.marks, NORMALS], lower=True)
            rows = np.concatenate([rows, tangent])
        return self._scaled(rows, -0.5)

    def back(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Inverse of `white` at the points used: normal components (m, 2, K) and those along the tangents of markers (k, K),
        in m, of whitened rows (n, K)."""
        normal, tangent = np.split(self._scaled(rows, 0.5), [self.normals])
        m = len(self.factor)
        normal = (self.factor @ normal.reshape(m, -1)).reshape(m, -1, rows.shape[1])
        return normal if self.plane is None else normal * self.plane[:, :, None], self.along @ tangent

    def _scaled(self, rows, power):
        if self.U is None or self.spread is None:
            return rows
        return rows + self.U @ (((1.0 + self.spread**2) ** power - 1.0)[:, None] * (self.U.T @ rows))


@dataclass(frozen=True)
class Whitened:
    """Residual ``r`` (n,), columns ``J`` (n, b) of all parameters, and per pose its metric, its rows, and the mask of its
    real points."""

    r: np.ndarray
    J: np.ndarray
    metrics: tuple[Metric, ...]
    rows: tuple
    real: tuple
    priors: int

    @property
    def normals(self) -> tuple[np.ndarray, ...]:
        """Per pose the rows of its normals."""
        return tuple(rows[: m.normals] for rows, m in zip(self.rows, self.metrics, strict=True))

    @property
    def log_det(self) -> float:
        """Half the logarithm of the determinant of the covariance of all poses."""
        return sum(m.log_det for m in self.metrics)

    def squares(self, i: int, values: np.ndarray) -> float:
        """Sum of squared residuals (m^2) of pose ``i``, from its whitened rows."""
        return float(sum(np.sum(part**2) for part in self.metrics[i].back(values[:, None])))

    def stack(self, columns) -> np.ndarray:
        """Columns (m, 3, K) per pose, whitened and stacked, (n, K)."""
        out = np.zeros((len(self.r), columns[0].shape[-1]))
        for metric, rows, real, c in zip(self.metrics, self.rows, self.real, columns, strict=True):
            out[rows] = metric.white(c[real])
        return out

    @property
    def base(self) -> np.ndarray:
        """Orthonormal basis of the base columns."""
        return orthonormal(self.J, _OPEN)


def whiten(shapes, real, numbers, vector, law: Law) -> Whitened:
    """Whiten the residuals and columns of solved shapes at ``vector``, and append the priors of the nuisance parameters."""
    metrics = law.metrics(shapes, real)
    ends = np.cumsum([m.rows for m in metrics])
    rows = tuple(np.arange(end - m.rows, end) for m, end in zip(metrics, ends, strict=True))
    at, known = int(ends[-1]), np.r_[numbers.nuisance]
    r, J = np.zeros(at + len(known)), np.zeros((at + len(known), numbers.count))
    for i, (shape, keep) in enumerate(zip(shapes, real, strict=True)):
        own = numbers.of_pose(i)
        both = np.concatenate([shape.residual[:, :, None], shape.columns[:, :, : len(own)]], axis=-1)
        if law.places:
            both[law.places[i].keep] = law.places[i].take(shape, both)
        white = metrics[i].white(both[keep])
        r[rows[i]], J[np.ix_(rows[i], own)] = white[:, 0], white[:, 1:]
    r[at:] = (vector[known] - numbers.prior_mean) / numbers.prior_std
    J[at + np.arange(len(known)), known] = 1.0 / numbers.prior_std
    return Whitened(r, J, metrics, rows, tuple(real), len(known))


def turned(columns: np.ndarray, axes: np.ndarray, onto: np.ndarray) -> np.ndarray:
    """Columns (m, 3, K) along axes (m, 3, 3) in rows, turned about the tangents to the axes that the smallest rotation between
    the tangents carries from ``onto`` (m, 3, 3): the normals of two models of one pose may differ by any angle."""
    B = np.einsum("mik,mjk->mij", onto, axes)
    angle = np.arctan2(B[:, 1, 0] - B[:, 0, 1], B[:, 0, 0] + B[:, 1, 1])
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    return np.stack([c * columns[:, 0] - s * columns[:, 1], s * columns[:, 0] + c * columns[:, 1], columns[:, 2]], axis=1)


def _whiten(factor, columns):
    """Whitened rows of both normals, interleaved."""
    m, c, k = columns.shape
    return linalg.solve_triangular(factor, columns.reshape(m, -1), lower=True).reshape(m * c, k)


def _three(normals):
    """Columns (m, 2, k) along the normals, extended by a zero tangential component."""
    return np.concatenate([normals, np.zeros_like(normals[:, :1])], axis=1)


def orthonormal(X: np.ndarray, small: float = 1e-10) -> np.ndarray:
    """Orthonormal basis of the columns, after normalising each."""
    size = np.linalg.norm(X, axis=0)
    if not np.any(size > 0):
        return np.zeros((len(X), 0))
    U, d, _ = np.linalg.svd(X[:, size > 0] / size[size > 0], full_matrices=False)
    return U[:, d > small * d[0]]


def signature_basis(columns: np.ndarray, base: np.ndarray, rank: int = _RANK) -> np.ndarray:
    """Principal directions of the signatures, each projected off the base and normalised."""
    X = columns - base @ (base.T @ columns)
    size, full = np.linalg.norm(X, axis=0), np.linalg.norm(columns, axis=0)
    X = X[:, size > 1e-6 * full.max(initial=1e-300)]
    X = X / np.linalg.norm(X, axis=0)
    values, vectors = np.linalg.eigh(X.T @ X)
    keep = np.argsort(values)[::-1][:rank]
    keep = keep[values[keep] > _SMALL**2 * values[-1]]
    return X @ (vectors[:, keep] / np.sqrt(values[keep]))


def scales_of_poses(white: Whitened, signatures, prior_rows: float) -> tuple[float, ...]:
    """Standard deviation of the noise in each pose over that of all, from whitened residuals projected off the model's
    columns and the ``signatures`` (per pose (m, 2, K)) of all effects; shrunk to one by ``prior_rows`` rows of variance one.

    A scan of a cable from one side has several times the error of one from three sides.
    """
    Z = np.zeros((len(white.r), signatures[0].shape[-1]))
    for rows, metric, own in zip(white.rows, white.metrics, signatures, strict=True):
        Z[rows] = metric.white(_three(own))
    Q = orthonormal(np.column_stack([white.J, Z]))
    y = white.r - Q @ (Q.T @ white.r)
    free = np.array([len(rows) - np.sum(Q[rows] ** 2) for rows in white.rows])
    squares = np.array([np.sum(y[rows] ** 2) for rows in white.rows])
    return tuple(float(v) for v in np.sqrt((squares + prior_rows) / (free + prior_rows)))


class Complement:
    """Restricted likelihood of the noise in the complement of the model's columns (under their priors) and of signatures.

    ``signatures``: their basis, per pose (m, 2, K); empty for the noise given one model. Poses scanned again (``repeats``,
    groups of indices) share a residual of any shape, so that only their differences are noise. ``scatter``: per pose the
    columns of its discrepancy; ``scales``: those of a `Law`. Long curves are thinned first.
    """

    def __init__(
        self, shapes, real, numbers, vector, signatures, length, stated=None, repeats=(), scatter=(), across=None, free=True,
        alike=0.0, scales=(), settings: NoiseSettings = USUAL,
    ):
        """Thin curves and columns and index the columns; those of the model are zero unless its parameters are ``free``."""
        self.length, self.stated, self.across, self.alike, self.scales, poses = length, stated, across, alike, scales, []
        self.settings, self._shapes, self._real = settings, shapes, real
        extra = signatures[0].shape[-1] if signatures else 0
        columns = numbers.count + extra + len(repeats) * NORMALS * _KNOTS
        for i, (shape, keep) in enumerate(zip(shapes, real, strict=True)):
            own = numbers.of_pose(i)
            X = shape.columns[keep][:, :, : len(own)] * float(free)
            X = np.concatenate([X, _three(signatures[i])], axis=-1) if signatures else X
            at = np.r_[own, numbers.count + np.arange(extra)]
            for k in [k for k, group in enumerate(repeats) if i in group]:
                hats = np.clip(1 - np.abs(shape.s[keep][:, None] * (_KNOTS - 1) / length - np.arange(_KNOTS)), 0, 1)
                both = np.einsum("mk,ab->mabk", hats, np.eye(NORMALS)).reshape(len(X), NORMALS, -1)
                X = np.concatenate([X, _three(both)], axis=-1)
                at = np.r_[at, numbers.count + extra + k * NORMALS * _KNOTS + np.arange(NORMALS * _KNOTS)]
            Z = scatter[i][keep] if len(scatter) else None
            marked = None if shape.marked is None or signatures else np.asarray(shape.marked)[keep] > 0
            pose = Residual(shape.s[keep], shape.residual[keep], X, at, Z, marked)
            pose = pose if across is None else pose.in_plane(in_plane_normal(shape.axes[keep], across))
            pose = pose.over(scales[i]) if len(scales) else pose
            poses.append(pose.thinned(_FEWER if len(scatter) else _MOST))
        precision, pull = np.zeros(columns), np.zeros(columns)
        known = numbers.nuisance
        precision[known] = numbers.prior_std**-2
        pull[known] = precision[known] * (vector[known] - numbers.prior_mean)
        size = np.sqrt(np.mean([np.mean(p.r[:, :-1] ** 2) for p in poses]))
        self.size = max(size, 1e-12 * length)
        prior = NoisePrior(length, stated, shortest_of(poses, length), scanner=True, settings=settings)
        self.likelihood = RestrictedLikelihood(poses, prior, precision, pull)

    def law(self, noise: Noise, usual: float, scatter, near: Law | None = None) -> Law:
        """The most likely noise and discrepancy, starting from a noise or from a law that is ``near``; ``usual`` (1/m) as in
        `fitting.discrepancy`."""
        found, curvature, _ = self._likeliest(noise, usual, near)
        prior = self.likelihood.prior(found, logarithms(found), discrepancy=True)
        prior += (0.5 * (np.log(curvature / usual) / self.settings.discrepancy_spread) ** 2 if curvature else 0.0)
        law = Law(found, curvature, tuple(scatter) if curvature else (), -float(prior), self.across, _FEWER, self.scales)
        return self.placed(law)

    def placed(self, law: Law) -> Law:
        """The law at the places of this residual."""
        return replace(law, places=law.at(self._shapes, self._real))

    def gain(self, noise: Noise, usual: float) -> float:
        """Log likelihood (nats) gained by a discrepancy over the most likely noise alone."""
        alone = nearest(self.likelihood.with_discrepancy, noise, self.length)
        return float(self.likelihood.with_discrepancy(alone, logarithms(alone)) - self._likeliest(noise, usual)[2])

    def _likeliest(self, noise, usual, near=None):
        begun = (near.noise, near.curvature) if near is not None and near.curvature else None
        noise = nearest(self.likelihood.with_discrepancy, noise, self.length)
        likelihood = self.likelihood.with_discrepancy
        return most_likely_with_discrepancy(likelihood, noise, usual, self.length, begun, self.settings)

    @cached_property
    def estimate(self) -> Noise:
        """The most likely noise."""
        return most_likely(self.likelihood, self.stated or self.size, self.length, self.alike)

    def draws(self, noise: Noise, count: int, rng) -> list[Noise]:
        """Samples of the noise about the estimate: normal in the logarithms, with the curvature of the likelihood."""
        u, h, E = logarithms(noise), 0.08, np.eye(3)
        H = np.zeros((3, 3))

        def at(v):
            return self.likelihood(noise.moved(v), v)

        for i in range(3):
            for j in range(i + 1):
                a, b = h * E[i], h * E[j]
                H[i, j] = H[j, i] = (at(u + a + b) - at(u + a - b) - at(u - a + b) + at(u - a - b)) / (4 * h * h)
        values, vectors = np.linalg.eigh(H)
        spread = vectors / np.sqrt(np.maximum(values, 4.0))
        found = [u + np.clip(spread @ rng.standard_normal(3), -0.7, 0.7) for _ in range(count)]
        return [noise.moved(v) for v in found]


def noise_like(white: Whitened, shapes, laws, count: int, rng) -> np.ndarray:
    """``count`` draws (n, count) of pure noise of the given laws, whitened like the residual, with the rows of the priors."""
    out = rng.standard_normal((len(white.r), count))
    share = np.array_split(np.arange(count), len(laws))
    for law, mine in zip(laws, share, strict=True):
        for metric, rows, own in zip(white.metrics, white.rows, law.metrics(shapes, white.real), strict=True):
            normal, tangent = own.back(out[np.ix_(rows, mine)])
            drawn = np.zeros((len(normal), NORMALS + 1, len(mine)))
            drawn[:, :NORMALS] = normal
            drawn[metric.marks, NORMALS] = tangent
            out[np.ix_(rows, mine)] = replace(metric, pick=np.arange(len(normal))).white(drawn)
    return out
