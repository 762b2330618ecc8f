"""Measured points of the poses as rows of arrays of one shape: averages over bins of neighbouring points.

A pose has one row a bin along the first normal of the model curve, then along the second, then along the tangent for markers.
Points that lie in a plane with gravity have one normal, that in the plane: their exact zeros across it are no measurement, but
the cable was near that plane. Some rows across it, of a wide noise (`Likelihood.covariance`), keep a model there. Markers of
which some coordinates were measured have rows of these alone. The scatter of points within their bins shows the white noise
whatever the model.
"""

from itertools import pairwise

import numpy as np

BINS = 30  # of a pose: enough to resolve the correlation of its noise
_NEAR = 0.05  # of the largest arc length: `foreshortening` has no limit at the start
_FLAT, _TINY = 1e-6, 1e-12  # of the largest extent: points in one plane
_ACROSS = 6  # rows of a pose across a plane
_SCATTERED = 4  # points of a bin from which on they show the noise within it


class Rows:
    """The rows of P poses, N each, padded.

    For each row (P, N): ``count`` of its points, ``pad`` 1 where it is none, ``tangent`` 1 along the tangent, ``across`` 1
    across a plane of all points, ``near`` (m) its arc length, ``known`` (m) the noise of a reading that states its own, else 0;
    for each pair (P, N, N): ``lag`` (m), the RMS distance of two of
    their points, and ``same`` 1 in one direction. ``noise`` (P, 1): the noise of each pose over that of all (`Poses`).

    ``dof`` and ``scatter`` (m^2): degrees of freedom and sum of squares of points within bins about their lines, as many as
    there are rows at most; ``inside`` (k,) m: their usual places in a bin.
    """

    def __init__(self, shapes, program):
        """From the shapes at which the directions of the rows are fixed."""
        study, points, poses = program.problem.study, program.context.points, program.poses
        self.noise = np.ones((len(shapes), 1)) if poses.noise is None else poses.noise[:, None]
        across = plane_normal(points, study.gravity) if poses.rows is None else None
        known = None if poses.readings is None else np.asarray(poses.readings.noise)
        self.bins: list[list[np.ndarray]] = []
        self.kept: list[tuple[list[int], list[int], list[int]]] = []
        self.points: list[int] = []
        self.axes, self.mean = [], []
        for i, (shape, keep) in enumerate(zip(shapes, program.real, strict=True)):
            self._add(poses, i, shape, keep, across)
        self.count_of = [len(g) + sum(map(len, kept)) for g, kept in zip(self.bins, self.kept, strict=True)]
        P, N = len(shapes), max(self.count_of)
        self.poses, self.rows = P, N
        self.same, self.lag = np.zeros((P, N, N)), np.zeros((P, N, N))
        self.count, self.pad, self.near = np.ones((P, N)), np.ones((P, N)), np.ones((P, N))
        self.tangent, self.across, self.known = np.zeros((P, N)), np.zeros((P, N)), np.zeros((P, N))
        self.dof, self.scatter, lags, gaps = 0.0, 0.0, [], []
        for i, (shape, groups, (second, off, along)) in enumerate(zip(shapes, self.bins, self.kept, strict=True)):
            s, size, k = np.array([shape.s[g].mean() for g in groups]), np.array([len(g) for g in groups]), self.points[i]
            blocks = [np.arange(len(s)), *(np.array(part, int) for part in (second, off, along))]
            where, ends = np.concatenate(blocks), np.cumsum([0, *map(len, blocks)])
            n = len(where)
            self.count[i, :n], self.pad[i, :n] = size[where], 0.0
            width = float(np.median([np.ptp(shape.s[g]) for g in groups[:k] or groups]))  # over which the noise is averaged
            self.lag[i, :n, :n] = np.sqrt((s[where][:, None] - s[where]) ** 2 + width**2 / 6.0)
            self.near[i, :n] = np.maximum(s[where], _NEAR * max(s.max(), 1e-12))
            other = where >= k  # readings, each with an instrument and a noise of its own
            self.across[i, ends[-3] : ends[-2]], self.tangent[i, ends[-2] : n] = 1.0, ~other[ends[-2] :]
            for a, b in pairwise(ends):
                self.same[i, a:b, a:b] = ~other[a:b] & ~other[a:b, None]
            self.known[i, :n] = 0.0 if known is None else known[i][np.array([g[0] for g in groups])[where]]
            gaps += [np.median(np.diff(np.sort(s[:k])))] if k > 1 else []
            lags += self._within(i, shape, groups[:k], 1 + (0 in second))
        self.inside = np.zeros(0)
        if self.dof:
            width, size = np.median(np.array(lags), axis=0)
            self.inside = np.linspace(0.0, width, round(float(size)))
            share = min(1.0, float(np.sum(1 - self.pad)) / self.dof)  # neighbours tell the form of the noise at their lags only
            self.dof, self.scatter = share * self.dof, share * self.scatter
        self.gap = float(np.median(gaps)) if gaps else 0.0

    def _add(self, poses, i, shape, keep, across):
        """The bins of a pose, one for each reading that is no point after those of its points, and the directions of each."""
        at, others = np.flatnonzero(poses.seen[i]), np.flatnonzero(keep & ~poses.seen[i])
        groups = np.array_split(at[np.argsort(shape.s[at], kind="stable")], min(BINS, len(at))) if len(at) else []
        some = 0 if poses.rows is None else int(np.count_nonzero(np.any(poses.rows[i] != 0, axis=1)))
        marked = np.zeros(len(keep), bool) if shape.marked is None else np.asarray(shape.marked) > 0
        u, count = None if across is None else in_plane_normal(shape.axes, across), len(groups)
        values = poses.coordinates(i)[others] if len(others) else np.zeros(0, int)
        second = [] if across is not None or some == 1 else list(range(count))
        off = [] if across is None else list(range(0, count, max(-(-count // _ACROSS), 1)))
        along = [k for k, g in enumerate(groups) if np.all(marked[g])] if some in (0, 3) else []
        second, along = ([*own, *(count + np.flatnonzero(values > n)).tolist()] for n, own in ((1, second), (2, along)))
        if u is not None:
            u[others] = 1.0, 0.0
        groups = [*groups, *others[:, None]]
        self.points.append(count)
        self.bins.append(groups)
        self.mean.append(np.stack([np.bincount(g, minlength=len(keep)) / len(g) for g in groups]))
        self.axes.append((shape.axes, u, some > 0))
        self.kept.append((second, off, along))

    @property
    def measured(self) -> np.ndarray:
        """Mask (P, N) of the rows that are measurements."""
        return (self.pad == 0) & (self.across == 0)

    def _within(self, i, shape, groups, normals):
        """Add the scatter of the points of each bin about their line; widths of these bins and numbers of their points."""
        lags, r = [], self._directed(i, shape, shape.residual[:, :, None])[:, :, 0]
        for g in groups:
            if len(g) >= _SCATTERED:
                T = np.stack([np.ones(len(g)), shape.s[g] - shape.s[g].mean()], axis=1)
                y = r[g][:, :normals] - T @ np.linalg.lstsq(T, r[g][:, :normals], rcond=None)[0]
                y /= self.noise[i]
                self.scatter, self.dof = self.scatter + np.sum(y**2), self.dof + normals * (len(g) - 2)
                lags.append((np.ptp(shape.s[g]), len(g)))
        return lags

    def of(self, shapes, columns) -> np.ndarray:
        """Columns (m, 3, K) of each pose as rows (P, N, K)."""
        out = np.zeros((self.poses, self.rows, columns[0].shape[-1]))
        for i, (shape, c, groups, (second, off, along)) in enumerate(zip(shapes, columns, self.bins, self.kept, strict=True)):
            turned, n = self._directed(i, shape, np.nan_to_num(c)), len(groups)
            means = (self.mean[i] @ turned.reshape(len(turned), -1)).reshape(n, *turned.shape[1:])
            out[i, : self.count_of[i]] = np.concatenate([means[:, 0], means[second, 1], means[off, 1], means[along, 2]])
        return out

    def _directed(self, i, shape, columns):
        """Columns of a pose in the fixed directions: those of markers, whose places are vectors, turned as such; the others
        turned about the tangents, or into the plane of all points and across it."""
        (onto, u, fixed), axes = self.axes[i], shape.axes
        if fixed:
            return columns
        if shape.marked is not None and axes is not onto:
            held = (np.asarray(shape.marked) > 0)[:, None, None]
            columns = np.where(held, onto @ axes.transpose(0, 2, 1) @ columns, columns)
            axes = np.where(held, onto, axes)
        if u is not None:
            a, b = np.moveaxis(in_plane(axes, onto, u), 1, 0)[:, :, None]
            one, other = a * columns[:, 0] + b * columns[:, 1], a * columns[:, 1] - b * columns[:, 0]
            return np.stack([one, other, columns[:, 2]], axis=1)
        if axes is onto:
            return columns
        c, s = _angle(axes, onto)
        c, s = c[:, None], s[:, None]
        return np.stack([c * columns[:, 0] - s * columns[:, 1], s * columns[:, 0] + c * columns[:, 1], columns[:, 2]], axis=1)


def plane_normal(points, gravity) -> np.ndarray | None:
    """The unit normal (3,) of the plane in which points (n, 3) lie with gravity, as those of a photograph; None without one."""
    _, size, directions = np.linalg.svd(np.asarray(points) - np.mean(points, axis=0), full_matrices=False)
    weight = np.asarray(gravity) / max(float(np.linalg.norm(gravity)), _TINY)
    flat = len(size) > 2 and size[2] <= _FLAT * size[0] and abs(weight @ directions[2]) < _FLAT  # two points have no plane
    return directions[2] if flat else None


def in_plane_normal(axes: np.ndarray, across: np.ndarray) -> np.ndarray:
    """The direction (m, 2) among the normals, the first rows of ``axes`` (m, 3, 3), in the plane with the normal ``across``
    (3,)."""
    first, second = np.moveaxis(axes[:, :2] @ across, 1, 0)
    return np.stack([second, -first], axis=1) / np.maximum(np.hypot(first, second), _TINY)[:, None]


def in_plane(axes, onto, u):
    """The in-plane direction ``u`` (m, 2) among the normals of ``onto`` as one among those of ``axes`` (m, 3, 3)."""
    if axes is onto:
        return u
    c, s = _angle(axes, onto)
    return np.stack([c * u[:, 0] + s * u[:, 1], c * u[:, 1] - s * u[:, 0]], axis=1)


def _angle(axes, onto):
    """Cosine and sine of the angle about the tangents from ``axes`` to ``onto``."""
    B = np.einsum("mik,mjk->mij", onto, axes)
    angle = np.arctan2(B[:, 1, 0] - B[:, 0, 1], B[:, 0, 0] + B[:, 1, 1])
    return np.cos(angle), np.sin(angle)
