"""Mistakes visible before any solve: in the ends of the curves, their tangents there, and their lengths.

A pose is *astray* if a curve ends far from its clamp, or leaves it far from d3. A hypothesis (`study.mistakes`) is reported
if it brings all astray poses back to their clamps and leads none astray: mistakes of all poses first, then those of single
poses and curves of two poses that are exchanged.
"""

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from scan2flex_jax.study import mistakes
from scan2flex_jax.study.curve_warnings import PLANE_LIMIT
from scan2flex_jax.study.curves import curve_length
from scan2flex_jax.study.facts import pose_facts
from scan2flex_jax.study.mistakes import Mistake
from scan2flex_jax.study.model import MeasuredCurve, Study, StudyPose
from scan2flex_jax.study.sense import unit_of

_GAP, _ANGLE = 0.1, 45.0  # of L, and degrees: a curve is astray beyond this distance from its clamp, or this angle from d3
_BACK = 0.5  # of both: a nearer curve has been brought back
_SAME = 0.1  # relative difference of lengths that count as equal: curves stop short of clamps
_ARCH = 0.05  # of L: a curve whose mean lies this far above its chord (free end: initial tangent) stands against gravity
_SCALES, _CLEAR = (0.01, 0.15), 0.35  # reported changes of a scale; remaining gaps over those before


def visible_mistakes(study: Study) -> tuple[Mistake, ...]:
    """The mistakes visible without a solve, each with the cumulatively corrected study; empty if no pose is astray."""
    if found := tuple(_of_units(study)) or tuple(_of_markers(study)):
        return found
    astray = {pose.name for pose in study.poses if _off(study, pose) > 1.0}
    hypotheses = itertools.chain(mistakes.of_frames(study), mistakes.of_axes(study))
    if astray and (mistake := next((m for m in hypotheses if _mends(m, study, astray)), None)):
        return (mistake,)
    if found := tuple(_of_some_poses(study, astray)):
        return found
    upward = bool(study.poses) and all(stands(study, pose) for pose in study.poses)
    said = "every curve rises against gravity, which must point the right way"
    return tuple(replace(m, sentence=said) for m in itertools.islice(mistakes.of_gravity(study), 1) if upward)


def _of_markers(study) -> Iterator[Mistake]:
    """Exchanged markers, one pair a pose, in turn."""
    for pose in study.poses:
        for mistake in mistakes.of_markers(study, pose):
            study = mistake.study
            yield mistake


def _of_some_poses(study, astray) -> Iterator[Mistake]:
    """Mistakes of single poses and of pairs, in turn; curves whose ends alone show that they run backwards come first."""
    for pose in study.poses:
        facts = pose_facts(pose)
        if facts is not None and facts.backwards and _off(study, mistakes.exchanged_ends(pose)) >= _BACK:
            turned = mistakes.of_reversed(study, pose)
            study, astray = turned.study, astray - {pose.name}
            yield turned
    while astray:
        single = (m for name in sorted(astray) for m in mistakes.of_pose(study, study.pose(name)))
        mistake = next((m for m in (*single, *mistakes.of_pairs(study)) if _mends(m, study, astray, few=True)), None)
        if mistake is None:
            return
        astray = astray - _touched(mistake.study, study)
        study = mistake.study
        yield mistake


def _touched(after, before) -> set[str]:
    """Names of the poses that differ."""
    return {new.name for new, old in zip(after.poses, before.poses, strict=True) if new is not old}


def _mends(mistake, study, astray, few=False) -> bool:
    """Whether all astray poses are brought back (with ``few``: the changed ones), and no other is led astray."""
    changed = _touched(mistake.study, study)
    wanted = astray & changed if few else astray
    return bool(wanted) and all(_off(study, mistake.study.pose(name)) < _BACK for name in wanted | changed)


def _off(study, pose) -> float:
    """Distance of a pose's curve from its clamps, in units of the astray threshold; 0 if undefined."""
    if (facts := pose_facts(pose)) is None:
        return 0.0
    scale = study.length or facts.covered
    ends = [end for end in (facts.start, facts.end) if end is not None]
    angles = [end.angle - 2 * (end.angle_sd or 0.0) for end in ends if end.angle is not None]
    return max(max((end.gap for end in ends), default=0.0) / (_GAP * scale), max(angles, default=0.0) / _ANGLE)


def stands(study: Study, pose: StudyPose) -> bool:
    """Whether a curve rises against gravity: above its chord, or above the initial tangent of a cable with a free end."""
    gravity, length = study.gravity_in(pose), study.length
    size = float(np.linalg.norm(gravity))
    if pose.curve is None or pose.start is None or length is None or not size > 0:
        return False
    line = 0.5 * (pose.start.position + (pose.start.position if pose.end is None else pose.end.position))
    if pose.end is None and pose.start.tangent is not None:
        line = line + 0.5 * curve_length(pose.curve.points) * pose.start.tangent
    return float((pose.curve.points.mean(axis=0) - line) @ gravity) / size < -_ARCH * length


