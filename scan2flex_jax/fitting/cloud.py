"""The direct fit: residuals of scan points from the rod's surface, without a centre curve.

A point's residual is its distance from the surface of the tube around the modelled centre line:

* *radial*, ``e = |p - r(s)| - (radius + offset)``, ``s`` the arc length of the closest point;
* *along the ray*, where viewpoints are known: the distance of the point behind the tube's surface on its ray. Noise of a
  scanner acts along rays. It moves a point around the tube as well as outwards, which biases radial distances by
  ``noise^2/radius`` (most where the surface is steep); along the ray there is no such bias. Grazing rays have zero weight.

``offset`` is one number per scan for errors of the sensor's range and the stated radius; it is linear, so it is eliminated
exactly, under a prior. A scan from one side suffices: each point measures its distance from the axis, wherever it lies on the
cable. Points have zero weight if their closest point is an end of the rod, or so near to it that they may lie on a clamp.

Distances, directions and weights (Tukey's) of points are evaluated around the *observed* axis: a displacement field ``u(s)``
across the model, fitted to the same points. A locally wrong model therefore neither turns valid points into outliers nor
leaves the range in which distances are informative. With ``e_i`` and the direction ``n_i = d e_i / d u`` at the field's axis
``c_i``, the model's residual is ``e_i + n_i . (c_i - r(s_i))``. All are updated between runs of Levenberg-Marquardt until they
converge. The first field comes from the curve that starts the solve, so a rough curve suffices.

The residual along the cable is again ``u(s)``: its statistics are in `cloud_noise`.
Reference: Huber and Ronchetti, "Robust Statistics" (2009), section 7.8; Golub and Pereyra (1973) for the elimination.
"""

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial import cKDTree

from scan2flex_jax.compilation import compiled
from scan2flex_jax.fitting.distance import closest_arc_length, curve_at
from scan2flex_jax.fitting.evaluate import Evaluation, Evaluator, observed, one
from scan2flex_jax.fitting.least_squares import Minimum, Progress, levenberg_marquardt, silent
from scan2flex_jax.fitting.parameters import Layout, boundary_at, model_at
from scan2flex_jax.fitting.poses import Poses
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.geometry import curves
from scan2flex_jax.rod.model import CableModel
from scan2flex_jax.statics.solve import equilibrium
from scan2flex_jax.statics.starts import complete_curve

MOST_POINTS = 4096  # of a scan that enter a fit
CURVE_POINTS = 256  # of the curve that starts the solve, carried along to place the first field
STATIONS = 73  # of the displacement field along the cable
TUKEY = 4.685  # standard deviations beyond which a point has zero weight: 95 % efficient for normal noise
OFFSET = 0.05  # of the radius: standard deviation of the prior of its offset
_LEAST = 1.0e-3  # of the radius: smaller residuals are rounding of the scanner
_WIDE, _NARROWING, _SWEEPS = 1.0, 0.75, 18  # first cut-off in radii, its factor per sweep, and the number of sweeps
_RAYS_FROM = 9  # first sweep with distances along the ray: the field must be within the radius by then
GRAZING = 0.9  # of the radius: a ray that passes further from the axis has zero weight
FACING = 0.5  # cosine of the incidence below which a point has zero weight: silhouettes have mixed pixels
_BEND = 0.02  # weight of second differences of the field over the mean weight of a station
_NEAR_CLAMP, _SHORTEST = 0.5, 0.005  # of the radius, of the length: nearer to an end a point may lie on the clamp's face
_ROUNDS, _SETTLED = 12, 0.02  # rounds of weights, which end when no residual changes by this part of a standard deviation


@dataclass(frozen=True)
class Raw:
    """Points relative to the modelled centre lines: components (P, m, 2) in m of the displacement from the closest point along
    two normals, their Jacobian by the parameters, the normals (P, m, 2, 3), arc length (m), and whether the closest point lies
    inside the rod, off the clamps."""

    off: np.ndarray
    slope: np.ndarray | None
    normals: np.ndarray
    s: np.ndarray
    inside: np.ndarray


