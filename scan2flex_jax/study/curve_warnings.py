"""Warnings about measured curves: their ends at the clamps, their lengths, their bends.

A fault of one or two poses is named with each pose. A fault that three poses or more share has a common cause, and is one
sentence for all of them.
"""

from collections.abc import Iterator, Mapping
from typing import Literal, NamedTuple

import numpy as np

from scan2flex_jax.study.facts import FEWEST_BENT, PoseFacts
from scan2flex_jax.study.model import Study, StudyPose
from scan2flex_jax.study.values import one_line

GAP_WARNING = 0.01  # of L: a curve that stops further from its clamp misses the strongest bend
LENGTH_WARNING = 0.02  # of L: tape measures and scanners agree better than this
FREE_WARNING = 0.1  # of L: a curve that stops this far from a free end misses a large part of the cable
ANGLE_WARNING = 5.0  # degrees, beyond two standard deviations: careful mounting stays within about 3
ANGLE_TOLERANCE = 30.0  # degrees: a frame that is further off is described wrongly, which no tolerance of the mounting remedies
PLANE_LIMIT = 0.005  # of L, RMS: a curve with a smaller deviation counts as plane, or as straight
STRAIGHT = 10.0  # times the stated noise: a curve that deviates more from a line shows its bend, however small that is
COMMON = 3  # poses from which a fault is reported once for all of them


class _Fault(NamedTuple):
    """One fault of one pose; ``size``: the gap or the covered length (m), or the angle (deg); ``end``: of the clamp;
    ``off``: per cent of the cable's length that the curve lacks or exceeds."""

    kind: Literal["gap", "tangent", "longer", "shorter", "straight"]
    pose: str
    size: float
    end: str = ""
    off: float = 0.0


def curve_warnings(study: Study, facts: Mapping[str, PoseFacts]) -> list[str]:
    """Warnings about the curves with ``facts`` (by pose), one sentence each."""
    faults = [f for pose in study.poses if pose.name in facts for f in _of_pose(study, pose, facts[pose.name])]
    if not all(_straight(study, study.pose(name), one) for name, one in facts.items()):  # one bent pose is enough
        faults = [f for f in faults if f.kind != "straight"]
    warnings = []
    for kind in dict.fromkeys(f.kind for f in faults):
        some = [f for f in faults if f.kind == kind]
        common = len({f.pose for f in some}) >= COMMON
        warnings += [_sentence(group, len(facts)) for group in ([some] if common else [[f] for f in some])]
    return warnings


def mm(metres: float) -> str:
    """A length in millimetres, to three digits."""
    return f"{1e3 * metres:.3g} mm"


def _sentence(faults: list[_Fault], count: int) -> str:
    names = list(dict.fromkeys(one_line(f.pose) for f in faults))
    many, kind = len(names) > 1, faults[0].kind
    who = f"all {count} curves" if len(names) == count else f"{len(names)} of {count} curves ({', '.join(names)})"
    who, its, s, are = (who, "their", "", "are") if many else (f"{names[0]}: the curve", "its", "s", "is")
    clamps, curves = ("their clamps", "the curves") if many else (f"the {faults[0].end} clamp", "the curve")
    least, most = min(f.size for f in faults), max(f.size for f in faults)
    if kind == "gap":
        mend = f"scan up to {clamps}, where the cable bends most, or correct {its} position{'s' * many}"
        return f"{who} stop{s} {_span(1e3 * least, 1e3 * most, '.3g')} mm from {clamps}: {mend}."
    if kind == "tangent":
        mend = f", or write clamp_rotation = {np.radians(most):.2g} under [tolerance]"
        if most > ANGLE_TOLERANCE:
            several = "the convention of their angles, or their axis along the cable: --tangent of new"
            mend = f" ({several if many else 'its angles, or the pose that it belongs to'})"
        said = f"{who} meet{s} {clamps} {_span(least, most, '.1f')} deg off the axis d3"
        return f"{said}: correct {its} frame{'s' * many}{mend}."
    if kind == "straight":
        mend = f"bring {its} clamps nearer to each other, or give the pose{'s' * many} more sag"
        return f"{who} {are} nearly straight and say{s} little about stiffness: {mend}."
    off, given = sorted(f.off for f in faults), _span(least, most, ".4g")
    mend = f"measure the length again ({curves} give{s} {given} m), or look for missing parts of {curves}"
    return f"{who} with {its} gaps {are} {_span(off[0], off[-1], '.1f')} % {kind} than the cable's length: {mend}."


def _span(least: float, most: float, form: str) -> str:
    """``9.4 to 11``, or one number if both are the same in this form."""
    return " to ".join(dict.fromkeys(f"{value:{form}}" for value in (least, most)))


def _of_pose(study: Study, pose: StudyPose, facts: PoseFacts) -> Iterator[_Fault]:
    scale = study.length or facts.covered
    for name, end in (("start", facts.start), ("end", facts.end)):
        if end is not None and end.gap > GAP_WARNING * scale:
            yield _Fault("gap", pose.name, end.gap, name)
        if end is not None and end.angle is not None and end.angle - 2 * (end.angle_sd or 0.0) > ANGLE_WARNING:
            yield _Fault("tangent", pose.name, end.angle, name)
    off, least = facts.covered / scale - 1, -FREE_WARNING if facts.end is None else -LENGTH_WARNING
    if study.length is not None and not least - facts.unseen / scale <= off <= LENGTH_WARNING:
        yield _Fault("longer" if off > 0 else "shorter", pose.name, facts.covered, off=abs(100 * off))
    if _straight(study, pose, facts):
        yield _Fault("straight", pose.name, facts.off_line)


def _straight(study: Study, pose: StudyPose, facts: PoseFacts) -> bool:
    """Whether a curve hardly deviates from a line: by less than `PLANE_LIMIT`, or than a few times its stated noise."""
    limit = PLANE_LIMIT * (study.length or facts.covered)
    limit = limit if pose.noise is None else min(limit, STRAIGHT * pose.noise)
    return facts.points >= FEWEST_BENT and facts.off_line < limit
