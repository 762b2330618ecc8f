"""A study in memory: one cable, measured in several poses.

SI units (m, kg, N, rad); quaternions `[w, x, y, z]` turn material vectors into the scan frame, `d3 = R e3` is the tangent of
the centre curve. Each part is checked on its own at construction (`parts`); `sense.check_study` checks the parts against each
other, and is called first by every user of a study. Two studies are equal if their contents are, independent of their folders.
"""

from collections.abc import Mapping, Sequence
from dataclasses import field, fields, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study import values as v
from scan2flex_jax.study.kinds import CABLE, ENDS, KEYS, kind_format, split_name
from scan2flex_jax.study.parts import (
    Angle,
    Clamp,
    EffectDeclaration,
    Markers,
    MeasuredCurve,
    StudyPose,
    Tolerance,
    Unknown,
    Value,
    Wrench,
)
from scan2flex_jax.study.records import Record, keep, record, same
from scan2flex_jax.study.values import Where

__all__ = [
    "Angle", "Clamp", "EffectDeclaration", "Markers", "MeasuredCurve", "Study", "StudyPose", "Tolerance", "Unknown", "Value",
    "Wrench",
]  # fmt: skip

GRAVITY = (0.0, 0.0, -9.81)
RIGID = {"axial_stiffness": "inextensible", "shear_stiffness": "unshearable"}  # if left out, the cable is
AT_END = 1e-6  # of the length: a place as near to it is the end of the cable, up to the digits written


