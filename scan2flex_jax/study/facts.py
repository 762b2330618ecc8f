"""Geometry of a measured curve before any model: its length, its slope at the clamps, whether it is plane.

Near a clamp a parabola is fitted to the curve and extrapolated to the clamp; its slope there is compared with the clamp's d3.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated

import numpy as np

from scan2flex_jax.study.curves import chord_deficit, curve_length
from scan2flex_jax.study.model import Clamp, Study, StudyPose
from scan2flex_jax.study.rotations import between

TANGENT_SPAN = 0.08  # longest part of the curve for the parabola: a cable's bends beyond it are not parabolic
TANGENT_START = 0.02  # shortest part of the curve for the parabola: long against the noise of a scan
TANGENT_LEAST = 6  # fewest points of the parabola, if the curve has as many: twice its coefficients
UNEVEN = 3.0  # allowed factor between a chord's shortfall and that of an arc: bends are not even along it
TURN, RESOLVED = 0.8, 0.5  # of the turn between chords, and rad of it: error of a tangent at the end of curves of few points
FEWEST_BENT = 4  # fewest points of a space curve with curvature and torsion: fewer do not determine tangents, bends or plane
_NEIGHBOURS = np.array([-2, -1, 1, 2])  # of a point, that predict it
_TINY = 1e-300


@dataclass(frozen=True)
class EndFacts:
    """Position and direction of a curve's end at one clamp.

    `gap` (m): from the clamp to the curve's end. `angle` and `angle_sd` (deg): between the curve's tangent and the
    clamp's d3; None for a ball joint, and for a curve of too few points."""

    gap: float
    angle: float | None = None
    angle_sd: float | None = None


@dataclass(frozen=True)
class PoseFacts:
    """Numbers of one measured centre curve (m, deg).

    `covered`: arc length with the gaps to the clamps; `unseen`: possible excess of the curve over its chords.
    `off_plane` and `off_line`: RMS distance from the best-fitting plane and line. `backwards`: the reversed curve agrees much
    better with its clamps. `start` and `end` are None for free ends."""

    points: int
    arc_length: float
    covered: float
    unseen: float
    start: EndFacts | None
    end: EndFacts | None
    off_plane: float
    off_line: float
    backwards: bool


def pose_facts(pose: StudyPose) -> PoseFacts | None:
    """The numbers of a pose's centre curve; None if it has only a scan."""
    if pose.curve is None:
        return None
    points, s = pose.curve.points, pose.curve.arc_length
    length = curve_length(points) if s is None else float(s[-1] - s[0])
    start = None if pose.start is None else _end_facts(points, pose.start, 1.0)
    end = None if pose.end is None else _end_facts(points[::-1], pose.end, -1.0)
    ends = ((pose.start, points[1] - points[0]), (pose.end, points[-1] - points[-2]))
    turns = (0.0 if clamp is None or clamp.tangent is None else between(clamp.tangent, chord) for clamp, chord in ends)
    gaps = sum(one.gap for one in (start, end) if one is not None)
    held = [(clamp.position, i) for clamp, i in ((pose.start, 0), (pose.end, -1)) if clamp is not None]
    off = [sum(np.linalg.norm(way[i] - x) for x, i in held) for way in (points, points[::-1])]
    spread = np.zeros(3)
    spread[: len(points)] = np.linalg.svd(points - points.mean(axis=0), compute_uv=False) / np.sqrt(len(points))
    return PoseFacts(
        points=len(points),
        arc_length=length,
        covered=length + gaps,
        unseen=0.0 if s is not None else UNEVEN * chord_deficit(points, *turns),
        start=start,
        end=end,
        off_plane=float(spread[2]),
        off_line=float(np.hypot(spread[1], spread[2])),
        backwards=bool(off[1] < 0.2 * off[0]),
    )


def point_noise(points: Annotated[np.ndarray, "n 3"]) -> float:
    """Standard deviation (m) of the white noise of a coordinate, as the points of a curve show it; infinite for few points.

    Each point is compared with the cubic through two neighbours on either side over the chords between them, across the curve
    only: along it, uneven distances between points would count as noise. Bends between the points raise it, so that a curve of
    few points casts no doubt; noise above the distance of points is found up to 20 % too small, that of points in a plane by
    the square root of 2."""
    points = np.asarray(points)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    points = points[np.r_[True, steps > 0]]  # repeated points say nothing of the noise
    if len(points) < len(_NEIGHBOURS) + 1:
        return np.inf
    s = np.r_[0.0, np.cumsum(steps[steps > 0])]
    middle = np.arange(2, len(points) - 2)
    near = middle[:, None] + _NEIGHBOURS
    d = s[near] - s[middle, None]
    others = [np.delete(np.arange(len(_NEIGHBOURS)), k) for k in range(len(_NEIGHBOURS))]
    weight = np.stack([np.prod(d[:, o] / (d[:, o] - d[:, [k]]), axis=1) for k, o in enumerate(others)], axis=1)  # Lagrange's
    off = points[middle] - np.einsum("nk,nkc->nc", weight, points[near])
    along = points[near[:, -1]] - points[near[:, 0]]
    across = np.linalg.norm(off, axis=1) ** 2 - np.sum(off * along, axis=1) ** 2 / np.maximum(np.sum(along**2, axis=1), _TINY)
    return float(np.sqrt(np.mean(np.maximum(across, 0.0) / (2.0 * (1.0 + np.sum(weight**2, axis=1))))))


