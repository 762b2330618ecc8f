"""Repeated poses: those marked by `repeat_of`, and those with the same clamps, gravity and turns and nearly the same shape.

Repeats differ by the sensor's noise and the cable's handling, independent of the model: a lower bound for every fit. Poses that
are held alike and differ by more were not repeated: something differs between them that the study does not declare.
"""

from itertools import combinations

import numpy as np

from scan2flex_jax.study.model import Clamp, Study, StudyPose
from scan2flex_jax.study.records import same

HANDLING = 0.02  # of L, RMS: poses held alike that differ by more are no repeats; photographs of a limp strip differ by 1.9 %
_ALIKE = 1e-6  # of L: below it there is nothing to explain
_GAP = 4.0  # times the median step of a curve: an unseen part, which a chord bridges
_COMPARED = 1000  # points of a curve that are compared; of a longer one every second, third, ...
_SAME = 1e-9  # m, and of a quaternion: clamps of repeats are copied, not measured again


def repeats(study: Study) -> tuple[tuple[str, ...], ...]:
    """Groups of names of repeated poses, in the order of the study."""
    return tuple(tuple(pose.name for pose in group) for group in _groups(study) if not _apart(study, group))


def _groups(study):
    """Groups of poses that are marked as repeats, or have the same supports and effects."""
    groups: list[list[StudyPose]] = []
    for pose in (pose for pose in study.poses if not study.only_compared(pose)):
        own = next((g for g in groups if any(_repeat(study, pose, other) for other in g)), None)
        if own is None:
            groups.append(own := [])
        own.append(pose)
    return [group for group in groups if len(group) > 1]


def _apart(study, group) -> float:
    """Largest RMS distance (m) of poses that are not marked as repeats, if it exceeds that of handling, else 0."""
    pairs = [(a, b) for a, b in combinations(group, 2) if not _marked(a, b)]
    off = max((difference(a, b) or 0.0 for a, b in pairs), default=0.0)
    return off if off > HANDLING * float(np.max(study.cable.get("length", np.inf))) else 0.0


def repeat_sentences(study: Study) -> tuple[str, ...]:
    """Differences between curves or markers of repeats, one sentence for each comparable pair, and of poses that have the same
    supports and differ."""
    said, length = [], float(np.max(study.cable.get("length", np.inf)))
    for group in _groups(study):
        if off := _apart(study, group):
            size = f"{1e3 * off:.3g} mm (RMS, {100 * off / length:.2g} % of the length)"
            why = "something differs between them that the study does not declare, as a load in some of them"
            said.append(f"poses {', '.join(p.name for p in group)} are held alike and differ by up to {size}: {why}")
            continue
        for a, b in combinations(group, 2):
            if (rms := difference(a, b) or 0.0) > _ALIKE * length:
                size = f"{1e3 * rms:.2f} mm (RMS, {100 * rms / length:.2g} % of the length)"
                why = "no law that they share explains that"
                said.append(f"poses {a.name} and {b.name} repeat one another and differ by {size}: {why}")
    return tuple(said)


def difference(a: StudyPose, b: StudyPose) -> float | None:
    """RMS distance (m) from the points of one pose to the curve of another where it has one, or between equal markers of both;
    None if they cannot be compared."""
    if a.curve is not None and b.curve is not None:
        points = a.curve.points
        off = _to_polyline(points[:: 1 + (len(points) - 1) // _COMPARED], b.curve.points)
        return float(np.sqrt(np.mean(off**2))) if len(off) else None
    if a.markers is None or b.markers is None or a.change_from != b.change_from:
        return None
    _, i, j = np.intersect1d(np.round(a.markers.arc_length, 9), np.round(b.markers.arc_length, 9), return_indices=True)
    off = a.markers.points[i] - b.markers.points[j]
    return float(np.sqrt(np.mean(np.nansum(off**2, axis=1)))) if len(off) else None


def _repeat(study, a, b) -> bool:
    """Whether two poses repeat one another; of a history-dependent cable only where neither has a history."""
    if study.history_dependent and not all(p.reset or p is study.poses[0] for p in (a, b)):
        return False
    settings = [(p.turns, study.history_dependent or p.reset, study.acting(p), *study.gravity_in(p)) for p in (a, b)]
    return _marked(a, b) or (settings[0] == settings[1] and _same_clamp(a.start, b.start) and _same_clamp(a.end, b.end))


def _marked(a, b) -> bool:
    return b.name == a.repeat_of or a.name == b.repeat_of


def _same_clamp(a: Clamp | None, b: Clamp | None) -> bool:
    if a is None or b is None:
        return a is b
    p, q = a.quaternion, b.quaternion
    parallel = p is q if p is None or q is None else 1.0 - abs(float(p @ q)) < _SAME
    return parallel and np.allclose(a.position, b.position, rtol=0.0, atol=_SAME) and same((a.free, a.hinge), (b.free, b.hinge))


def _to_polyline(points, line):
    """Distances (k,) from the polyline through others (m, 3) of those points (n, 3) that are beside it: neither beyond its ends
    nor at one of its gaps."""
    along = np.diff(line, axis=0)
    long = np.linalg.norm(along, axis=1)
    least, beside = np.full(len(points), np.inf), np.zeros(len(points), bool)
    for k, (start, step) in enumerate(zip(line[:-1], along, strict=True)):
        t = (points - start) @ step / (step @ step)
        away = np.linalg.norm(points - start - np.clip(t, 0.0, 1.0)[:, None] * step, axis=1)
        off = ((t < 0) & (k == 0)) | ((t > 1) & (k == len(along) - 1)) | (long[k] > _GAP * np.median(long))
        beside = np.where(away < least, ~off, beside)
        least = np.minimum(least, away)
    return least[beside]
