"""Point clouds: reading, rejecting, cleaning and thinning.

Files of all formats are read by `study.scans`; a mesh is sampled over its surface. Cleaning removes
isolated points, planes (tables, walls) and points out of reach of a cable of length L between these clamps: the distances of a
reachable point to the two clamps sum to at most L. It does not look for the blocks of clamps: `centre_curve` ends the curve
at the clamps. Thinning keeps the density's proportions, so outliers stay as rare as they were. Of its two forms `thin` is the
more even one; `drawn` selects every point independently of the others.

Symbols: ``r`` radius, ``L`` length, points: all m in the scan frame.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial import cKDTree

from scan2flex_jax.errors import Scan2FlexError, StudyError
from scan2flex_jax.scan.settings import USUAL
from scan2flex_jax.study.scans import load_geometry, unreadable

MESH_SAMPLES = 60_000
_PLANES = 3  # number of table tops and walls to search for
_FLAT = 1e-6  # of the largest triangle: a smaller one has no direction
_TRIPLES = 200
_AROUND = 12  # points needed in a neighbourhood to measure its filling
_NEIGHBOURS = 8


@dataclass(frozen=True)
class Cloud:
    """Points of a scan (m), unit normals if the file has them, and notes from reading."""

    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"] | None = None
    notes: tuple[str, ...] = ()


def load_cloud(path: str | Path) -> Cloud:
    """Read a cloud (`study.scans`); a mesh is sampled evenly over its surface, deterministically."""
    path = Path(path)
    loaded = load_geometry(path)
    try:
        return _cloud_of(loaded, path)
    except (ValueError, IndexError, TypeError) as fault:  # faces that refer to missing points, truncated coordinates
        raise unreadable(path, fault) from fault


def _cloud_of(loaded, path) -> Cloud:
    meshes = list(loaded.geometry.values()) if isinstance(loaded, trimesh.Scene) else [loaded]
    faces = [m for m in meshes if isinstance(m, trimesh.Trimesh) and len(m.faces)]
    if faces:
        mesh: Any = trimesh.util.concatenate(faces)
        points, face = trimesh.sample.sample_surface(mesh, MESH_SAMPLES, seed=0)
        note = f"{path.name} is a mesh of {len(mesh.faces)} triangles: {MESH_SAMPLES} points were sampled on it"
        return Cloud(np.asarray(points), np.asarray(mesh.face_normals[face]), (note,))
    vertices = [np.asarray(m.vertices, float).reshape(-1, 3) for m in meshes if hasattr(m, "vertices")]
    points = np.concatenate(vertices) if vertices else np.empty((0, 3))
    finite = np.isfinite(points).all(axis=1)
    if not finite.any():
        raise StudyError(path, None, "the scan holds no points")
    notes = tuple(f"{path.name}: {note}" for m in meshes for note in getattr(m, "metadata", {}).get("notes", ()))
    if not finite.all():
        notes += (f"{path.name}: {np.sum(~finite)} of {len(finite)} points are not finite numbers, and were left out",)
    normals = _normals(meshes, len(points))
    return Cloud(points[finite], None if normals is None else normals[finite], notes)


def _normals(meshes, count):
    """Normals of a single point cloud whose PLY has nx, ny, nz."""
    raw = meshes[0].metadata.get("_ply_raw", {}) if len(meshes) == 1 and hasattr(meshes[0], "metadata") else {}
    data: Any = raw.get("vertex", {}).get("data") if isinstance(raw, dict) else None
    try:
        normals = np.column_stack([np.asarray(data[k], float).ravel() for k in ("nx", "ny", "nz")])
    except (TypeError, KeyError, ValueError, IndexError):
        return None
    size = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.where(size > 0, size, 1.0) if len(normals) == count else None


def normals_at(cloud: Any, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"] | None:
    """The file's normals at a subset of its own points; None without normals (or if ``cloud`` is bare points)."""
    normals = cloud.normals if isinstance(cloud, Cloud) else None
    return None if normals is None else normals[cKDTree(cloud.points).query(points)[1]]


def check_cloud(points: Float[np.ndarray, "n 3"], radius: float, length: float | None) -> Float[np.ndarray, "n 3"]:
    """The finite points; one sentence if there are none, if some are not numbers, or if the units are wrong."""
    points = np.asarray(points, float)
    if points.ndim != 2 or points.shape[1] != 3:
        raise Scan2FlexError(f"a cloud has three coordinates per point, this one has the shape {points.shape}")
    bad = ~np.isfinite(points).all(axis=1)
    if bad.any():
        first = int(np.argmax(bad))
        raise Scan2FlexError(f"{bad.sum()} of the {len(points)} points are not finite numbers (the first is number {first})")
    if len(points) < 4:
        raise Scan2FlexError(f"the cloud has {len(points)} points: at least 4 are needed to say where a cable is")
    spread = np.linalg.norm(np.quantile(points, 0.98, axis=0) - np.quantile(points, 0.02, axis=0))
    size = length if length else 200.0 * radius
    if spread > USUAL.units * size:
        raise Scan2FlexError(
            f"the cloud is {spread:.4g} long where the cable is {size:.4g} m with a radius of {radius:.4g} m: its"
            f" coordinates seem to be millimetres; divide them by 1000 (everything here is in metres)"
        )
    if spread < size / (4.0 * USUAL.units):
        raise Scan2FlexError(
            f"the cloud is only {spread:.4g} m across where the cable is {size:.4g} m long: its units are not metres,"
            f" or it shows another thing"
        )
    return points


