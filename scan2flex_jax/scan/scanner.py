"""A simulated scanner for test clouds: a tube around a known curve, seen from given viewpoints by an imperfect sensor.

The cable (and any clutter) is a triangle mesh. Each viewpoint sees only surfaces that face it and are not hidden behind
nearer ones (by a depth buffer), so that the back of the cable is missing as in a real scan. Then the sensor's errors are
added:

* `STRUCTURED_LIGHT`, a hand-held scanner: 0.5 mm along the ray, a small range bias, uneven density, 1 % outliers.
* `TIME_OF_FLIGHT`, Kinect-like: one point per pixel, 3.5 mm at 1 m along the ray and growing with range, depth in whole
  millimetres, flying pixels (between cable and background) along silhouettes, 3 % outliers.

Symbols: ``r`` radius (m), ``s`` arc length (m), range = distance from viewpoint to point (m).
Randomness comes from one integer key.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from scan2flex_jax.scan.spline import arc_length, tangents, unit

_SIDES = 48  # of the tube's cross section
_GRAZING = 0.17  # cosine of the steepest incidence that still returns light (80 degrees)
_CANDIDATES = 120_000  # surface points from which a view is drawn


@dataclass(frozen=True)
class Sensor:
    """Error model of a sensor.

    noise: standard deviation along the ray at 1 m (m); noise_growth: its exponent in the range (-);
    lateral_noise: across the ray (m); range_bias: constant error along the ray (m, positive = further);
    unevenness: standard deviation of the logarithm of the local density (-); outliers: fraction of stray points;
    outlier_spread: their distance from the true point (m); points: per view, where the sensor has no pixels;
    pixel: angle of a pixel (rad), 0 = none; quantum: step of the depth reading (m);
    flying: probability that a silhouette pixel flies; flying_depth: how far behind the cable it may land (m).
    """

    noise: float
    noise_growth: float = 0.0
    lateral_noise: float = 0.0
    range_bias: float = 0.0
    unevenness: float = 0.0
    outliers: float = 0.0
    outlier_spread: float = 0.05
    points: int = 6000
    pixel: float = 0.0
    quantum: float = 0.0
    flying: float = 0.0
    flying_depth: float = 0.03


STRUCTURED_LIGHT = Sensor(noise=5e-4, lateral_noise=1e-4, range_bias=-5e-5, unevenness=0.6, outliers=0.01)
TIME_OF_FLIGHT = Sensor(noise=3.5e-3, noise_growth=1.0, outliers=0.03, pixel=1 / 504, quantum=1e-3, flying=0.3)
PERFECT = Sensor(noise=0.0)


@dataclass(frozen=True)
class Scan:
    """A simulated scan: points (m), the viewpoint that saw each, and whether it is a true point of the cable."""

    points: Float[np.ndarray, "n 3"]
    view: Int[np.ndarray, " n"]
    on_cable: np.ndarray


def tube_mesh(curve: Float[np.ndarray, "m 3"], radius: float) -> trimesh.Trimesh:
    """A closed tube of mean radius ``radius`` around ``curve`` (m), with flat ends."""
    tangent = tangents(curve)
    d1 = np.empty_like(curve)
    d1[0] = np.cross(tangent[0], np.eye(3)[np.argmin(np.abs(tangent[0]))])
    for i in range(1, len(curve)):
        d1[i] = d1[i - 1] / np.linalg.norm(d1[i - 1])
        d1[i] -= (d1[i] @ tangent[i]) * tangent[i]
    d1 = unit(d1)
    d2 = np.cross(tangent, d1)
    angle = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    corner = radius / (1.0 - (np.pi / _SIDES) ** 2 / 3.0)  # the polygon's mean radius is then r
    ring = np.cos(angle)[:, None] * d1[:, None] + np.sin(angle)[:, None] * d2[:, None]
    vertices = np.concatenate([(curve[:, None] + corner * ring).reshape(-1, 3), curve[[0, -1]]])
    return trimesh.Trimesh(vertices, _tube_faces(len(curve)), process=False)


def _tube_faces(rings: int) -> Int[np.ndarray, "f 3"]:
    """Triangles of the tube, outward, with a fan at each end around the last two vertices."""
    i, j = np.meshgrid(np.arange(rings - 1), np.arange(_SIDES), indexing="ij")
    a, b = i * _SIDES + j, i * _SIDES + (j + 1) % _SIDES
    side = np.concatenate([np.stack([a, b, b + _SIDES], -1), np.stack([a, b + _SIDES, a + _SIDES], -1)]).reshape(-1, 3)
    k = np.arange(_SIDES)
    start = np.stack([np.full(_SIDES, rings * _SIDES), (k + 1) % _SIDES, k], -1)
    last = (rings - 1) * _SIDES
    end = np.stack([np.full(_SIDES, rings * _SIDES + 1), last + k, last + (k + 1) % _SIDES], -1)
    return np.concatenate([side, start, end])


def table(curve: Float[np.ndarray, "m 3"], radius: float, drop: float = 0.12) -> trimesh.Trimesh:
    """A table top below the cable (along z), ``drop`` m under its lowest point."""
    low, high = curve.min(axis=0), curve.max(axis=0)
    size = np.append(1.3 * (high - low)[:2] + 0.2, 0.01)
    centre = np.append(0.5 * (low + high)[:2], low[2] - radius - drop)
    return trimesh.creation.box(size, trimesh.transformations.translation_matrix(centre))


def clamp_block(position: Float[np.ndarray, "3"], outward: Float[np.ndarray, "3"], radius: float) -> trimesh.Trimesh:
    """A cubic clamp of six radii whose face stands at ``position``; ``outward`` points away from the cable."""
    pose = trimesh.geometry.align_vectors([0, 0, 1], outward)
    pose[:3, 3] = position + 3.0 * radius * outward
    return trimesh.creation.box([6.0 * radius] * 3, pose)


def scan(
    curve: Float[np.ndarray, "m 3"],
    radius: float,
    viewpoints: Float[np.ndarray, "v 3"],
    sensor: Sensor,
    key: int,
    *,
    gaps: Sequence[tuple[float, float]] = (),
    clutter: Sequence[trimesh.Trimesh] = (),
) -> Scan:
    """The cloud of the cable around ``curve`` (m), seen from ``viewpoints`` (m); the ``gaps`` of s stay unseen."""
    rng = np.random.default_rng([29, key])
    cable, points, normals = _surface([tube_mesh(curve, radius), *clutter], rng)
    s = arc_length(curve)[cKDTree(curve).query(points)[1]]
    hidden = np.zeros(len(points), bool)
    for low, high in gaps:
        hidden |= cable & (s >= low) & (s <= high)
    clouds, views, trues = [], [], []
    for v, eye in enumerate(np.asarray(viewpoints, float)):
        seen, edge = _visible(points, normals, eye, radius, sensor.pixel)
        keep = np.flatnonzero(seen & ~hidden)
        chosen = _pixels(points[keep], eye, sensor, rng) if sensor.pixel else _uneven(points[keep], sensor, rng)
        chosen = keep[chosen]
        measured, good = _measure(points[chosen], eye, edge[chosen], sensor, rng)
        clouds.append(measured)
        views.append(np.full(len(measured), v))
        trues.append(good & cable[chosen])
    return Scan(np.concatenate(clouds), np.concatenate(views), np.concatenate(trues))


def _surface(meshes: Sequence[trimesh.Trimesh], rng: np.random.Generator):
    """Points spread evenly over all meshes, their normals, and the mask of the first mesh (the cable)."""
    area = np.array([mesh.area for mesh in meshes])
    share = np.minimum(_CANDIDATES, _CANDIDATES * area / area[0] / 3.0).astype(int)
    share[0] = _CANDIDATES
    parts = [trimesh.sample.sample_surface(m, n, seed=int(rng.integers(2**31))) for m, n in zip(meshes, share, strict=True)]
    points = np.concatenate([p for p, _ in parts])
    normals = np.concatenate([m.face_normals[f] for m, (_, f) in zip(meshes, parts, strict=True)])
    return np.arange(len(points)) < share[0], points, normals


def _image(points, eye, pixel):
    """Integer pixel coordinates of points as seen from ``eye``, looking at their middle."""
    forward = points.mean(axis=0) - eye
    axes = trimesh.geometry.align_vectors(forward / np.linalg.norm(forward), [0, 0, 1])[:3, :3]
    local = (points - eye) @ axes.T
    image = np.floor(local[:, :2] / local[:, 2:] / pixel).astype(int)
    return image - image.min(axis=0) + 1


def _visible(points, normals, eye, radius, pixel):
    """Masks of visible points (facing the eye, and not behind something a radius nearer) and of silhouette points."""
    ray = points - eye
    depth = np.linalg.norm(ray, axis=1)
    facing = -np.sum(normals * ray, axis=1) / depth
    cell = max(pixel, 0.25 * radius / np.median(depth), 1e-3)
    image = _image(points, eye, cell)
    buffer = np.full(image.max(axis=0) + 2, np.inf)
    np.minimum.at(buffer, tuple(image.T), depth)
    edge = facing < np.sqrt(1.0 - (1.0 - min(1.0, pixel * np.median(depth) / radius)) ** 2)
    return (facing > _GRAZING) & (depth < buffer[tuple(image.T)] + radius), edge


def _pixels(points, eye, sensor, rng):
    """One point per pixel, as in a camera."""
    order = rng.permutation(len(points))
    image = _image(points[order], eye, sensor.pixel)
    flat = np.ravel_multi_index(tuple(image.T), tuple(image.max(axis=0) + 1))
    return order[np.unique(flat, return_index=True)[1]]


def _uneven(points, sensor, rng):
    """``sensor.points`` of the points, with the uneven density of a hand-held scanner."""
    scale = np.ptp(points, axis=0).max()
    waves = rng.normal(size=(6, 3)) * 2.0 * np.pi / (0.4 * scale)
    field = np.cos(points @ waves.T + rng.uniform(0.0, 2.0 * np.pi, 6)).sum(axis=1) / np.sqrt(3.0)
    weight = np.exp(sensor.unevenness * field)
    count = min(sensor.points, len(points))
    return rng.choice(len(points), count, replace=False, p=weight / weight.sum())


def _measure(points, eye, edge, sensor, rng):
    """Points as the sensor reports them, and the mask of honest measurements."""
    ray = points - eye
    depth = np.linalg.norm(ray, axis=1)
    ray = ray / depth[:, None]
    n = len(points)
    read = depth + sensor.range_bias + sensor.noise * depth**sensor.noise_growth * rng.normal(size=n)
    flies = edge & (rng.uniform(size=n) < sensor.flying)
    read += np.where(flies, rng.uniform(0.0, sensor.flying_depth, n), 0.0)
    read = np.round(read / sensor.quantum) * sensor.quantum if sensor.quantum else read
    measured = eye + ray * read[:, None]
    across = rng.normal(size=(n, 3)) * sensor.lateral_noise
    measured += across - np.sum(across * ray, axis=1, keepdims=True) * ray
    stray = rng.uniform(size=n) < sensor.outliers
    measured += np.where(stray[:, None], rng.normal(size=(n, 3)) * sensor.outlier_spread, 0.0)
    return measured, ~stray & ~flies