class CloudEvaluation(Evaluation):
    """An `Evaluation` of weighted distances (P, m + 1, 1) that keeps the `Raw` ones (no ``__slots__``: it has a dict)."""

    raw: Raw


@dataclass(frozen=True)
class Weights:
    """Per pose and point, at the field: weight, distance ``e`` (m) without offset, its direction ``n`` (P, m, 3), its slope
    by the radius (``swell``), the axis ``c`` (P, m, 3) in m; per pose the standard deviation of a point and the offset (m)."""

    weight: np.ndarray
    distance: np.ndarray
    direction: np.ndarray
    swell: np.ndarray
    axis: np.ndarray
    sigma: np.ndarray
    offset: np.ndarray


@compiled
def _evaluate(layout: Layout, template: CableModel, boundary, expected, points, x, start, elements, margin, derivative):
    """One pose: slopes and offsets of the points, normals, arc lengths, inside, configuration and verdict."""

    def offsets(x):
        model = model_at(layout, template, x[: layout.shared])
        e = equilibrium(model, boundary_at(layout, boundary, x[layout.shared :]), start=start, elements=elements)
        d3, ds = e.configuration.R[:, :, 2], e.rod.section.ds
        off, rest = offsets_from(e.points, d3, ds, points, expected, margin, partial(observed, model))
        return off, (off, *rest, jax.lax.stop_gradient(e.configuration), e.verdict)

    if derivative:
        slope, rest = jax.jacfwd(offsets, has_aux=True)(x)
        return slope, *rest
    return None, *offsets(x)[1]


def offsets_from(r, d3, ds, points, expected, margin, observe):
    """``(off (m, 2), (normals (m, 2, 3), s (m,), inside (m,)))`` of points near the curve through nodes ``r``, as in `Raw`.

    Closest points and normals are constant under differentiation. ``margin`` (m): distance of "inside" from both ends.
    """
    fixed_r, fixed_d3, fixed_ds = jax.lax.stop_gradient((observe(r), d3, ds))
    frames = curves.transported_frames(fixed_d3, curves.frame_on(fixed_d3[0]))
    length = fixed_ds * (r.shape[0] - 1)

    def each(point, expected):
        s = jax.lax.stop_gradient(closest_arc_length(fixed_r, fixed_d3, fixed_ds, point, expected))
        x, _ = curve_at(r, d3, ds, s * ds / fixed_ds)
        _, t = curve_at(fixed_r, fixed_d3, fixed_ds, s)
        t = t / jnp.linalg.norm(t)
        n1 = frames[jnp.round(s / fixed_ds).astype(int), :, 0]
        n1 = n1 - (n1 @ t) * t
        n1 = n1 / jnp.linalg.norm(n1)
        normals = jax.lax.stop_gradient(jnp.stack([n1, jnp.cross(t, n1)]))
        return normals @ (point - observe(x)), normals, s, (s > margin) & (s < length - margin)

    off, *rest = jax.vmap(each)(points, expected)
    return off, tuple(rest)


