"""Likely mistakes of the input as hypotheses: each with its description, its correction, and the corrected study.

Every hypothesis is a pure change of a study; nothing is solved here. `study.visible` tests those that are visible in ends and
tangents of the curves, `inference.mistakes` the others by a refit. Rotations ``R`` of clamps turn material vectors into the
scan frame, d3 = R e3; a change of convention multiplies them from the right.
"""

import functools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import Annotated, Any

import numpy as np

from scan2flex_jax.study.kinds import ENDS
from scan2flex_jax.study.model import Markers, Study, StudyPose
from scan2flex_jax.study.rotations import product, rolled, twist_along
from scan2flex_jax.study.sense import knows_a_force, moved
from scan2flex_jax.study.values import one_line

_SMALL = np.radians(2.0)  # rad: a roll or twist whose sign is irrelevant
_PARALLEL = 0.99  # cosine of two directions that count as one
_HALF = 2**-0.5
_AXES = (  # a clamp's axis along which the cable leaves it, and the rotation of e3 to that axis
    ("d1, its x axis,", (_HALF, 0.0, _HALF, 0.0), "x"),
    ("d2, its y axis,", (_HALF, -_HALF, 0.0, 0.0), "y"),
    ("-d1, against its x axis,", (_HALF, 0.0, -_HALF, 0.0), "-x"),
    ("-d2, against its y axis,", (_HALF, _HALF, 0.0, 0.0), "-y"),
    ("-d3, against its z axis,", (0.0, 1.0, 0.0, 0.0), "-z"),
)
_ABOUT = (("d1", (0.0, 1.0, 0.0, 0.0)), ("d2", (0.0, 0.0, 1.0, 0.0)))  # half turns that reverse the direction of an end
_MAPS = (  # measured shapes in other axes, and their x, y and z as they should be written
    ("have their y axis up, and the clamps their z axis", "x, -z, y"),
    ("have their z axis up, and the clamps their y axis", "x, z, -y"),
    ("are mirrored: their x axis points the other way", "-x, y, z"),
    ("are mirrored: their y axis points the other way", "x, -y, z"),
    ("are mirrored: their z axis points the other way", "x, y, -z"),
    ("are mirrored: their y and z axes are exchanged", "x, z, y"),
)
_WEIGHTS = (("g/m", 1e3), ("lb/m", 1 / 0.45359237), ("t/m", 1e-3))  # units of weight, and how many of them make a kg/m
_ROLLS = {degrees: rolled(np.array([1.0, 0.0, 0.0, 0.0]), np.radians(degrees)) for degrees in (180, 90, -90)}
_FLIPPED = 0.2  # of a reading: it is nearer to its expected value with the other sign than this
_CHORDS = 4  # that the exchange of two markers changes
_APART, _NOISY = 1.3, 0.01  # neighbouring markers are no farther apart than this many times their arc length, and so much of s


@dataclass(frozen=True)
class Mistake:
    """A likely mistake of the input: its description, the advice, and the corrected study.

    ``axis``: the axis of every clamp's frame along which the cable leaves it, if that is the mistake ("x", "-y"; else "").
    ``before`` and ``after``: RMS distance (m) of the fitted poses, as given and corrected; None without a refit.
    ``reading``: whether it concerns single readings of markers, which no physics moves; ``place``: name of the pose and number
    of the marker that is left out."""

    sentence: str
    mend: str
    study: Study = field(repr=False)
    before: float | None = None
    after: float | None = None
    axis: str = ""
    reading: bool = False
    place: tuple[str, int] | None = None

    def __str__(self) -> str:
        """``description: advice (improvement)``."""
        said = f"{self.sentence}: {self.mend}"
        if self.before is None or self.after is None:
            return said
        times, figures = self.before / self.after, f"{1e3 * self.after:.3g} mm in place of {1e3 * self.before:.3g} mm"
        return f"{said} (fits {times:.0f} times better, {figures})" if 2.0 < times < 1e3 else f"{said} ({figures})"

    def to_json(self) -> dict[str, Any]:
        """Sentence, advice and RMS distances (m)."""
        figures = {"rms_before": self.before, "rms_after": self.after}
        return {"sentence": self.sentence, "mend": self.mend} | {k: v for k, v in figures.items() if v is not None}


