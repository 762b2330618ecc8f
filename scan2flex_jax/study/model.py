"""A study in memory: one cable, measured in several poses.

Plain frozen dataclasses with read-only float64 arrays; `dataclasses.replace` makes changed copies. SI units (m, kg, N,
rad), quaternions `[w, x, y, z]` turn material vectors into the scan frame, `d3 = R e3` is the tangent of the centre
curve. Two studies are equal when they say the same, wherever their folders lie.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study.kinds import CABLE, ENDS

Value = float | Annotated[np.ndarray, "..."]


def _frozen(value: Any, name: str, *shapes: tuple[int | None, ...]) -> Annotated[np.ndarray, "..."]:
    """A read-only float64 copy whose shape is one of `shapes` (None: any number of rows)."""
    array = np.array(value, dtype=np.float64)
    fits = [len(s) == array.ndim and all(n in (None, m) for n, m in zip(s, array.shape, strict=True)) for s in shapes]
    if not any(fits):
        raise Scan2FlexError(f"{name} has shape {array.shape}: give {' or '.join(map(str, shapes))}.")
    array.flags.writeable = False
    return array


def _value(value: Any) -> Value:
    """A float, or a read-only array."""
    if np.ndim(value) == 0:
        return float(value)
    array = np.array(value, dtype=np.float64)
    array.flags.writeable = False
    return array


def _same(a: Any, b: Any) -> bool:
    """Equal in type, shape and every number; dataclasses field by field."""
    if is_dataclass(a):
        compared = [f.name for f in fields(a) if f.compare]
        return type(a) is type(b) and all(_same(getattr(a, name), getattr(b, name)) for name in compared)
    if isinstance(a, dict):
        return isinstance(b, dict) and a.keys() == b.keys() and all(_same(a[key], b[key]) for key in a)
    if isinstance(a, tuple):
        return isinstance(b, tuple) and len(a) == len(b) and all(map(_same, a, b))
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return np.shape(a) == np.shape(b) and type(a) is type(b) and bool(np.array_equal(a, b))
    return bool(a == b)


class _Compared:
    """Equality by content, for dataclasses that hold arrays."""

    __hash__ = None  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        return _same(self, other)


def _set(instance: Any, **values: Any) -> None:
    for name, value in values.items():
        object.__setattr__(instance, name, value)


@dataclass(frozen=True, eq=False)
class Clamp(_Compared):
    """Where one end is held: `position` (m) and unit `quaternion`, or None for a ball joint."""

    position: Annotated[np.ndarray, "3"]
    quaternion: Annotated[np.ndarray, "4"] | None = None

    def __post_init__(self) -> None:
        """Check shapes, and keep read-only copies."""
        quaternion = None if self.quaternion is None else _frozen(self.quaternion, "Clamp.quaternion", (4,))
        _set(self, position=_frozen(self.position, "Clamp.position", (3,)), quaternion=quaternion)

    @property
    def tangent(self) -> Annotated[np.ndarray, "3"] | None:
        """d3 = R e3, the direction of growing arc length; None for a ball joint."""
        if self.quaternion is None:
            return None
        w, x, y, z = self.quaternion
        return np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])


@dataclass(frozen=True, eq=False)
class MeasuredCurve(_Compared):
    """Points (m) of a measured centre curve from start to end, with their `arc_length` (m) where it was measured."""

    points: Annotated[np.ndarray, "n 3"]
    arc_length: Annotated[np.ndarray, " n"] | None = None
    path: Path | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        """Check shapes, and keep read-only copies."""
        points = _frozen(self.points, "MeasuredCurve.points", (None, 3))
        arc_length = self.arc_length
        if arc_length is not None:
            arc_length = _frozen(arc_length, "MeasuredCurve.arc_length", (len(points),))
        _set(self, points=points, arc_length=arc_length)


@dataclass(frozen=True, eq=False)
class Unknown(_Compared):
    """A quantity to estimate: a key of `[cable]` or "kind.parameter"; `guess`, `low` and `high` in its own unit."""

    name: str
    guess: Value | None = None
    low: Value | None = None
    high: Value | None = None

    def __post_init__(self) -> None:
        """Check shapes, and keep read-only copies."""
        for name in ("guess", "low", "high"):
            value = getattr(self, name)
            _set(self, **{name: None if value is None else _value(value)})


@dataclass(frozen=True, eq=False)
class EffectDeclaration(_Compared):
    """Physics beyond the plain rod that the user knows of; a parameter to be estimated may be left out."""

    kind: str
    parameters: dict[str, Value] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check shapes, and keep read-only copies."""
        _set(self, parameters={name: _value(value) for name, value in self.parameters.items()})


@dataclass(frozen=True)
class Tolerance:
    """Standard deviations of what is known only nearly; 0 = exact.

    `length` (m), `clamp_position` (m, each coordinate), `clamp_rotation` (rad, each axis), `gravity` (rad, tilt).
    """

    length: float = 0.0
    clamp_position: float = 0.0
    clamp_rotation: float = 0.0
    gravity: float = 0.0