def measured_length(study: Study) -> float | None:
    """Length (m) of the cable by its measured shapes; None if a study has scans only.

    The median over poses that are held at both ends of the curve with its gaps to the clamps; without any, the longest curve,
    or the arc length of the last marker."""
    facts = [one for pose in study.poses if (one := pose_facts(pose)) is not None]
    held = [f.covered for f in facts if f.start is not None and f.end is not None]
    if held:
        return float(np.median(held))
    reached = [f.covered for f in facts]
    for pose in study.poses:
        if pose.markers is not None and pose.change_from is None:
            beyond = 0.0 if pose.end is None else np.linalg.norm(np.nan_to_num(pose.end.position - pose.markers.points[-1]))
            reached.append(float(pose.markers.arc_length[-1] + beyond))
    return max(reached, default=None)


def _end_facts(points: Annotated[np.ndarray, "n 3"], clamp: Clamp, sign: float) -> EndFacts:
    """Position and direction of a curve that begins at this clamp; `sign` = -1 if d3 points away from the curve."""
    gap, d3 = float(np.linalg.norm(points[0] - clamp.position)), clamp.tangent
    if d3 is None or len(points) < FEWEST_BENT:
        return EndFacts(gap)
    tangent, sd = _tangent(points, gap)
    if not (size := float(np.linalg.norm(tangent))) > 0:
        return EndFacts(gap)
    return EndFacts(gap, float(np.degrees(between(sign * d3, tangent))), float(np.degrees(sd / size)))


def _tangent(points: Annotated[np.ndarray, "n 3"], gap: float) -> tuple[Annotated[np.ndarray, "3"], float]:
    """Slope at s = -gap of a parabola through the beginning of a curve, and the standard deviation of its direction.

    The window is the widest one whose slope agrees with those of all shorter ones (Lepski's rule): wide if noise
    dominates, short if the cable bends sharply behind its clamp. Where the points are so far apart that even the shortest
    window exceeds `TANGENT_SPAN`, the turn between their chords is added: `TURN` times, falling with its square below
    `RESOLVED`, and the turn over the gap."""
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    most = min(len(points), max(TANGENT_LEAST, int(np.searchsorted(s, TANGENT_SPAN * s[-1]))))
    if most <= TANGENT_LEAST:
        slope, sd = _parabola(points[:most], gap)
        turn = max(between(a, b) for a, b in pairwise(np.diff(points[:most], axis=0)))
        unseen = turn * (TURN * min(1.0, turn / RESOLVED) + gap / s[1])
        return slope, float(np.hypot(sd, np.linalg.norm(slope) * unseen))
    count = min(most, max(TANGENT_LEAST, int(np.searchsorted(s, TANGENT_START * s[-1]))))
    kept = [_parabola(points[:count], gap)]
    while count < most:
        count = min(most, count + max(1, count // 3))
        slope, sd = _parabola(points[:count], gap)
        if any(np.linalg.norm(slope - other) > 2 * np.hypot(sd, spread) for other, spread in kept):
            break
        kept.append((slope, sd))
    return kept[-1]


def _parabola(points: Annotated[np.ndarray, "m 3"], gap: float) -> tuple[Annotated[np.ndarray, "3"], float]:
    """x(t) = a + b t + c t^2 by least squares: slope b - 2 c gap, and its standard deviation over two directions.

    t runs along the main direction of the points, since the arc length of neighbours is mostly noise."""
    _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    t = (points - points[0]) @ axes[0]
    t = t * np.sign(t[-1] or 1.0)
    size = max(float(np.max(np.abs(t))), np.finfo(float).tiny)
    u = t / size
    basis = np.stack([np.ones_like(u), u, u * u], axis=1)
    fit, *_ = np.linalg.lstsq(basis, points, rcond=None)
    slope = np.array([0.0, 1.0, -2 * gap / size])
    variance = float(np.sum((points - basis @ fit) ** 2)) / (2 * max(len(t) - 3, 1))
    weight = max(float(slope @ np.linalg.pinv(basis.T @ basis) @ slope), 0.0)
    return slope @ fit / size, float(np.sqrt(2 * variance * weight) / size)


def all_plane(study: Study, facts: list[PoseFacts], limit: float) -> bool:
    """Whether every measured curve stays within `limit` (m, RMS), or its stated noise, of a plane of its own."""
    noise = [pose.noise or 0.0 for pose in study.poses if pose.curve is not None]
    plane = [f.points >= FEWEST_BENT and f.off_plane < max(limit, 2 * n) for f, n in zip(facts, noise, strict=True)]
    return bool(plane) and all(plane)