class CloudEvaluator(Evaluator):
    """Weighted distances of the points of a study's scans; the last row of a pose is the prior of its offset."""

    def __init__(self, problem: Problem, scans: Poses, radius: float, eyes):
        """``eyes``: per pose the viewpoints (v, 3) in m, or None. Weights come from `weigh`."""
        super().__init__(problem.layout, scans, problem.elements, "tube")
        self.radius, self.eyes, self.length = radius, eyes, problem.length
        self.weights: Any = None  # `Weights` once `weigh` has made them

    def look(self, shared, local=None, *, start=None) -> CloudEvaluation:
        """The points of the scans relative to the model: the input of `weigh`."""
        return self._at(np.asarray(self.poses.points), shared, local, start, False)

    def __call__(self, shared, local=None, *, start=None, derivative=True) -> CloudEvaluation:
        """At ``shared`` numbers and ``local`` ones (P, local), from ``start`` (default: the measured curves)."""
        e = self._at(self.weights.axis, shared, local, start, derivative)
        residual, jacobian = self._weighted(e.raw)
        weighted = e._replace(residual=residual, jacobian=jacobian)
        weighted.raw = e.raw
        return weighted

    def _at(self, points, shared, local, start, derivative):
        p = self.poses
        self.equilibria += p.count
        local = np.zeros((p.count, self.layout.local)) if local is None else local
        start = p.start if start is None else start
        margin = jnp.asarray(max(_NEAR_CLAMP * self.radius, _SHORTEST * self.length))
        found = [
            _evaluate(
                self.layout, p.template(i), one(p.boundary, i), p.expected[i], jnp.asarray(points[i]),
                np.concatenate([shared, local[i]]), one(start, i), self.elements, margin, derivative,
            )
            for i in range(p.count)
        ]  # fmt: skip
        stacked = jax.tree.map(lambda *x: np.stack([np.asarray(a) for a in x]), *found)
        slope, off, normals, s, inside, configuration, verdict = stacked
        e = CloudEvaluation(off, None, s, configuration, verdict)
        e.raw = Raw(off, slope, normals, s, inside)
        return e

    def _weighted(self, raw):
        """Residuals with the offset eliminated, the row of its prior, and their Jacobian."""
        said = self.weights
        w, swell = said.weight, said.swell
        pull = (said.sigma / (OFFSET * self.radius)) ** 2
        n = np.einsum("pmci,pmi->pmc", raw.normals, said.direction)
        distance = said.distance + np.sum(n * raw.off, axis=2)
        total = np.sum(w * swell**2, axis=1) + pull
        offset = -np.sum(w * swell * distance, axis=1) / total
        root = np.sqrt(w)
        rows = root * (distance + swell * offset[:, None])
        residual = np.concatenate([rows, (np.sqrt(pull) * offset)[:, None]], axis=1)[..., None]
        if raw.slope is None:
            return residual, None
        slope = np.einsum("pmc,pmcx->pmx", n, raw.slope)
        by_offset = -np.einsum("pm,pmx->px", w * swell, slope) / total[:, None]
        rows = root[..., None] * (slope + swell[..., None] * by_offset[:, None])
        last = np.sqrt(pull)[:, None, None] * by_offset[:, None]
        return residual, np.concatenate([rows, last], axis=1)[:, :, None]


def scans_of(poses: Poses, points: list[np.ndarray], curve_points: list[np.ndarray], length: float) -> Poses:
    """The poses with the points of their scans in place of curves: thinned, padded, and where each is expected (s, m).

    Points of a large scan are drawn at random, independently of the curve that starts the fit: another draw moves a value by a
    third of its standard deviation. After the `MOST_POINTS` places of the cloud come those of the curve; their mask is 0.
    """
    rows = [_rows(one(poses.boundary, i), p, c, length) for i, (p, c) in enumerate(zip(points, curve_points, strict=True))]
    stacked = [np.stack(column) for column in zip(*rows, strict=True)]
    return replace(poses, points=stacked[0], mask=stacked[1], expected=stacked[2])


def _rows(boundary, points, curve, length):
    from scan2flex_jax.scan import cloud as clouds  # noqa: PLC0415  (only scans need it, and it loads slowly)

    points = points[clouds.drawn(points, MOST_POINTS)]
    even = np.asarray(curves.resample(jnp.asarray(curve), CURVE_POINTS))
    full = complete_curve(even, boundary, length)
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(full, axis=0), axis=1))])
    dense = np.linspace(0.0, s[-1], 2001)
    path = np.stack([np.interp(dense, s, full[:, k]) for k in range(3)], axis=1)
    padded = np.concatenate([points, np.repeat(points[:1], MOST_POINTS - len(points), axis=0), even])
    mask = np.zeros(len(padded))
    mask[: len(points)] = 1.0
    return padded, mask, dense[cKDTree(path).query(padded)[1]] * length / s[-1]


