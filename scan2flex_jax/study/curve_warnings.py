"""Warnings about measured curves: their ends at the clamps, their lengths, their bends.

A fault of one or two poses is named with each pose. A fault that three poses or more share has a common cause, and is one
sentence for all of them.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from scan2flex_jax.study.facts import FEWEST_BENT, PoseFacts
from scan2flex_jax.study.model import Study, StudyPose
from scan2flex_jax.study.values import one_line

GAP_WARNING = 0.01
"""Of L: a curve that stops further from its clamp misses the strongest bend."""
LENGTH_WARNING = 0.02
"""Of L: tape measures and scanners agree better than this."""
FREE_WARNING = 0.1
"""Of L: a curve that stops this far from a free end misses a large part of the cable."""
ANGLE_WARNING = 5.0
"""Degrees, beyond two standard deviations: careful mounting stays within about 3."""
ANGLE_TOLERANCE = 30.0
"""Degrees: a frame that is further off is described wrongly, and no tolerance of the mounting is its remedy."""
PLANE_LIMIT = 0.005
"""Of L, RMS: a curve with a smaller deviation counts as plane, or as straight."""
STRAIGHT = 10.0
"""Times the stated noise: a curve that deviates more from a line shows its bend, however small that is."""
COMMON = 3
"""Poses from which a fault is reported once for all of them."""

_FRAMES = "the convention of their angles, or their axis along the cable (--tangent of new)"
_Kind = Literal["gap", "tangent", "longer", "shorter", "straight"]


@dataclass(frozen=True)
class _Fault:
    """One fault of one pose in words; ``size``: the gap or the covered length (m), or the angle (deg); ``off``: per cent of the
    cable's length that the curve lacks or exceeds."""

    kind: _Kind
    pose: str
    size: float
    text: str
    off: float = 0.0


def curve_warnings(study: Study, facts: Mapping[str, PoseFacts]) -> list[str]:
    """Warnings about the curves with ``facts`` (by pose), one sentence each."""
    faults = [f for pose in study.poses if pose.name in facts for f in _of_pose(study, pose, facts[pose.name])]
    if not all(_straight(study, study.pose(name), one) for name, one in facts.items()):  # one bent pose is enough
        faults = [f for f in faults if f.kind != "straight"]
    by_kind = {kind: [f for f in faults if f.kind == kind] for kind in dict.fromkeys(f.kind for f in faults)}
    common = {kind for kind, some in by_kind.items() if len({f.pose for f in some}) >= COMMON}
    said = [_together(kind, by_kind[kind], len(facts)) for kind in by_kind if kind in common]
    return said + [f"{one_line(f.pose)}: {f.text}" for f in faults if f.kind not in common]


def mm(metres: float) -> str:
    """A length in millimetres, to three digits."""
    return f"{1e3 * metres:.3g} mm"


def _together(kind: _Kind, faults: list[_Fault], count: int) -> str:
    """One sentence for a fault that several of ``count`` curves share."""
    names = list(dict.fromkeys(one_line(f.pose) for f in faults))
    who = f"all {count} curves" if len(names) == count else f"{len(names)} of {count} curves ({', '.join(names)})"
    least, most = min(f.size for f in faults), max(f.size for f in faults)
    if kind == "gap":
        mend = "scan up to the clamps, where the cable bends most, or correct the positions of the clamps"
        return f"{who} stop {_span(1e3 * least, 1e3 * most, '.3g')} mm from their clamps: {mend}."
    if kind == "tangent":
        tolerance = f"or write clamp_rotation = {np.radians(most):.2g} under [tolerance]"
        mend = f"correct the frames: {_FRAMES}" if most > ANGLE_TOLERANCE else f"correct the frames, {tolerance}"
        return f"{who} leave their clamps {_span(least, most, '.0f')} deg off the axis d3: {mend}."
    if kind == "straight":
        mend = "bring the clamps nearer to each other, or give the poses more sag"
        return f"{who} are nearly straight and say little about stiffness: {mend}."
    off = sorted(f.off for f in faults)
    given = _span(least, most, ".4g")
    mend = f"measure the length again (the curves give {given} m), or look for missing parts of the curves"
    return f"{who} with their gaps are {_span(off[0], off[-1], '.1f')} % {kind} than the cable's length: {mend}."


def _span(least: float, most: float, form: str) -> str:
    """``9.4 to 11``, or one number if both are the same in this form."""
    return " to ".join(dict.fromkeys(f"{value:{form}}" for value in (least, most)))


def _of_pose(study: Study, pose: StudyPose, facts: PoseFacts) -> Iterator[_Fault]:
    """The faults of one measured curve."""
    length = study.known("length")
    scale = facts.covered if length is None else float(np.max(length))
    for name, end in (("start", facts.start), ("end", facts.end)):
        if end is None:
            continue
        if end.gap > GAP_WARNING * scale:
            mend = "scan up to the clamp, where the cable bends most, or correct its position"
            text = f"the curve {name}s {mm(end.gap)} from the {name} clamp: {mend}."
            yield _Fault("gap", pose.name, end.gap, text)
        if end.angle is not None and end.angle - 2 * (end.angle_sd or 0.0) > ANGLE_WARNING:
            mend = f"correct its frame, or write clamp_rotation = {np.radians(end.angle):.2g} under [tolerance]"
            if end.angle > ANGLE_TOLERANCE:
                mend = "correct its frame (its angles, or the pose that it belongs to)"
            text = f"the {name} clamp's tangent is off by {end.angle:.1f} deg from the curve: {mend}."
            yield _Fault("tangent", pose.name, end.angle, text)
    off, least = facts.covered / scale - 1, -FREE_WARNING if facts.end is None else -LENGTH_WARNING
    if length is not None and not least - facts.unseen / scale <= off <= LENGTH_WARNING:
        kind: _Kind = "longer" if off > 0 else "shorter"
        mend = f"measure the length again (the curve gives {facts.covered:.4g} m), or look for a missing part of the curve"
        text = f"the curve with its gaps is {abs(100 * off):.1f} % {kind} than the cable's length: {mend}."
        yield _Fault(kind, pose.name, facts.covered, text, abs(100 * off))
    if _straight(study, pose, facts):
        mend = "bring its clamps nearer to each other, or give the pose more sag"
        text = f"the curve is nearly straight and says little about stiffness: {mend}."
        yield _Fault("straight", pose.name, facts.off_line, text)


def _straight(study: Study, pose: StudyPose, facts: PoseFacts) -> bool:
    """Whether a curve hardly deviates from a line: by less than `PLANE_LIMIT`, or than a few times its stated noise."""
    length = study.known("length")
    limit = PLANE_LIMIT * (facts.covered if length is None else float(np.max(length)))
    limit = limit if pose.noise is None else min(limit, STRAIGHT * pose.noise)
    return facts.points >= FEWEST_BENT and facts.off_line < limit