def of_frames(study: Study) -> Iterator[Mistake]:
    """Mistakes of all clamps or all curves that are visible in ends and tangents of the curves, simplest first."""
    yield from _changed(study, "every curve runs from end to start", "reverse the order of the points", reversed_curve)
    yield from _changed(study, "start and end of every pose are exchanged", "exchange the clamps of each pose", exchanged_ends)
    for about, turn in _ABOUT:
        for end in ("end", "start"):
            said = f"d3 of every {end} clamp points against the cable (about {about})"
            yield from _changed(study, said, f"multiply the {end} quaternions {_by(turn)}", _turned(turn, (end,)))
    for words, turn, axis in _AXES:
        said = f"the cable leaves every clamp along {words} not along d3"
        mend = f"multiply the quaternions {_by(turn)}, or make the study anew with --tangent {axis} in place of z"
        yield from _changed(study, said, mend, _turned(turn), axis=axis)
    said, mend = "the quaternions of the clamps are conjugated (scan frame to clamp)", "change the signs of their x, y and z"
    yield from _changed(study, said, mend, _each_clamp(lambda q: q * np.array([1.0, -1.0, -1.0, -1.0])))
    said, mend = "the quaternions of the clamps have their scalar last", "write them as [w, x, y, z]"
    yield from _changed(study, said, mend, _each_clamp(lambda q: np.roll(q, 1)))


def of_axes(study: Study) -> Iterator[Mistake]:
    """Measured shapes in other axes than the clamps, or mirrored; visible in their ends and tangents."""
    for words, xyz in _MAPS:
        change = functools.partial(_mapped, axes=xyz.split(", "))
        yield from _changed(study, f"the curves {words}", f"write {xyz} in place of x, y, z", change)


def of_markers(study: Study, pose: StudyPose) -> Iterator[Mistake]:
    """Two markers of a pose that are exchanged: neighbours are then farther apart than their arc lengths allow."""
    far, marks, found = far_neighbours(study, pose), pose.markers, list[tuple[float, int, int]]()
    if marks is None or len(far) > _CHORDS:
        return
    for i, j in {(int(min(i, j)), int(max(i, j))) for i in {*far, *(far + 1)} for j in range(len(marks.points))}:
        other = _with_exchanged(pose, i, j)
        if other is not None and not len(far_neighbours(study, other)):
            found.append((float(np.sum(_chords(other))), i, j))
    if found and (nearest := exchanged_markers(study, pose, *min(found)[1:])):
        yield nearest


def exchanged_markers(study: Study, pose: StudyPose, i: int, j: int) -> Mistake | None:
    """Markers ``i`` and ``j`` of a pose are exchanged; None if that would bring equal points together."""
    if (other := _with_exchanged(pose, i, j)) is None:
        return None
    at = " and ".join(f"{_markers(pose).arc_length[k]:.4g} m" for k in (i, j))
    said = f"markers {i + 1} and {j + 1} of pose {one_line(pose.name)} are exchanged (s = {at})"
    return Mistake(said, "exchange their coordinates", _with_poses(study, other), reading=True)


def exchanged_tables(study: Study, a: StudyPose, b: StudyPose) -> Mistake:
    """The markers of two poses are exchanged."""
    said = f"the markers of poses {one_line(a.name)} and {one_line(b.name)} are exchanged"
    mended = _with_poses(study, replace(a, markers=b.markers), replace(b, markers=a.markers))
    return Mistake(said, "exchange their tables", mended, reading=True)


def without_marker(study: Study, pose: StudyPose, k: int) -> Mistake | None:
    """Marker ``k`` of a pose is misread, so that the fit does without it; None if no fit remains."""
    said, mend = f"marker {k + 1} of pose {one_line(pose.name)} is misread", "read it again, or leave its row out"
    marks = _markers(pose)
    if len(marks.points) > 1:
        rows = {"points": marks.points, "arc_length": marks.arc_length, "offset": marks.offset}
        rest: dict[str, Any] = {name: np.delete(table, k, axis=0) for name, table in rows.items() if table is not None}
        other = replace(pose, markers=replace(marks, **rest))
    elif pose.curve is not None:
        other = replace(pose, markers=None)
    elif len(study.fit_poses) > 1:
        other, mend = replace(pose, role="validate"), 'read it again, or give its pose role = "validate"'
    else:
        return None
    return Mistake(said, mend, _with_poses(study, other), reading=True, place=(pose.name, k))


def of_reading(mistake: Mistake, pose: StudyPose, k: int, off: Annotated[np.ndarray, "3"]) -> Mistake:
    """The mistake of marker ``k`` with the coordinate that is misread: ``off`` (m), measured minus expected, is zero along
    coordinates that were not measured."""
    axis = int(np.argmax(np.abs(off)))
    value, s = float(_markers(pose).points[k, axis]), _markers(pose).arc_length[k]
    expected = value - float(off[axis])
    what = "has the wrong sign" if abs(value + expected) < _FLIPPED * abs(value) else "is misread"
    said = f"{'xyz'[axis]} of marker {k + 1} of pose {one_line(pose.name)} {what} (s = {s:.4g} m): "
    said += f"{1e3 * value:.4g} mm, where the other readings let expect {1e3 * expected:.4g} mm"
    return replace(mistake, sentence=said)