@dataclass(frozen=True, eq=False)
class StudyPose(_Compared):
    """One pose: how the cable was held, and what was measured of it.

    `end` None = a free end; `turns` = full turns beyond what the quaternions tell; `scan` = file of a point cloud;
    `guide_points` and `viewpoints` in m; `noise` = standard deviation of one coordinate (m), None = unknown.
    """

    name: str
    role: str
    start: Clamp
    end: Clamp | None = None
    turns: int = 0
    curve: MeasuredCurve | None = None
    scan: Path | None = None
    guide_points: Annotated[np.ndarray, "k 3"] | None = None
    viewpoints: Annotated[np.ndarray, "v 3"] | None = None
    noise: float | None = None
    repeat_of: str | None = None
    guide_points_path: Path | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        """Check shapes, and keep read-only copies."""
        for name in ("guide_points", "viewpoints"):
            value = getattr(self, name)
            _set(self, **{name: None if value is None else _frozen(value, f"StudyPose.{name}", (None, 3))})


@dataclass(frozen=True, eq=False)
class Study(_Compared):
    """One cable in several poses. `cable` has only the keys that were given, in the units of `kinds.CABLE`."""

    title: str
    gravity: Annotated[np.ndarray, "3"]
    cable: dict[str, Value]
    poses: tuple[StudyPose, ...]
    tolerance: Tolerance = Tolerance()
    unknowns: tuple[Unknown, ...] = ()
    effects: tuple[EffectDeclaration, ...] = ()
    folder: Path | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        """Check shapes, and keep read-only copies."""
        cable = {key: _value(self.cable[key]) for key in (*CABLE, *self.cable) if key in self.cable}
        lists: dict[str, Sequence[Any]] = {name: getattr(self, name) for name in ("poses", "unknowns", "effects")}
        _set(self, gravity=_frozen(self.gravity, "Study.gravity", (3,)), cable=cable)
        _set(self, **{name: tuple(items) for name, items in lists.items()})

    def __eq__(self, other: object) -> bool:
        """Equal but for the folder: a scan counts by its path inside the folder."""
        return isinstance(other, Study) and _same(_portable(self), _portable(other))

    __hash__ = None

    @property
    def fit_poses(self) -> tuple[StudyPose, ...]:
        """The poses that a fit may use, in the order in which they were measured."""
        return tuple(pose for pose in self.poses if pose.role == "fit")

    @property
    def validate_poses(self) -> tuple[StudyPose, ...]:
        """The poses that neither a fit nor the choice of an effect may use."""
        return tuple(pose for pose in self.poses if pose.role == "validate")

    @property
    def unknown_names(self) -> tuple[str, ...]:
        """The names of what is to be estimated."""
        return tuple(unknown.name for unknown in self.unknowns)

    @property
    def clamped_ends(self) -> tuple[str, ...]:
        """Which of "start", "end" have a clamp (no ball joint, no free end) in at least one pose."""
        held = {end: [getattr(pose, end) for pose in self.poses] for end in ENDS}
        return tuple(end for end in ENDS if any(c is not None and c.quaternion is not None for c in held[end]))

    def pose(self, name: str) -> StudyPose:
        """The pose of this name."""
        for pose in self.poses:
            if pose.name == name:
                return pose
        raise Scan2FlexError(f"No pose is called {name!r}: the poses are {', '.join(p.name for p in self.poses)}.")

    def known(self, key: str) -> Value | None:
        """The value of a key of `[cable]` that is not to be estimated; None when it is, or was not given."""
        return None if key in self.unknown_names else self.cable.get(key)

    def start_value(self, name: str) -> Value | None:
        """Where the estimate of an unknown starts: its guess, else the value given, else None."""
        guess = next((unknown.guess for unknown in self.unknowns if unknown.name == name), None)
        return self.given(name) if guess is None else guess

    def given(self, name: str) -> Value | None:
        """The value given for a key of `[cable]` or for "kind.parameter", whether or not it is estimated."""
        kind, dot, parameter = name.partition(".")
        if not dot:
            return self.cable.get(name)
        return next((effect.parameters.get(parameter) for effect in self.effects if effect.kind == kind), None)


def _portable(study: Study) -> tuple[Any, ...]:
    """What a study says, with scans by their path inside the folder."""
    poses = tuple(replace(pose, scan=scan_name(study, pose)) for pose in study.poses)
    return (study.title, study.gravity, study.cable, poses, study.tolerance, study.unknowns, study.effects)


def scan_name(study: Study, pose: StudyPose) -> Path | None:
    """The path of a pose's scan inside the folder of its study, or the plain file name of one from elsewhere."""
    return None if pose.scan is None else relative_name(study.folder, pose.scan)


def relative_name(folder: Path | None, path: Path) -> Path:
    """`path` relative to `folder` where it lies inside, else its plain file name."""
    path = Path(path)
    if folder is not None and path.is_absolute() and path.is_relative_to(folder):
        return path.relative_to(folder)
    return Path(path.name)