@record
class Study(Record):
    """One cable in several poses. `cable` has only the given keys, in the units of `kinds.CABLE`.

    What is stated at the end of the cable (the last marker, the place of an effect) stays there: a copy with another length
    moves it. `stated_length` (m) is the length for which places were stated."""

    title: str
    gravity: Annotated[np.ndarray, "3"]
    cable: dict[str, Value]
    poses: tuple[StudyPose, ...]
    tolerance: Tolerance = field(default_factory=Tolerance)
    unknowns: tuple[Unknown, ...] = ()
    effects: tuple[EffectDeclaration, ...] = ()
    folder: Path | None = field(default=None, compare=False)
    stated_length: float | None = field(default=None, compare=False, repr=False)

    KEYS: ClassVar = {name: KEYS["study"][name] for name in ("title", "gravity")}
    PARTS: ClassVar = {
        "tolerance": Tolerance, "poses": (StudyPose,), "unknowns": (Unknown,), "effects": (EffectDeclaration,)
    }  # fmt: skip

    def _check(self, where: Where) -> None:
        table = v.table(self.cable, CABLE, here := where.at("cable"), '{"length": 0.9}')
        cable = {key: form.take(table[key], here.at(key)) for key, form in CABLE.items() if key in table}
        if (stretch := cable.get("natural_stretch", np.zeros(3))[2]) <= -1:
            raise here.at("natural_stretch").fail(f"got {stretch:g} along d3: give a stretch above -1.")
        keep(self, cable=cable)
        length = self.cable.get("length", self.start_value("length"))
        if length is None:
            return
        old, new = self.stated_length, float(np.max(length))
        keep(self, stated_length=new)
        if old is not None and old != new:
            keep(self, **_stretched(self, old, new))

    @classmethod
    def from_arrays(
        cls,
        cable: Mapping[str, Any],
        poses: Sequence[StudyPose | Mapping[str, Any]],
        unknowns: Sequence[str | Unknown] = (),
        *,
        title: str = "",
        gravity: ArrayLike = GRAVITY,
        tolerance: Tolerance | None = None,
        effects: Sequence[EffectDeclaration] = (),
    ) -> "Study":
        """A study from plain numbers and arrays.

        Args:
            cable: Known parameters, by the keys of `[cable]`, in SI units.
            poses: Each a `StudyPose` or a dict: ``points`` (n, 3) in m of its centre curve, and their ``arc_length`` (n,) if
                measured; ``start`` and ``end`` in the forms of `Clamp.of` (left out: free); any other field of
                `StudyPose`. Its ``name`` defaults to p1, p2, ... and its ``role`` to "fit".
            unknowns: Names, or `Unknown` with a guess or a range.
            title: Shown in every result.
            gravity: m/s^2, in the scan frame.
            tolerance: Standard deviations of inexact inputs; None: all exact.
            effects: Physics declared beyond the baseline model.

        Returns:
            The study; its parts are checked against each other at first use.

        Raises:
            StudyError: An invalid part: object, key, the value found and the remedy.

        Examples:
            >>> pose = {"points": [[0, 0, 0], [0.5, 0, -0.1]], "start": ([0, 0, 0], [0, 0, 1, 0])}
            >>> study = Study.from_arrays({"length": 1.0, "length_density": 0.2}, [pose], ["bending_stiffness"])
            >>> study.poses[0].name, study.unknown_names
            ('p1', ('bending_stiffness',))
        """
        where = Where("Study")
        entries = v.all_of_kind(poses, (StudyPose, Mapping), where.at("poses"), "{'points': points, 'start': start}")
        asked = v.all_of_kind(unknowns, (str, Unknown), where.at("unknowns"), '"bending_stiffness"')
        made = tuple(_pose(entry, f"p{i + 1}", where.at("pose")) for i, entry in enumerate(entries))
        given: dict[str, Any] = {"title": title, "gravity": gravity, "cable": cable, "poses": made, "effects": effects}
        given["unknowns"] = tuple(Unknown(entry) if isinstance(entry, str) else entry for entry in asked)
        return cls(**given) if tolerance is None else cls(**given, tolerance=tolerance)

    def __eq__(self, other: object) -> bool:
        """Equal up to the folder: a scan is compared by its path inside the folder."""
        return isinstance(other, Study) and same(_portable(self), _portable(other))

    __hash__ = None

    @property
    def assumed_rigid(self) -> tuple[str, ...]:
        """Axial and shear stiffness, if neither given nor unknown, nor an effect's in all poses."""
        said = {*self.cable, *self.unknown_names}
        said |= {parameter.name for effect in self.acting() for parameter in kind_format(effect.kind).parameters}
        return tuple(name for name in RIGID if name not in said)

    @property
    def assumptions(self) -> tuple[str, ...]:
        """Assumptions for omitted stiffnesses, in words."""
        names = self.assumed_rigid
        words = " and ".join(RIGID[name] for name in names)
        return (f"{' and '.join(names)} left out: the cable is assumed {words}",) if names else ()

    @property
    def fit_poses(self) -> tuple[StudyPose, ...]:
        """The poses available to a fit, in the order of measurement."""
        return tuple(pose for pose in self.poses if pose.role == "fit" and not self.only_compared(pose))

    @property
    def validate_poses(self) -> tuple[StudyPose, ...]:
        """The poses excluded from fits and from the choice of effects."""
        return tuple(pose for pose in self.poses if pose.role == "validate" and not self.only_compared(pose))

    def only_compared(self, pose: StudyPose) -> bool:
        """Whether nothing was measured in a pose, from which those of others are changes."""
        return not pose.measured and any(other.change_from == pose.name for other in self.poses)

    @property
    def unknown_names(self) -> tuple[str, ...]:
        """The names of the unknowns."""
        return tuple(unknown.name for unknown in self.unknowns)

    @property
    def clamped_ends(self) -> tuple[str, ...]:
        """Which of "start", "end" have a clamp (no ball joint, no free end) in at least one pose."""
        return tuple(end for end in ENDS if any(getattr(getattr(p, end), "quaternion", None) is not None for p in self.poses))

    def places_of(self, name: str) -> int:
        """Number of points of the field "kind.parameter"; 0 for other parameters."""
        kind = split_name(name)[0]
        grid = kind_format(kind).grid if kind else None
        places = None if grid is None else self.given(f"{kind}.{grid.name}")
        return 0 if places is None else int(np.size(places))

    def effects_of(self, name: str) -> tuple[int, ...]:
        """Places among ``effects`` of those that the unknown "kind.parameter" or "kind[number].parameter" belongs to.

        Without a number these are the effects of the kind that leave the parameter out and have no number under `[unknown]`;
        all of the kind, if none leaves it out. They share one value."""
        kind, number, parameter = split_name(name)
        own = [i for i, effect in enumerate(self.effects) if effect.kind == kind]
        if number is not None:
            return tuple(own[number - 1 : number]) if number else ()
        numbers = {n for k, n, p in map(split_name, self.unknown_names) if (k, p) == (kind, parameter)}
        own = [i for count, i in enumerate(own, 1) if count not in numbers]
        return tuple([i for i in own if parameter not in self.effects[i].parameters] or own)

    def unknown_of(self, place: int, parameter: str) -> str | None:
        """The name of the unknown that is the ``parameter`` of the effect at a place among ``effects``."""
        names = (name for name in self.unknown_names if split_name(name)[2] == parameter and "." in name)
        return next((name for name in names if place in self.effects_of(name)), None)

    def acting(self, pose: StudyPose | None = None) -> tuple[EffectDeclaration, ...]:
        """The effects that act in a pose; without one, those that act in every pose."""
        return tuple(e for e in self.effects if e.poses is None or (pose is not None and pose.name in e.poses))

    @property
    def history_dependent(self) -> bool:
        """Whether an effect makes poses depend on those before them."""
        return any(kind_format(effect.kind).memory != "none" for effect in self.effects)

    def gravity_in(self, pose: StudyPose | None = None) -> Annotated[np.ndarray, "3"]:
        """Gravity (m/s^2) in a pose: its own, or the study's."""
        return self.gravity if pose is None or pose.gravity is None else pose.gravity

    def pose(self, name: str) -> StudyPose:
        """The pose of this name."""
        poses = {pose.name: pose for pose in self.poses}
        if name not in poses:
            raise Scan2FlexError(f"No pose is called {name!r}: the poses are {', '.join(poses)}.")
        return poses[name]

    def known(self, key: str) -> Value | None:
        """The value of a key of `[cable]` that is not estimated; None if it is, or was not given."""
        return None if key in self.unknown_names else self.cable.get(key)

    @property
    def length(self) -> float | None:
        """The length (m) of the cable, if it was given and is not estimated."""
        length = self.known("length")
        return None if length is None else float(np.max(length))

    def start_value(self, name: str) -> Value | None:
        """Start of an unknown: its guess, else the value given, else the mean of its prior, else None."""
        unknown = next((unknown for unknown in self.unknowns if unknown.name == name), Unknown(name))
        values = unknown.guess, self.given(name), (unknown.prior or {}).get("mean")
        return next((value for value in values if value is not None), None)

    def given(self, name: str) -> Value | None:
        """The value given for a key of `[cable]` or for the name of an effect's parameter, whether or not it is estimated."""
        parameter = split_name(name)[2]
        if "." not in name:
            return self.cable.get(name)
        return next((self.effects[i].parameters.get(parameter) for i in self.effects_of(name)), None)