def carried(study: Study) -> bool:
    """Whether every curve lies level, across gravity, and bends there, as on a table."""
    level = []
    for pose in study.poses:
        down, facts = study.gravity_in(pose), pose_facts(pose)
        if pose.curve is not None and facts is not None:
            heights = pose.curve.points @ down / max(float(np.linalg.norm(down)), np.finfo(float).tiny)
            level.append(np.any(down) and np.std(heights) < PLANE_LIMIT * curve_length(pose.curve.points) < facts.off_line)
    return bool(level) and all(level)


def _of_units(study) -> Iterator[Mistake]:
    """One of length, curves and clamps in another unit than the two others, whose lengths agree."""
    curves = [pose for pose in study.poses if pose.curve is not None]
    if (whole := study.length) is None or not curves:
        return
    long = float(np.median([curve_length(pose.curve.points) for pose in curves]))
    both = [pose for pose in curves if pose.start is not None and pose.end is not None]
    chords = [float(np.linalg.norm(p.curve.points[-1] - p.curve.points[0])) for p in both]
    spans = [float(np.linalg.norm(p.end.position - p.start.position)) for p in both]
    ratios = [chord / span for chord, span in zip(chords, spans, strict=True) if span > 0]
    across = float(np.median(ratios)) if ratios else None
    agree = across is None or abs(across - 1.0) < _SAME  # curves and clamps
    if agree and (unit := unit_of(whole / long)):
        said = f"the curves are {long:.3g} m long, and the length looks like {unit[0]}"
        cable = {**study.cable, "length": whole / unit[1]}
        yield Mistake(said, f"write length = {cable['length']:.6g}", replace(study, cable=cable))
    elif across is not None and abs(long / whole - 1.0) < _SAME and (unit := unit_of(1.0 / across)):
        mended = _scaled_clamps(study, 1.0 / unit[1])
        yield Mistake(f"the clamps' positions look like {unit[0]}", f"divide them by {unit[1]:.6g}", mended)
    elif (unit := unit_of(long / whole)) and (across is None or unit_of(across) == unit):
        mended = _scaled_curves(study, 1.0 / unit[1])
        yield Mistake(f"the curves look like {unit[0]}", f"divide them by {unit[1]:.6g}", mended)


def _scaled_curves(study: Study, factor: float) -> Study:
    """The study with every curve scaled about the origin of the scan frame."""

    def one(curve):
        s = None if curve is None or curve.arc_length is None else factor * curve.arc_length
        return curve and MeasuredCurve(factor * curve.points, s)

    return replace(study, poses=tuple(replace(p, curve=one(p.curve)) for p in study.poses))


def _scaled_clamps(study: Study, factor: float) -> Study:
    """The study with the positions of all clamps scaled about the origin of the scan frame."""

    def one(clamp):
        return clamp and replace(clamp, position=factor * clamp.position)

    return replace(study, poses=tuple(replace(p, start=one(p.start), end=one(p.end)) for p in study.poses))


def scale_between(study: Study) -> Mistake | None:
    """Curves that are larger or smaller than the clamps' positions by a few per cent; None if gaps show no common factor.

    Only gaps across d3 count, since curves may stop short of their clamps. The cable's length decides which of them is wrong.
    """
    positions, gaps = [], []
    curves = [(pose, pose.curve) for pose in study.poses if pose.curve is not None]
    for pose, curve in curves:
        for clamp, point in ((pose.start, curve.points[0]), (pose.end, curve.points[-1])):
            if clamp is not None:
                across = np.eye(3) - (0.0 if clamp.tangent is None else np.outer(clamp.tangent, clamp.tangent))
                positions.append(across @ clamp.position)
                gaps.append(across @ (point - clamp.position))
    if study.length is None or not gaps:
        return None
    p, g = np.ravel(positions), np.ravel(gaps)
    more = float(g @ p / (p @ p)) if np.any(p) else 0.0
    if not _SCALES[0] < abs(more) < _SCALES[1] or np.linalg.norm(g - more * p) > _CLEAR * np.linalg.norm(g):
        return None
    covered = [facts.covered for pose, _ in curves if (facts := pose_facts(pose)) is not None]
    along = float(np.median(covered)) / study.length - 1.0
    if abs(along - more) < abs(along):
        said = f"the curves look {abs(100 * more):.1f} % too {'large' if more > 0 else 'small'}"
        mend = f"divide them by {1 + more:.4f}, or declare the effect scan_scale"
        return Mistake(said, mend, _scaled_curves(study, 1.0 / (1.0 + more)))
    said = f"the clamps' positions look {abs(100 * more):.1f} % too {'small' if more > 0 else 'large'}"
    return Mistake(said, f"multiply them by {1 + more:.4f}", _scaled_clamps(study, 1.0 + more))


def clamps_scaled(study: Study) -> tuple[Mistake, ...]:
    """A wrong scale of the clamps' positions; that of the curves is an effect of the catalogue."""
    found = scale_between(study)
    return (found,) if found is not None and found.study.poses[0].curve is study.poses[0].curve else ()
