"""The parts of a study: clamps, measured curves, poses, unknowns, declared effects and tolerances.

Frozen dataclasses with read-only float64 arrays. Each takes lists, and arrays of NumPy, JAX or pandas, and raises `StudyError`
for invalid values; `dataclasses.replace` makes a changed copy, which is checked again.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike

from scan2flex_jax.study import arrays
from scan2flex_jax.study import values as v
from scan2flex_jax.study.kinds import TOLERANCE, kind_format, kind_names
from scan2flex_jax.study.records import (
    Compared,
    ReadOnly,
    all_of_kind,
    converting,
    keep,
    of_kind,
    read_only,
    read_only_value,
    table_of,
)
from scan2flex_jax.study.rotations import checked_rotation, quaternion_of, rigid_motion
from scan2flex_jax.study.values import Where

Value = float | Annotated[np.ndarray, "..."]

FEWEST_POINTS = 2
"""Fewer points have no direction, and no order from start to end."""
ROLES = ("fit", "validate")
MOST_TURNS = 1000
_CLAMP = "a Clamp, as in Clamp.of((position, quaternion))"


@converting
@dataclass(frozen=True, eq=False)
class Clamp(Compared):
    """Support of one end: `position` (m) and unit `quaternion`, or None for a ball joint."""

    position: Annotated[np.ndarray, "3"]
    quaternion: Annotated[np.ndarray, "4"] | None = None

    def __post_init__(self) -> None:
        """Check both, and keep read-only copies."""
        where, quaternion = Where("Clamp"), self.quaternion
        keep(self, position=read_only(v.vector(self.position, 3, where.at("position"))))
        if quaternion is not None:
            key = where.at("quaternion")
            keep(self, quaternion=read_only(v.unit(v.vector(quaternion, 4, key), key, "quaternion [w, x, y, z]")))

    @classmethod
    def of(cls, held: "Clamp | ArrayLike | tuple[ArrayLike, Any]") -> "Clamp":
        """The clamp of ``(position, rotation)``, or of a 4x4 matrix.

        Args:
            held: The position (3,) is in m. The rotation is a quaternion [w, x, y, z], a 3x3 matrix with the columns d1, d2,
                d3, a rotation of scipy, or None for a ball joint.

        Returns:
            The clamp, its quaternion normalised.

        Raises:
            StudyError: A position or rotation that is not one.

        Examples:
            >>> along_x = [[0, 0, 1], [0, -1, 0], [1, 0, 0]]
            >>> round(float(Clamp.of(([0.6, 0, 0], along_x)).tangent[0]), 6)
            1.0
        """
        if isinstance(held, Clamp):
            return held
        if not (isinstance(held, tuple | list) and len(held) == 2):
            return cls.from_matrix(held)
        position: Any = held[0]
        rotation: Any = held[1]
        if hasattr(rotation, "as_matrix"):
            rotation = rotation.as_matrix()
        rows = v.plain(rotation)
        if isinstance(rows, list) and rows and isinstance(rows[0], list):
            return cls(position, quaternion_of(checked_rotation(rotation, Where("Clamp").at("rotation"))))
        return cls(position, rotation)

    @classmethod
    def from_matrix(cls, matrix: ArrayLike) -> "Clamp":
        """The clamp of a homogeneous 4x4 (or 3x4) matrix: columns d1, d2, d3 and the position (m); raises `StudyError`."""
        position, R = rigid_motion(matrix, Where("Clamp"))
        return cls(position, quaternion_of(R))

    @property
    def tangent(self) -> Annotated[np.ndarray, "3"] | None:
        """d3 = R e3, the direction of growing arc length; None for a ball joint."""
        return None if self.quaternion is None else third_column(self.quaternion)


def third_column(quaternion: Annotated[np.ndarray, "4"]) -> Annotated[np.ndarray, "3"]:
    """d3 = R e3 of a unit quaternion [w, x, y, z]."""
    w, x, y, z = quaternion
    return np.array([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)])


@converting
@dataclass(frozen=True, eq=False)
class MeasuredCurve(Compared):
    """Points (m) of a measured centre curve from start to end, with their `arc_length` (m) if measured.

    Examples:
        >>> MeasuredCurve([[0.0, 0.0, 0.0], [0.1, 0.0, -0.01]]).points.shape
        (2, 3)
    """

    points: Annotated[np.ndarray, "n 3"]
    arc_length: Annotated[np.ndarray, " n"] | None = None
    path: Path | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        """Check that points are finite and distinct and the arc length grows, and keep read-only copies."""
        where, s = Where("MeasuredCurve"), self.arc_length
        keep(self, points=read_only(arrays.points(self.points, FEWEST_POINTS, where.at("points"))))
        if s is not None:
            keep(self, arc_length=read_only(arrays.arc_lengths(s, len(self.points), where.at("arc_length"))))


@converting
@dataclass(frozen=True, eq=False)
class Markers(Compared):
    """Points (m) tracked at known arc lengths (m), in order from the start: all three coordinates count, or those that were
    measured of every point, with NaN in the others.

    Examples:
        >>> Markers([[0.2, 0.0, -0.05]], arc_length=[0.22]).arc_length.tolist()
        [0.22]
    """

    points: Annotated[np.ndarray, "n 3"]
    arc_length: Annotated[np.ndarray, " n"]
    path: Path | None = field(default=None, compare=False)
    measured: str = field(default="xyz", init=False, compare=False)

    def __post_init__(self) -> None:
        """Check that points are finite and distinct and the arc length grows from 0 on, and keep read-only copies."""
        where = Where("Markers")
        table, seen = arrays.measured_columns(self.points, where.at("points"))
        keep(self, points=read_only(table), measured="".join(name for name, own in zip("xyz", seen, strict=True) if own))
        s, key = arrays.arc_lengths(self.arc_length, len(self.points), where.at("arc_length")), where.at("arc_length")
        if s[0] < 0:
            raise key.fail(f"got {s[0]:g} m: count s from 0 at the start clamp.")
        keep(self, arc_length=read_only(s))


@converting
@dataclass(frozen=True, eq=False)
class Unknown(Compared):
    """A quantity to estimate: a key of `[cable]` or "kind.parameter"; `guess`, `low` and `high` in its own unit.

    `prior`: another measurement of it, as {"mean": 0.1, "std": 0.01} in its own unit; None for none.

    Examples:
        >>> Unknown("bending_stiffness", guess=0.1, low=1e-3, high=1e2).guess
        0.1
    """

    name: str
    guess: Value | None = None
    low: Value | None = None
    high: Value | None = None
    prior: dict[str, Value] | None = None

    def __post_init__(self) -> None:
        """Check that these are numbers; the study determines their meaning."""
        name = v.text(self.name, Where("Unknown").at("name"))
        keep(self, name=name)
        for bound in ("guess", "low", "high"):
            value = getattr(self, bound)
            if value is not None:
                keep(self, **{bound: read_only_value(v.any_array(value, Where(f"Unknown {v.shown(name)}").at(bound)))})
        if self.prior is not None:
            keep(self, prior=_prior(self.prior, Where(f"Unknown {v.shown(name)}").at("prior")))


def _prior(given: Any, where: Where) -> ReadOnly:
    """Mean and standard deviation."""
    table = table_of(given, where, '{"mean": 0.1, "std": 0.01}')
    v.allow(table, ("mean", "std"), where)
    values = {k: v.any_array(v.required(table, k, where, "{ mean = 0.1, std = 0.01 }"), where.at(k)) for k in ("mean", "std")}
    return ReadOnly({name: read_only_value(value) for name, value in values.items()})


@converting
@dataclass(frozen=True, eq=False)
class EffectDeclaration(Compared):
    """Known physics beyond the baseline model; a parameter to be estimated may be omitted.

    `poses`: the names of the poses in which it acts, None = all of them.

    Examples:
        >>> EffectDeclaration("point_mass", {"position": 0.42, "mass": 0.05}, poses=["sag-with-weight"]).poses
        ('sag-with-weight',)
    """

    kind: str
    parameters: dict[str, Value] = field(default_factory=dict)
    poses: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        """Check the effect type and the names of its parameters; their values depend on the cable and its clamps."""
        key = Where("EffectDeclaration").at("kind")
        kind = v.text(self.kind, key)
        if kind not in kind_names():
            raise key.fail(f"unknown kind {v.shown(kind)}: {v.suggestion(kind, kind_names())}")
        where = Where(f"EffectDeclaration {v.shown(kind)}")
        given = table_of(self.parameters, where.at("parameters"), '{"position": 0.4}')
        v.allow(given, kind_format(kind).names, where)
        parameters = {name: read_only_value(v.any_array(value, where.at(name))) for name, value in given.items()}
        keep(self, kind=kind, parameters=ReadOnly(parameters))
        if self.poses is not None:
            keep(self, poses=_pose_names(self.poses, where.at("poses")))


def _pose_names(value: Any, where: Where) -> tuple[str, ...]:
    """Names of at least one pose, each once."""
    names = all_of_kind(value, str, where, '"sag"')
    if not names:
        raise where.fail("got no pose: name the poses in which the effect acts, or leave the key out for all of them.")
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise where.fail(f"it names {v.shown(twice)} twice: leave one out.")
    return names


@converting
@dataclass(frozen=True)
class Tolerance:
    """Standard deviations of inexact inputs; 0 = exact.

    `length` (m), `clamp_position` (m, each coordinate), `clamp_rotation` (rad, each axis), `gravity` (rad, tilt), `clamp_roll`
    (rad, about d3 of each clamp; None = `clamp_rotation`), `length_density` (kg/m).

    Examples:
        >>> Tolerance(length=0.002).given
        {'length': 0.002}
    """

    length: float = 0.0
    clamp_position: float = 0.0
    clamp_rotation: float = 0.0
    gravity: float = 0.0
    clamp_roll: float | None = None
    length_density: float = 0.0

    def __post_init__(self) -> None:
        """Check that none is negative."""
        for name, form in TOLERANCE.items():
            if name != "clamp_roll" or self.clamp_roll is not None:
                keep(self, **{name: v.quantity(getattr(self, name), form, Where("Tolerance").at(name))})

    @property
    def given(self) -> dict[str, float]:
        """The nonzero entries, and a stated roll, by name."""
        entries = {name: getattr(self, name) for name in TOLERANCE}
        return {name: value for name, value in entries.items() if value or (name == "clamp_roll" and value is not None)}


@converting
@dataclass(frozen=True, eq=False)
class StudyPose(Compared):
    """One pose: its supports and its measurements.

    `role` "fit" or "validate"; `end` None = a free end; `turns` = full turns in addition to the quaternions; `scan` = file
    of a point cloud; `markers` = points tracked at known arc lengths; `guide_points` and `viewpoints` in m; `noise` = standard
    deviation of one coordinate (m), None = unknown; `gravity` (m/s^2) in this pose, None = the study's; `time` (s) of the
    measurement, None = only the order is known; `reset` True = the cable was taken out and straightened before this pose.

    Examples:
        >>> held = Clamp([0, 0, 0], [0.7071068, 0, 0.7071068, 0])
        >>> StudyPose("sag", "fit", held, curve=MeasuredCurve([[0, 0, 0], [0.1, 0, -0.01]])).end is None
        True
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
    markers: Markers | None = None
    gravity: Annotated[np.ndarray, "3"] | None = None
    time: float | None = None
    reset: bool = False
    guide_points_path: Path | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        """Check each field on its own, and keep read-only copies."""
        keep(self, name=v.pose_name(self.name, Where("StudyPose").at("name")))
        where = Where(f"StudyPose {v.shown(self.name)}")
        if v.text(self.role, where.at("role")) not in ROLES:
            raise where.at("role").fail(f'got {v.shown(self.role)}: write "fit" or "validate".')
        self._check_ends(where)
        if self.repeat_of is not None:
            keep(self, repeat_of=v.text(self.repeat_of, where.at("repeat_of")))
        if self.noise is not None:
            noise = v.number(self.noise, where.at("noise"))
            v.check_domain(noise, "positive", where.at("noise"))
            keep(self, noise=noise)
        self._check_circumstances(where)
        self._check_shape(where)

    def _check_ends(self, where: Where) -> None:
        """Ends are clamps, and turns a whole number."""
        of_kind(self.start, Clamp, where.at("start"), _CLAMP)
        if self.end is not None:
            of_kind(self.end, Clamp, where.at("end"), _CLAMP)
        keep(self, turns=v.integer(self.turns, where.at("turns"), MOST_TURNS))

    def _check_circumstances(self, where: Where) -> None:
        """Check gravity, time and reset."""
        if self.gravity is not None:
            keep(self, gravity=read_only(v.vector(self.gravity, 3, where.at("gravity"))))
        if self.time is not None:
            keep(self, time=v.number(self.time, where.at("time")))
        keep(self, reset=v.boolean(self.reset, where.at("reset")))

    def _check_shape(self, where: Where) -> None:
        """Check the types of the measurements."""
        if self.curve is not None:
            of_kind(self.curve, MeasuredCurve, where.at("curve"), "a MeasuredCurve, as in MeasuredCurve(points)")
        if self.markers is not None:
            of_kind(self.markers, Markers, where.at("markers"), "Markers, as in Markers(points, arc_length)")
        if self.scan is not None:
            scan = of_kind(self.scan, (str, Path), where.at("scan"), "the path of a file with a point cloud")
            keep(self, scan=Path(scan))
        if self.guide_points is not None:
            keep(self, guide_points=read_only(arrays.points(self.guide_points, 2, where.at("guide_points"))))
        if self.viewpoints is not None:
            keep(self, viewpoints=read_only(v.rows(self.viewpoints, where.at("viewpoints"))))