def weigh(raw: Raw, evaluator: CloudEvaluator) -> Weights:
    """Weights and distances of all points around the observed axis; see the head of this module."""
    each = [_weigh_pose(raw, evaluator, i) for i in range(evaluator.poses.count)]
    return Weights(*(np.stack(column) for column in zip(*each, strict=True)))


def _weigh_pose(raw, evaluator, i):
    """One pose, from two initial fields: the curve that starts its solve, and the model. A curve in front of the surface, or
    along another strand, leads to a field that explains fewer points."""
    radius, normals, y = evaluator.radius, raw.normals[i], raw.off[i]
    points = np.asarray(evaluator.poses.points[i])
    real = (np.asarray(evaluator.poses.mask[i]) > 0) & raw.inside[i]
    at = raw.s[i] / evaluator.length * (STATIONS - 1)
    rays, first = _rays(points, normals, evaluator.eyes[i]), _first_field(at, y)
    found = [_weigh_from(u, at, y, rays, real, radius) for u in (first, np.zeros_like(first))]
    finest = min(f.sigma for f in found)
    best = min(found, key=lambda f: f.missed(real, finest))
    axis = points - np.einsum("mc,mci->mi", y - best.here, normals)
    axis = np.where(real[:, None], axis, points)  # points of zero weight stay where they are
    direction = np.einsum("mc,mci->mi", best.normal, normals)
    return best.weight, best.distance, direction, best.swell, axis, best.sigma, best.offset


class _Seen(NamedTuple):
    """The points of a pose at a converged field: as `Weights`, in the two normals of each point; ``here`` (m, 2) is the field
    (m), ``told`` whether a point is informative."""

    weight: np.ndarray
    distance: np.ndarray
    normal: np.ndarray
    swell: np.ndarray
    here: np.ndarray
    told: np.ndarray
    sigma: float
    offset: float

    def missed(self, real, sigma: float) -> float:
        """Sum of squared residuals of the points over ``sigma`` (m), each limited to the cut-off."""
        left = np.where(self.told, (self.distance + self.swell * self.offset) / sigma, np.inf)
        return float(np.sum(np.minimum(left[real] ** 2, TUKEY**2)))


def _weigh_from(u, at, y, rays, real, radius) -> _Seen:
    """Fit the field from an initial ``u`` (STATIONS, 2), the displacement of the axis from the model in m."""
    k = np.clip(np.floor(at).astype(int), 0, STATIONS - 2)
    t = at - k
    offset, sigma = 0.0, 0.3 * radius
    for sweep in range(_SWEEPS):
        here = (1 - t)[:, None] * u[k] + t[:, None] * u[k + 1]
        e, n, swell, told = _from_surface(y - here, rays if sweep >= _RAYS_FROM else None, radius)
        told &= real
        wide = _WIDE * radius * _NARROWING**sweep
        left = e + swell * offset
        seen = told & (np.abs(left) < max(TUKEY * sigma, wide))
        sigma = max(1.4826 * np.median(np.abs(left[seen])) if seen.any() else np.inf, _LEAST * radius)
        cut = max(TUKEY * sigma, wide)
        w = np.where(told & (np.abs(left) < cut), (1 - (left / cut) ** 2) ** 2, 0.0)
        offset = -np.sum(w * swell * e) / (np.sum(w * swell**2) + (sigma / (OFFSET * radius)) ** 2)
        u = u + _field_step(u, k, t, n, e + swell * offset, w)
    return _Seen(w, e, n, swell, here, told, sigma, offset)


def _first_field(at, y):
    """Displacement (n, 2) at the stations of the curve that starts the solve from the model."""
    curve = slice(MOST_POINTS, None)
    order = np.argsort(at[curve], kind="stable")
    return np.stack([np.interp(np.arange(STATIONS), at[curve][order], y[curve][order, c]) for c in range(2)], axis=1)