def at_end(place: Any, length: float | None) -> bool:
    """Whether a place (m) along the cable is its end."""
    return length is not None and np.size(place) == 1 and bool(abs(float(np.max(place)) - length) <= AT_END * length)


def _stretched(study: Study, old: float, new: float) -> dict[str, Any]:
    """Effects and poses whose places at the end of a cable of another length (m), if they have one there, stay at its end."""
    effects, poses = [], []
    for effect in study.effects:
        name = kind_format(effect.kind).position or ""
        at = at_end(effect.parameters.get(name, np.nan), old)
        effects.append(replace(effect, parameters={**effect.parameters, name: new}) if at else effect)
    for pose in study.poses:
        marks = pose.markers
        if marks is not None and at_end(marks.arc_length[-1], old):
            marks = replace(marks, arc_length=np.array([new if at_end(s, old) else s for s in marks.arc_length]))
        angles = tuple(replace(one, s=new) if at_end(one.s, old) else one for one in pose.angle)
        poses.append(replace(pose, markers=marks, angle=angles))
    return {"effects": tuple(effects), "poses": tuple(poses)}


def _pose(entry: StudyPose | Mapping[str, Any], name: str, where: Where) -> StudyPose:
    """A pose of arrays, called `name` by default."""
    if isinstance(entry, StudyPose):
        return entry
    given = {"name": name, "role": "fit", **entry}
    where = where.item(given["name"])
    v.table(given, ("points", "arc_length", *(f.name for f in fields(StudyPose))), where, "")
    for end in ENDS:
        if given.get(end) is not None:
            with where.at(end).placed():
                given[end] = Clamp.of(given[end])
    with where.placed():
        points, s = given.pop("points", None), given.pop("arc_length", None)
        given |= {} if points is None else {"curve": MeasuredCurve(points, s)}
        return StudyPose(**given)


def _portable(study: Study) -> tuple[Any, ...]:
    """Contents of a study, with scans by their path inside the folder."""
    poses = tuple(replace(pose, scan=scan_name(study, pose)) for pose in study.poses)
    return (study.title, study.gravity, study.cable, poses, study.tolerance, study.unknowns, study.effects)


def scan_name(study: Study, pose: StudyPose) -> Path | None:
    """The path of a pose's scan inside the folder of its study, or the plain file name of one from elsewhere."""
    return None if pose.scan is None else relative_name(study.folder, pose.scan)


def relative_name(folder: Path | None, path: Path) -> Path:
    """`path` relative to `folder` if it lies inside, else its plain file name."""
    path = Path(path)
    if folder is not None and path.is_absolute() and path.is_relative_to(folder):
        return path.relative_to(folder)
    return Path(path.name)
