"""Poses that were measured more than once: those that say so (`repeat_of`), and those with the same clamps, gravity and turns.

What repeats differ in is the sensor's noise and the cable's handling, whatever the model: it is the floor of every fit.
"""

from itertools import combinations

import numpy as np

from scan2flex_jax.study.model import Clamp, Study, StudyPose

_SAME = 1e-9  # m, and of a quaternion: clamps are written down, not measured anew


def repeats(study: Study) -> tuple[tuple[str, ...], ...]:
    """Groups of names of poses that are repeats of one another, in the order of the study."""
    groups: list[list[StudyPose]] = []
    for pose in study.poses:
        own = next((g for g in groups if any(_said(pose, other) or _alike(study, pose, other) for other in g)), None)
        if own is None:
            groups.append([pose])
        else:
            own.append(pose)
    return tuple(tuple(p.name for p in g) for g in groups if len(g) > 1)


def repeat_sentences(study: Study) -> tuple[str, ...]:
    """By how much the curves or markers of repeats differ, one sentence for each pair that can be compared."""
    said, length = [], float(np.max(study.cable.get("length", np.inf)))
    for group in repeats(study):
        for a, b in combinations(map(study.pose, group), 2):
            rms = difference(a, b)
            if rms is not None:
                said.append(
                    f"poses {a.name} and {b.name} repeat one another and differ by {1e3 * rms:.2f} mm (RMS, "
                    f"{100 * rms / length:.2g} % of the length): no law that they share explains that"
                )
    return tuple(said)


def difference(a: StudyPose, b: StudyPose) -> float | None:
    """RMS distance (m) from the points of one pose to the curve through those of another, or between the same markers of both;
    None where there is nothing to compare."""
    if a.curve is not None and b.curve is not None:
        return float(np.sqrt(np.mean(_to_polyline(a.curve.points, b.curve.points) ** 2)))
    if a.markers is None or b.markers is None:
        return None
    _, i, j = np.intersect1d(np.round(a.markers.arc_length, 9), np.round(b.markers.arc_length, 9), return_indices=True)
    off = a.markers.points[i] - b.markers.points[j]
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1)))) if len(off) else None


def _said(pose, other):
    return other.name == pose.repeat_of or pose.name == other.repeat_of


def _alike(study, a, b):
    """Whether two poses are held alike, and what acts in one acts in the other."""
    gravity = [study.gravity if p.gravity is None else p.gravity for p in (a, b)]
    acting = [[e.poses is None or p.name in e.poses for e in study.effects] for p in (a, b)]
    held = _same_clamp(a.start, b.start) and _same_clamp(a.end, b.end)
    return held and a.turns == b.turns and a.reset == b.reset and acting[0] == acting[1] and np.array_equal(*gravity)


def _same_clamp(a: Clamp | None, b: Clamp | None) -> bool:
    if a is None or b is None:
        return a is b
    if (a.quaternion is None) != (b.quaternion is None) or not np.allclose(a.position, b.position, rtol=0.0, atol=_SAME):
        return False
    return a.quaternion is None or 1.0 - abs(float(a.quaternion @ b.quaternion)) < _SAME


def _to_polyline(points, line):
    """Distances (n,) of points (n, 3) from the polyline through others (m, 3)."""
    along = np.diff(line, axis=0)
    least = np.full(len(points), np.inf)
    for start, step in zip(line[:-1], along, strict=True):
        t = np.clip((points - start) @ step / (step @ step), 0.0, 1.0)
        least = np.minimum(least, np.linalg.norm(points - start - t[:, None] * step, axis=1))
    return least