def _rays(points, normals, eyes):
    """Directions (v, m, 2) of the rays from the viewpoints, in the two normals of each point; None without viewpoints."""
    if eyes is None:
        return None
    ray = points - np.asarray(eyes)[:, None]
    return np.einsum("mci,vmi->vmc", normals, ray / np.linalg.norm(ray, axis=2, keepdims=True))


def _from_surface(off, rays, radius):
    """Distances (m) from the surface of points at ``off`` (m, 2) from the axis, their derivatives by ``off`` and by the radius,
    and whether they are informative. Each point is assigned the viewpoint of least distance along the ray."""
    if rays is None:
        away = np.linalg.norm(off, axis=1) + 1e-30
        return away - radius, off / away[:, None], -np.ones(len(off)), np.ones(len(off), bool)
    steep = np.linalg.norm(rays, axis=2) + 1e-30
    across = rays / steep[..., None]
    depth = np.sum(across * off, axis=2)
    aside = off - depth[..., None] * across
    side = np.linalg.norm(aside, axis=2) + 1e-30
    told = side < GRAZING * radius
    inner = np.minimum(side, GRAZING * radius)
    root = np.sqrt(radius**2 - inner**2)
    e = (depth + root) / steep
    told &= root / radius * steep > FACING
    view = np.argmin(np.abs(e) + np.where(told, 0.0, 10.0 * radius), axis=0), np.arange(len(off))
    n = (across - (inner / root / side)[..., None] * aside) / steep[..., None]
    return e[view], n[view], (radius / root / steep)[view], told[view]


def _field_step(u, k, t, n, e, w):
    """Gauss-Newton step (n, 2) of the field at the stations: residuals of points, and a weak penalty on its curvature."""
    count, size = len(u), 2 * len(u)
    hats = (1.0 - t, t)
    blocks, g = np.zeros((count, 2, count, 2)), np.zeros((count, 2))
    at = np.arange(count - 1)

    def per_station(values):
        return np.bincount(k, values, count - 1)

    for c in range(2):
        for i, hat in enumerate(hats):
            g[at + i, c] += per_station(w * hat * n[:, c] * e)
            for d in range(2):
                for j, other in enumerate(hats):
                    blocks[at + i, c, at + j, d] += per_station(w * hat * other * n[:, c] * n[:, d])
    A = blocks.reshape(size, size)
    S = np.kron(_roughness(count), np.eye(2))
    stiff = _BEND * np.trace(A) / size + 1e-12
    A = A + stiff * S + 1e-6 * stiff * np.eye(size)
    return np.linalg.solve(A, g.ravel() - stiff * (S @ u.ravel())).reshape(u.shape)


def _roughness(count):
    """``M`` with ``u^T M u`` the sum of squared second differences."""
    second = np.diff(np.eye(count), 2, axis=0)
    return second.T @ second


def descend(
    problem: Problem, evaluator: CloudEvaluator, begun: Minimum, start, inflation: float = 1.0, progress: Progress = silent
) -> Minimum:
    """Levenberg-Marquardt from the parameters of ``begun``, with weights that are updated until they converge; ``start``:
    configurations; ``inflation``: factor on the standard deviations of the points."""
    shared, local = begun.shared, begun.local
    raw = evaluator.look(shared, local, start=start).raw
    for _ in range(_ROUNDS):
        evaluator.weights = weigh(raw, evaluator)
        goal = replace(problem.goal(inflation * evaluator.weights.sigma, progress), evaluator=evaluator)
        minimum = levenberg_marquardt(goal, shared, local, start)
        if not np.isfinite(minimum.cost):
            return minimum
        shared, local, start = minimum.shared, minimum.local, minimum.evaluation.configuration
        before, raw = raw, evaluator.look(shared, local, start=start).raw
        moved = np.linalg.norm(raw.off - before.off, axis=2) * (evaluator.weights.weight > 0)
        if np.all(moved < _SETTLED * evaluator.weights.sigma[:, None]):
            return minimum
    minimum.converged = False
    return minimum