def _with_exchanged(pose, i, j):
    points = pose.markers.points.copy()
    points[[i, j]] = points[[j, i]]
    together = np.any(np.all(points[1:] == points[:-1], axis=1))
    return None if together else replace(pose, markers=replace(pose.markers, points=points))


def _markers(pose: StudyPose) -> Markers:
    """Those of a pose that has some."""
    if pose.markers is None:
        raise ValueError("the pose has no markers")
    return pose.markers


def far_neighbours(study: Study, pose: StudyPose) -> Annotated[np.ndarray, " k"]:
    """Indices of markers that are farther from the next one than their arc lengths allow."""
    if pose.markers is None or moved(study) or not on_axis(pose):
        return np.zeros(0, int)
    s, chords = pose.markers.arc_length, _chords(pose)
    return np.flatnonzero(chords > _APART * np.diff(s) + _NOISY * s[-1] + 3.0 * np.sqrt(2.0) * (pose.noise or 0.0))


def on_axis(pose: StudyPose) -> bool:
    """Whether the markers of a pose are places of its centre curve: neither beside it, nor changes from another pose."""
    return pose.markers is not None and pose.markers.offset is None and pose.change_from is None


def _chords(pose):
    return np.linalg.norm(np.nan_to_num(np.diff(pose.markers.points, axis=0)), axis=1)


def _mapped(pose, axes):
    """The pose with its curve and its markers in other axes, as in ["x", "-z", "y"]."""
    of, sign = ["xyz".index(axis[-1]) for axis in axes], [-1.0 if axis[0] == "-" else 1.0 for axis in axes]
    measured = {"curve": pose.curve, "markers": pose.markers}
    return replace(pose, **{n: one and replace(one, points=sign * one.points[:, of]) for n, one in measured.items()})


def of_rolls(study: Study) -> Iterator[Mistake]:
    """Mistakes of the roll of all end clamps about d3: a constant offset, or the sign."""
    for degrees, turn in _ROLLS.items():
        by = "half a turn" if degrees == 180 else f"{-degrees} degrees"
        said = f"the end clamp of every pose is rolled by {by} about d3"
        yield from _changed(study, said, f"multiply the end quaternions {_by(turn)}", _rolled_by(degrees))
    mend = "turn the roll of the end clamps about d3 the other way"
    yield from _changed(study, "the twist of every pose has the wrong sign", mend, _untwisted)
    first = next((pose.end for pose in study.poses if _twisted(pose)), None)
    if first is not None:
        said = "the roll of the end clamps, from pose to pose, has the wrong sign"
        yield from _changed(study, said, mend, functools.partial(_untwisted, first=first))


def of_gravity(study: Study) -> Iterator[Mistake]:
    """Gravity upward, or along another axis of the scan frame."""
    if any(pose.gravity is not None for pose in study.poses):
        return
    size = float(np.linalg.norm(study.gravity))
    axes = [sign * size * axis for axis in np.eye(3)[::-1] for sign in (-1.0, 1.0)]
    across = [axis for axis in axes if abs(axis @ study.gravity) < _PARALLEL * size**2]
    for other in [-study.gravity, *across] if size > 0 else ():
        where = "the other way" if np.allclose(other, -study.gravity) else "along another axis"
        yield Mistake(f"gravity points {where}", f"write gravity = {written(other)}", replace(study, gravity=other))


def of_weight(study: Study) -> Iterator[Mistake]:
    """The weight per length in another unit, if a known force or stiffness sets the scale; shapes alone do not show it."""
    density = study.known("length_density")
    stiffness = any(study.known(name) is not None for name in ("bending_stiffness", "torsional_stiffness"))
    if density is None or not (stiffness or knows_a_force(study)):
        return
    for unit, factor in _WEIGHTS:
        right = float(np.max(density)) / factor
        mended = replace(study, cable={**study.cable, "length_density": right})
        yield Mistake(f"the weight per length looks like {unit}", f"write length_density = {right:.6g}", mended)


def of_pose(study: Study, pose: StudyPose) -> Iterator[Mistake]:
    """Mistakes of one pose alone."""
    who = f"pose {one_line(pose.name)}"
    for turns in (pose.turns + 1, pose.turns - 1) if _twisted(pose) else ():
        mended = _with_poses(study, replace(pose, turns=turns))
        yield Mistake(f"the turns of {who} are off by one", f"write turns = {turns}", mended)
    if pose.curve is not None:
        yield of_reversed(study, pose)
    changes = [
        (f"start and end of {who} are exchanged", "exchange its clamps", exchanged_ends),
        (f"the twist of {who} has the wrong sign", "turn the roll of its end clamp the other way", _untwisted),
    ]
    for degrees, turn in _ROLLS.items():
        said = f"the end clamp of {who} is rolled by {abs(degrees)} degrees about d3"
        changes.append((said, f"multiply its end quaternion {_by(turn)}", _rolled_by(degrees)))
    for said, mend, change in changes:
        if (other := change(pose)) is not pose:
            yield Mistake(said, mend, _with_poses(study, other))


