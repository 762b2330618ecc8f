"""The whitened residual: what the fit leaves, in units of the noise, with what the base model can absorb taken out.

Per pose the two normal components (m) at arc lengths ``s`` (m), and the tangential one of markers, have covariance ``C(s)``
(`fitting.noise`); with ``C = L L'`` the whitened residual is ``L^-1 r`` and so are the columns. Poses are stacked; below them
stand the priors of what is known only nearly (pseudo-rows of unit variance). ``M = I - Q Q'``, ``Q`` an orthonormal basis of
the base model's columns, takes out what refitting the base numbers would.

Noise is estimated by restricted likelihood in the complement of base columns *and* of a low-rank basis of all signatures,
so that an effect in the data does not make the noise look larger.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import linalg

from scan2flex_jax.fitting.discrepancy import SPREAD, foreshortening, principal
from scan2flex_jax.fitting.distance import NORMALS
from scan2flex_jax.fitting.noise import (
    Noise,
    Residual,
    most_likely,
    most_likely_with_discrepancy,
    nearest,
    plane_of,
    projected,
    restricted_likelihood,
    scanner_prior,
    spacing_of,
    thinned,
    too_large,
)

_MOST, _FEWER = 64, 40  # points of a pose that enter the likelihood of the noise, and of noise with discrepancy
_RANK = 24  # directions of all signatures together that are kept out of the noise
_KNOTS = 25  # of the residual that repeated scans of a pose share
_SMALL = 0.03  # singular value, over the largest, below which a direction of the signatures is not
_STATED = 0.15  # by what factor (one sigma, of its logarithm) a stated noise may be off
_PRIOR_ROWS = 10.0  # rows of unit variance that draw the noise of a pose to that of all
_OPEN = 1e-7  # of a unit column: a base number that no pose feels


@dataclass(frozen=True)
class Law:
    """The distribution of the residual of each pose: the sensor's ``noise``, and a discrepancy of the pose's own.

    ``curvature`` (1/m) is the size of that discrepancy, and ``scatter`` per pose the columns (m, 3, k) that it moves the
    residual along (`fitting.discrepancy`); without them there is none. ``log_prior`` (nats): the prior density of the sizes.
    ``planes``: 1 where the poses were measured in one plane, and a residual across it is zero by construction.
    ``most``: points of a pose that count, evenly along it, as many as the sizes were estimated from; 0 for all.
    ``scales``: standard deviation of the sensor's noise in each pose over that of ``noise``; none where all poses are alike.
    """

    noise: Noise
    curvature: float = 0.0
    scatter: tuple[np.ndarray, ...] = ()
    log_prior: float = 0.0
    planes: int = NORMALS
    most: int = 0
    scales: tuple[float, ...] = ()

    def of_pose(self, i: int, shape, keep) -> "Metric":
        """The metric of pose ``i``, of whose points ``keep`` are real."""
        pick = thinned(shape.s[keep], self.most) if self.most else np.arange(int(np.sum(keep)))
        keep = np.flatnonzero(keep)[pick]
        marks = np.zeros(0, int) if shape.marked is None else np.flatnonzero(np.asarray(shape.marked)[keep] > 0)
        scale = self.scales[i] if self.scales else 1.0
        factor = scale * linalg.cholesky(self.noise.covariance(shape.s[keep]), lower=True)
        along = np.zeros((0, 0))
        if len(marks):
            C = scale**2 * self.noise.covariance(shape.s[keep][marks])
            if self.curvature:
                C = C + np.diag(foreshortening(self.curvature, self.scatter[i][keep], shape.s[keep])[marks] ** 2)
            along = linalg.cholesky(C, lower=True)
        flat = plane_of(shape.residual[keep]) if self.planes == 1 else None
        sensor = Metric(pick, factor, marks, along, flat)
        if not self.curvature:
            return sensor
        Z = replace(sensor, pick=np.arange(len(pick))).white(self.scatter[i][keep])
        U, d = principal(Z)
        return replace(sensor, U=U, spread=self.curvature * d)


@dataclass(frozen=True)
class Metric:
    """What makes the residual of one pose white: rows of its normals at all points, then of the tangents at markers.

    ``pick`` (m,): the points that count, of all. ``factor`` (m, m) and ``along`` (k, k) are Cholesky factors of the sensor's
    covariance, of points and of the ``marks`` among them; ``plane`` (2,) is the one normal that counts of a pose that was
    measured in a plane. In rows that those have made white, the discrepancy adds ``spread**2`` of variance along each column
    of ``U``.
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
        """Rows of the normals."""
        return len(self.factor) * (NORMALS if self.plane is None else 1)

    @property
    def rows(self) -> int:
        """How many in all."""
        return self.normals + len(self.marks)

    @property
    def log_det(self) -> float:
        """Half the logarithm of the determinant of the covariance."""
        total = self.normals * np.mean(np.log(np.diag(self.factor))) + np.sum(np.log(np.diag(self.along)))
        return float(total + (0.0 if self.spread is None else 0.5 * np.sum(np.log1p(self.spread**2))))

    def white(self, columns: np.ndarray) -> np.ndarray:
        """White rows of columns (points, 3, K)."""
        columns = columns[self.pick]
        normal = columns[:, :NORMALS] if self.plane is None else projected(columns, self.plane)[:, :1]
        rows = _whiten(self.factor, normal)
        if len(self.marks):
            tangent = linalg.solve_triangular(self.along, columns[self.marks, NORMALS], lower=True)
            rows = np.concatenate([rows, tangent])
        return self._scaled(rows, -0.5)

    def back(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Normal components (m, 2, K) and those along the tangents of markers (k, K), in m, of white rows (n, K),
        at the points that count."""
        normal, tangent = np.split(self._scaled(rows, 0.5), [self.normals])
        m = len(self.factor)
        normal = (self.factor @ normal.reshape(m, -1)).reshape(m, -1, rows.shape[1])
        return normal if self.plane is None else normal * self.plane[:, None], self.along @ tangent

    def _scaled(self, rows, power):
        if self.U is None or self.spread is None:
            return rows
        return rows + self.U @ (((1.0 + self.spread**2) ** power - 1.0)[:, None] * (self.U.T @ rows))


@dataclass(frozen=True)
class Whitened:
    """Residual ``r`` (n,), columns ``J`` (n, b) of all base numbers, and per pose its metric, its rows, and which of its
    points are real."""

    r: np.ndarray
    J: np.ndarray
    metrics: tuple[Metric, ...]
    rows: tuple
    real: tuple
    priors: int

    @property
    def normals(self) -> tuple[np.ndarray, ...]:
        """Per pose the rows of both normals."""
        return tuple(rows[: m.normals] for rows, m in zip(self.rows, self.metrics, strict=True))

    @property
    def log_det(self) -> float:
        """Half the logarithm of the determinant of the covariance of all poses."""
        return sum(m.log_det for m in self.metrics)

    def squares(self, i: int, values: np.ndarray) -> float:
        """Sum of the squared lengths (m^2) of all residuals of pose ``i``, from its whitened rows."""
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
    """From solved shapes (columns of the base numbers first) at ``vector``."""
    metrics = tuple(law.of_pose(i, shape, keep) for i, (shape, keep) in enumerate(zip(shapes, real, strict=True)))
    ends = np.cumsum([m.rows for m in metrics])
    rows = tuple(np.arange(end - m.rows, end) for m, end in zip(metrics, ends, strict=True))
    at, known = int(ends[-1]), np.r_[numbers.nearly_known]
    r, J = np.zeros(at + len(known)), np.zeros((at + len(known), numbers.count))
    for i, (shape, keep) in enumerate(zip(shapes, real, strict=True)):
        own = numbers.of_pose(i)
        both = np.concatenate([shape.residual[keep][:, :, None], shape.columns[keep][:, :, : len(own)]], axis=-1)
        white = metrics[i].white(both)
        r[rows[i]], J[np.ix_(rows[i], own)] = white[:, 0], white[:, 1:]
    r[at:] = (vector[known] - numbers.prior_mean) / numbers.prior_std
    J[at + np.arange(len(known)), known] = 1.0 / numbers.prior_std
    return Whitened(r, J, metrics, rows, tuple(real), len(known))


def _whiten(factor, columns):
    """Both normals, one after the other."""
    m, c, k = columns.shape
    return linalg.solve_triangular(factor, columns.reshape(m, -1), lower=True).reshape(m * c, k)


def _three(normals):
    """Columns (m, 2, k) along the normals with none along the tangent."""
    return np.concatenate([normals, np.zeros_like(normals[:, :1])], axis=1)


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


def scales_of_poses(white: Whitened, signatures) -> tuple[float, ...]:
    """Standard deviation of the noise in each pose over that of all, from white residuals with the model's numbers and the
    directions ``signatures`` (per pose (m, 2, K)) of all effects taken out; drawn to one as by `_PRIOR_ROWS` rows of unit
    variance.

    A scan that sees a cable from one side only errs several times as much as one from three sides.
    """
    Z = np.zeros((len(white.r), signatures[0].shape[-1]))
    for rows, metric, own in zip(white.rows, white.metrics, signatures, strict=True):
        Z[rows] = metric.white(_three(own))
    Q = orthonormal(np.column_stack([white.J, Z]))
    y = white.r - Q @ (Q.T @ white.r)
    free = np.array([len(rows) - np.sum(Q[rows] ** 2) for rows in white.rows])
    squares = np.array([np.sum(y[rows] ** 2) for rows in white.rows])
    return tuple(float(v) for v in np.sqrt((squares + _PRIOR_ROWS) / (free + _PRIOR_ROWS)))


class Complement:
    """Restricted likelihood of the noise in the complement of the model's numbers (under their priors) and signatures.

    ``signatures`` (per pose (m, 2, K)) are directions that carry them; none for the noise beside one model alone. Poses that
    were scanned again (``repeats``, groups of indices) share a residual of any shape, of which only their differences are
    noise. ``scatter``: per pose the columns of its discrepancy; ``scales``: those of a `Law`. Long curves are thinned first.
    """

    def __init__(
        self, shapes, real, numbers, vector, signatures, length, stated=None, repeats=(), scatter=(), planes=NORMALS, free=True,
        alike=0.0, scales=(),
    ):
        """Thinned curves and columns, each with where its columns stand; the model's own only where it is ``free``."""
        self.length, self.stated, self.planes, self.alike, self.scales, self.poses = length, stated, planes, alike, scales, []
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
            pose = Residual(shape.s[keep], shape.residual[keep], X, at, Z, marked).thinned(_FEWER if len(scatter) else _MOST)
            pose = pose.over(scales[i]) if len(scales) else pose
            self.poses.append(pose.in_plane() if planes == 1 else pose)
        self.precision, self.pull = np.zeros(columns), np.zeros(columns)
        known = numbers.nearly_known
        self.precision[known] = numbers.prior_std**-2
        self.pull[known] = self.precision[known] * (vector[known] - numbers.prior_mean)
        size = np.sqrt(np.mean([np.mean(p.r[:, :-1] ** 2) for p in self.poses]))
        self.size = max(size, 1e-12 * length)
        self.shortest = max(spacing_of([p.s for p in self.poses]), 0.01 * length)

    def __call__(self, noise: Noise, u, curvature: float = 0.0) -> float:
        """Negative log likelihood with weak priors at ``u`` = logarithms of white, correlated (m) and length (m) of a noise."""
        given = self.poses, noise, self.precision, self.pull, curvature
        return restricted_likelihood(*given) + self._prior(u, noise)

    def law(self, noise: Noise, usual: float, scatter, near: Law | None = None) -> Law:
        """The most likely noise and discrepancy, begun at a noise, or at a law that is ``near``; ``usual`` (1/m) as in
        `fitting.discrepancy`."""
        found, curvature, _ = self._likeliest(noise, usual, near)
        u = np.log([found.white, found.correlated, found.correlation_length])
        prior = self._prior(u, found) + (0.0 if self.stated else too_large(found, self.length))
        prior += (0.5 * (np.log(curvature / usual) / SPREAD) ** 2 if curvature else 0.0)
        return Law(found, curvature, tuple(scatter) if curvature else (), -float(prior), self.planes, _FEWER, self.scales)

    def gain(self, noise: Noise, usual: float) -> float:
        """Nats that a discrepancy gains beside the most likely noise."""
        alone = nearest(self._of_a_scanner, noise, self.length)
        u = np.log([alone.white, alone.correlated, alone.correlation_length])
        return float(self._of_a_scanner(alone, u) - self._likeliest(noise, usual)[2])

    def _likeliest(self, noise, usual, near=None):
        begun = (near.noise, near.curvature) if near is not None and near.curvature else None
        noise = nearest(self._of_a_scanner, noise, self.length)
        return most_likely_with_discrepancy(self._of_a_scanner, noise, usual, self.length, begun)

    def _of_a_scanner(self, noise, u, curvature=0.0):
        """The same, with no noise larger than those of scanners unless it was stated."""
        return self(noise, u, curvature) + (0.0 if self.stated else too_large(noise, self.length))

    def _prior(self, u, noise):
        L = self.length
        prior = 0.5 * ((u[2] - np.log(0.07 * L)) / 0.6) ** 2 + 0.02 * (u[1] - u[0]) ** 2
        prior += 0.5 * (np.log(noise.total / self.stated) / _STATED) ** 2 if self.stated else scanner_prior(noise, L)
        beyond = max(0.0, np.log(self.shortest) - u[2]) ** 2 + max(0.0, u[2] - np.log(0.3 * L)) ** 2
        return prior + 1e3 * beyond

    @cached_property
    def estimate(self) -> Noise:
        """The most likely noise."""
        return most_likely(self, self.stated or self.size, self.length, self.alike)

    def draws(self, noise: Noise, count: int, rng) -> list[Noise]:
        """Noises as likely as the estimated one: a normal law in their logarithms with the likelihood's curvature."""
        u, h, E = np.log([noise.white, noise.correlated, noise.correlation_length]), 0.08, np.eye(3)
        H = np.zeros((3, 3))

        def at(v):
            return self(noise.moved(v), v)

        for i in range(3):
            for j in range(i + 1):
                a, b = h * E[i], h * E[j]
                H[i, j] = H[j, i] = (at(u + a + b) - at(u + a - b) - at(u - a + b) + at(u - a - b)) / (4 * h * h)
        values, vectors = np.linalg.eigh(H)
        spread = vectors / np.sqrt(np.maximum(values, 4.0))
        found = [u + np.clip(spread @ rng.standard_normal(3), -0.7, 0.7) for _ in range(count)]
        return [noise.moved(v) for v in found]


def noise_like(white: Whitened, shapes, laws, count: int, rng) -> np.ndarray:
    """``count`` draws (n, count) of pure noise of the given laws, whitened as the residual was; priors' rows too."""
    out = rng.standard_normal((len(white.r), count))
    share = np.array_split(np.arange(count), len(laws))
    for law, mine in zip(laws, share, strict=True):
        for i, (metric, rows, real) in enumerate(zip(white.metrics, white.rows, white.real, strict=True)):
            normal, tangent = law.of_pose(i, shapes[i], real).back(out[np.ix_(rows, mine)])
            drawn = np.zeros((len(normal), NORMALS + 1, len(mine)))
            drawn[:, :NORMALS] = normal
            drawn[metric.marks, NORMALS] = tangent
            out[np.ix_(rows, mine)] = replace(metric, pick=np.arange(len(normal))).white(drawn)
    return out