def not_isolated(points: Float[np.ndarray, "n 3"]) -> np.ndarray:
    """Mask of points at a usual distance from their neighbours (statistical outlier removal on a log scale)."""
    if len(points) < 4 * _NEIGHBOURS:
        return np.ones(len(points), bool)
    away = cKDTree(points).query(points, _NEIGHBOURS + 1)[0][:, 1:].mean(axis=1)
    log = np.log(away + 1e-12)
    middle = np.median(log)
    spread = max(1.4826 * np.median(np.abs(log - middle)), 0.1)
    return log < middle + USUAL.isolated * spread


def reachable(points, radius, clamps, length) -> np.ndarray:
    """Mask of points within reach of a cable of this length held at these two positions (either may be None)."""
    start, end = clamps
    slack = 2.0 * radius + 0.03 * (length or 0.0)
    if length is None or start is None:
        return np.ones(len(points), bool)
    from_start = np.linalg.norm(points - start, axis=1)
    if end is None:
        return from_start < length + slack
    return from_start + np.linalg.norm(points - end, axis=1) < length + 2.0 * slack


def off_planes(points: Float[np.ndarray, "n 3"], radius: float) -> np.ndarray:
    """Mask of points on no table top or wall, where points fill their planar neighbourhoods evenly.

    Planes are proposed by triples of points (RANSAC with a fixed seed). Points of a cable that lies in a plane line up in it,
    and are kept; further planes are searched among the other points.
    """
    keep, lined_up = np.ones(len(points), bool), np.zeros(len(points), bool)
    rng = np.random.default_rng(5)
    near = 0.25 * radius + 2e-3
    for _ in range(_PLANES):
        left = points[keep & ~lined_up]
        if len(left) < USUAL.plane:
            break
        normal, offset = _best_plane(left[thin(left, 4000)], near, rng)
        away = points @ normal - offset
        on = keep & ~lined_up & (np.abs(away) < 2.0 * near)
        axes = np.linalg.svd(np.eye(3) - np.outer(normal, normal))[0][:, :2]
        if on.sum() < max(USUAL.plane, 0.1 * keep.sum()):
            break
        if _filling(points[on] @ axes, 4.0 * max(radius, near)) < USUAL.filled:
            lined_up |= on
            continue
        middle, spread = 0.0, near
        for _ in range(5):  # the slab of the proposal may be thinner than the plane's noise
            inside = away[keep & (np.abs(away - middle) < 3.0 * spread)]
            middle = np.median(inside)
            spread = float(np.clip(1.55 * np.median(np.abs(inside - middle)), 1e-3 * near, 6.0 * near))
        keep &= np.abs(away - middle) > 4.0 * spread + 1e-4
    return keep


def _filling(flat: Float[np.ndarray, "n 2"], reach: float) -> float:
    """Median over points of the ratio of smaller to larger variance in their neighbourhood: 1 in an area, 0 on a line.

    ``reach`` (m) is widened until half of the neighbourhoods hold `_AROUND` points, since a distant table is sampled sparsely.
    """
    tree = cKDTree(flat)
    some = flat[thin(np.column_stack([flat, 0 * flat[:, 0]]), 200)]
    reach = max(reach, float(np.median(tree.query(some, min(_AROUND + 1, len(flat)))[0][:, -1])))
    ratios = []
    for ball in tree.query_ball_point(some, reach):
        if len(ball) > 5:
            size = np.linalg.eigvalsh(np.cov(flat[ball].T))
            ratios.append(size[0] / (size[1] + 1e-300))
    return float(np.median(ratios)) if ratios else 0.0


def _best_plane(points, near, rng):
    """Unit normal and offset (m) of the plane with the most points nearer than ``near``."""
    triples = points[rng.integers(0, len(points), (_TRIPLES, 3))]
    normal = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    size = np.linalg.norm(normal, axis=1)
    some = size > _FLAT * np.max(size)  # a duplicated point defines no plane, and would be near to every point
    on = points
    if some.any():
        normal, triples = normal[some] / size[some, None], triples[some]
        offset = np.sum(normal * triples[:, 0], axis=1)
        best = np.argmax(np.sum(np.abs(points @ normal.T - offset) < near, axis=0))
        on = points[np.abs(points @ normal[best] - offset[best]) < near]
    middle = on.mean(axis=0)
    normal = np.linalg.svd(on - middle, full_matrices=False)[2][2]
    return normal, float(normal @ middle)


def near_polyline(points, polyline, reach) -> np.ndarray:
    """Mask of points within ``reach`` (m) of a finely sampled polyline."""
    return cKDTree(polyline).query(points, distance_upper_bound=reach)[0] < reach


def thin(points: Float[np.ndarray, "n 3"], count: int) -> np.ndarray:
    """Indices of at most ``count`` points: every m-th in the order of a coarse grid, the same on every run."""
    if len(points) <= count:
        return np.arange(len(points))
    low, high = points.min(axis=0), points.max(axis=0)
    cell = np.floor((points - low) / (np.max(high - low) / 64.0 + 1e-300)).astype(int)
    order = np.lexsort((points[:, 0], points[:, 1], points[:, 2], cell[:, 0], cell[:, 1], cell[:, 2]))
    return np.sort(order[np.linspace(0, len(points) - 1, count).astype(int)])