def of_reversed(study: Study, pose: StudyPose) -> Mistake:
    """The curve of one pose runs from end to start."""
    said = f"the curve of pose {one_line(pose.name)} runs from end to start"
    return Mistake(said, "reverse the order of its points", _with_poses(study, reversed_curve(pose)))


def of_pairs(study: Study) -> Iterator[Mistake]:
    """Exchanged curves of two poses, at least one of them a pose of the fit."""
    for a, b in combinations([pose for pose in study.poses if pose.curve is not None], 2):
        if "fit" in (a.role, b.role):
            mended = _with_poses(study, replace(a, curve=b.curve), replace(b, curve=a.curve))
            said = f"the curves of poses {one_line(a.name)} and {one_line(b.name)} are exchanged"
            yield Mistake(said, "exchange their centre_curve", mended)


def without(study: Study, pose: StudyPose) -> Mistake:
    """Exclude a single misfitting pose from the fit."""
    said = f"pose {one_line(pose.name)} does not fit, and the others fit without it"
    mend = 'look at its clamps, turns and curve, or give it role = "validate"'
    return Mistake(said, mend, _with_poses(study, replace(pose, role="validate")))


def _with_poses(study: Study, *poses: StudyPose) -> Study:
    """The study with poses replaced by name."""
    new = {pose.name: pose for pose in poses}
    return replace(study, poses=tuple(new.get(pose.name, pose) for pose in study.poses))


def written(values: Sequence[float] | Annotated[np.ndarray, " n"]) -> str:
    """Numbers in the notation of study.toml."""
    return "[" + ", ".join(f"{v:.7g}" for v in np.round(np.asarray(values), 12) + 0.0) + "]"


def _changed(study, said, mend, change, axis="") -> Iterator[Mistake]:
    """The study with every pose changed; nothing if no pose changes."""
    poses = tuple(map(change, study.poses))
    if any(new is not old for new, old in zip(poses, study.poses, strict=True)):
        yield Mistake(said, mend, replace(study, poses=poses), axis=axis)


def reversed_curve(pose: StudyPose) -> StudyPose:
    """The pose with its curve reversed."""
    if pose.curve is None:
        return pose
    s = pose.curve.arc_length
    turned = None if s is None else s[-1] + s[0] - s[::-1]
    return replace(pose, curve=replace(pose.curve, points=pose.curve.points[::-1], arc_length=turned))


def exchanged_ends(pose: StudyPose) -> StudyPose:
    """The pose with its clamps exchanged; unchanged with a single clamp."""
    return pose if pose.start is None or pose.end is None else replace(pose, start=pose.end, end=pose.start)


def _each_clamp(change, ends=ENDS):
    """A change of poses that changes the quaternions of these ends."""

    def one(pose):
        held = {end: getattr(pose, end) for end in ends if getattr(pose, end) is not None}
        new = {end: replace(c, quaternion=change(c.quaternion)) for end, c in held.items() if c.quaternion is not None}
        return replace(pose, **new) if new else pose

    return one


def _turned(turn, ends=ENDS):
    return _each_clamp(lambda q: product(q, np.array(turn)), ends)


def _by(turn) -> str:
    return f"from the right by {written(turn)}"


def _twisted(pose) -> bool:
    """Whether both ends are clamps, so that the twist of the cable is prescribed."""
    return all(clamp is not None and clamp.quaternion is not None for clamp in (pose.start, pose.end))


def _rolled_by(degrees):
    return functools.partial(_rolled_end, angle=np.radians(degrees))


def _rolled_end(pose, angle):
    """The end clamp rolled about its d3 by an angle (rad); unchanged without a prescribed twist."""
    if not _twisted(pose) or abs(angle) < _SMALL:
        return pose
    return replace(pose, end=replace(pose.end, quaternion=rolled(pose.end.quaternion, angle)))


def _untwisted(pose, first=None):
    """The end clamp rolled so that the twist along the measured curve, or the roll from a ``first`` end, changes sign."""
    if not _twisted(pose) or (first is None and pose.curve is None):
        return pose
    points, other = (pose.curve.points, pose.start) if first is None else (np.zeros((0, 3)), first)
    return _rolled_end(pose, -2.0 * twist_along(points, other.quaternion, pose.end.quaternion))
