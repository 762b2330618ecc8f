"""The parts of a study: clamps, measured curves and readings, poses, unknowns, declared effects and tolerances.

Frozen dataclasses with read-only float64 arrays. Each takes lists, and arrays of NumPy, JAX or pandas, and raises `StudyError`
for invalid values; `dataclasses.replace` makes a changed copy, which is checked again.
"""

from dataclasses import field
from pathlib import Path
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from scan2flex_jax.study import values as v
from scan2flex_jax.study.kinds import AXES, KEYS, TOLERANCE, kind_format, kind_names
from scan2flex_jax.study.records import Record, keep, record
from scan2flex_jax.study.rotations import checked_rotation, columns, quaternion_of, rigid_motion
from scan2flex_jax.study.values import Where

Value = float | Annotated[np.ndarray, "..."]

_ACROSS = 1e-6  # of a direction: less of it is across another one by rounding only
FEWEST_POINTS = 2  # fewer points have no direction, and no order from start to end


@record
class Clamp(Record):
    """Support of one end: `position` (m) and unit `quaternion`, or None for a ball joint.

    A clamp with directions `free` (k, 3) is a guided end, which may move along them from its position; one with a `hinge` (3,)
    turns freely about that axis. Both in the scan frame."""

    position: Annotated[np.ndarray, "3"]
    quaternion: Annotated[np.ndarray, "4"] | None = None
    free: Annotated[np.ndarray, "k 3"] | None = None
    hinge: Annotated[np.ndarray, "3"] | None = None

    KEYS: ClassVar = KEYS["clamp"]
    AS = "a Clamp, as in Clamp.of((position, quaternion))"

    def _check(self, where: Where) -> None:
        for name in ("free", "hinge"):
            if getattr(self, name) is not None and self.quaternion is None:
                raise where.at(name).fail("the end turns freely: give its quaternion, or hold a place by the effect support.")
        if self.free is not None and self.hinge is not None:
            raise where.at("hinge").fail("the end has free directions too: leave one of them out, or use the effect support.")
        if self.free is not None and np.any(np.linalg.norm(self.free, axis=1) == 0.0):
            raise where.at("free").fail("a direction is zero: give the vectors along which the clamp may move.")

    @property
    def across(self) -> Annotated[np.ndarray, "3 3"]:
        """Projection on the directions in which a guided end is held; zero for other ends."""
        if self.free is None:
            return np.zeros((3, 3))
        _, sizes, axes = np.linalg.svd(self.free / np.linalg.norm(self.free, axis=1, keepdims=True))
        free = axes[: np.sum(sizes > _ACROSS)]
        return np.eye(3) - free.T @ free

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
        pair: Any = held
        position, rotation = pair
        rotation = rotation.as_matrix() if hasattr(rotation, "as_matrix") else rotation
        rows = v.plain(rotation)
        if isinstance(rows, list) and rows and isinstance(rows[0], list):
            rotation = quaternion_of(checked_rotation(rotation, Where("Clamp").at("rotation")))
        return cls(position, rotation)

    @classmethod
    def from_matrix(cls, matrix: ArrayLike) -> "Clamp":
        """The clamp of a homogeneous 4x4 (or 3x4) matrix: columns d1, d2, d3 and the position (m); raises `StudyError`."""
        position, R = rigid_motion(matrix, Where("Clamp"))
        return cls(position, quaternion_of(R))

    @property
    def tangent(self) -> Annotated[np.ndarray, "3"] | None:
        """d3 = R e3, the direction of growing arc length; None for a ball joint."""
        return None if self.quaternion is None else columns(self.quaternion)[:, 2]


@record
class MeasuredCurve(Record):
    """Points (m) of a measured centre curve from start to end, with their `arc_length` (m) if measured.

    Examples:
        >>> MeasuredCurve([[0.0, 0.0, 0.0], [0.1, 0.0, -0.01]]).points.shape
        (2, 3)
    """

    points: Annotated[np.ndarray, "n 3"]
    arc_length: Annotated[np.ndarray, " n"] | None = None
    path: Path | None = field(default=None, compare=False)

    AS = "a MeasuredCurve, as in MeasuredCurve(points)"

    def _check(self, where: Where) -> None:
        keep(self, points=v.points(self.points, FEWEST_POINTS, where.at("points")))
        if self.arc_length is not None:
            keep(self, arc_length=v.growing(self.arc_length, len(self.points), where.at("arc_length")))


@record
class Markers(Record):
    """Points (m) tracked at known arc lengths (m), in order from the start: all three coordinates count, or those that were
    measured of every point, with NaN in the others.

    `offset` (m): places of the points beside the axis, along d1 and d2 of the section; None = on the axis.

    Examples:
        >>> Markers([[0.2, 0.0, -0.05]], arc_length=[0.22]).arc_length.tolist()
        [0.22]
    """

    points: Annotated[np.ndarray, "n 3"]
    arc_length: Annotated[np.ndarray, " n"]
    path: Path | None = field(default=None, compare=False)
    offset: Annotated[np.ndarray, "n 2"] | None = None
    measured: str = field(default="xyz", init=False, compare=False)

    AS = "Markers, as in Markers(points, arc_length)"

    def _check(self, where: Where) -> None:
        keep(self, points=v.points(self.points, 1, where.at("points"), partial=True))
        keep(self, measured="".join(c for c, x in zip("xyz", self.points[0], strict=True) if not np.isnan(x)))
        key = where.at("arc_length")
        if self.offset is None:
            keep(self, arc_length=v.growing(self.arc_length, len(self.points), key))
        else:  # several marks may stand on one section
            keep(self, arc_length=v.array(self.arc_length, ((len(self.points),),), key))
            keep(self, offset=v.array(self.offset, ((len(self.points), 2),), where.at("offset")))
            if np.any(np.diff(self.arc_length) < 0):
                raise key.fail("it does not grow: order the points from start to end.")
        if self.arc_length[0] < 0:
            raise key.fail(f"got {self.arc_length[0]:g} m: count s from 0 at the start clamp.")

    @property
    def aside(self) -> Annotated[np.ndarray, "n 3"]:
        """Their places from the axis, along d1, d2, d3 (m)."""
        return np.zeros((len(self.points), 3)) if self.offset is None else np.c_[self.offset, np.zeros(len(self.points))]


@record
class Angle(Record):
    """An angle (rad) read at the arc length `s` (m), right-handed about the axis `about`, from the direction `zero` to `of`.

    `of`: the tangent "d3", or "d1" or "d2" of the section, as seen along `about`; `noise` (rad) is its standard deviation.
    `about` and `zero` are directions in the scan frame, of any length; a pose with `change_from` needs no `zero`.

    Examples:
        >>> slope = Angle(s=0.3, value=0.52, noise=0.01, about=[0, 1, 0], zero=[1, 0, 0])
        >>> slope.of
        'd3'
    """

    s: float
    value: float
    noise: float
    about: Annotated[np.ndarray, "3"]
    zero: Annotated[np.ndarray, "3"] | None = None
    of: str = "d3"

    KEYS: ClassVar = KEYS["angle"]
    AS = "an Angle, as in Angle(s, value, noise, about, zero)"

    def _check(self, where: Where) -> None:
        if not np.any(self.about):
            raise where.at("about").fail("it has no length: give the axis of the angle.")
        if self.zero is not None and np.linalg.norm(self.axes[1]) < _ACROSS:
            raise where.at("zero").fail("it is along `about`: give a direction across it.")

    @property
    def axes(self) -> Annotated[np.ndarray, "3 3"]:
        """The unit axis, the direction of zero across it (any without one), and the material axis that is read, as rows."""
        about = self.about / np.linalg.norm(self.about)
        zero = np.eye(3)[np.argmin(np.abs(about))] if self.zero is None else self.zero / max(np.linalg.norm(self.zero), 1e-300)
        return np.stack([about, zero - (zero @ about) * about, np.eye(3)[AXES.index(self.of)]])


@record
class Wrench(Record):
    """Force (N) and moment (N m) of the support of one `end` ("start" or "end") on the cable, with their standard deviations.

    NaN for components that were not measured; None: no force, or no moment, was. `frame`: "scan", or "clamp" (d1, d2, d3).

    Examples:
        >>> Wrench("start", force=[np.nan, np.nan, 3.3], force_noise=0.05).frame
        'scan'
    """

    end: str
    force: Annotated[np.ndarray, "3"] | None = None
    force_noise: float | None = None
    moment: Annotated[np.ndarray, "3"] | None = None
    moment_noise: float | None = None
    frame: str = "scan"

    KEYS: ClassVar = KEYS["wrench"]
    AS = 'a Wrench, as in Wrench("start", force=[0, 0, 3.3], force_noise=0.05)'

    def _check(self, where: Where) -> None:
        if self.force is None and self.moment is None:
            raise where.fail(f"it has neither force nor moment: write {KEYS['wrench']['force'].written}.")
        for name, value, noise in self.each:
            if noise is None and value is not None:
                raise where.at(f"{name}_noise").fail(f"it is missing: write {KEYS['wrench'][f'{name}_noise'].written}.")
            if value is None and noise is not None:
                raise where.at(name).fail(f"it is missing, and has a noise: write {KEYS['wrench'][name].written}.")

    @property
    def each(self) -> tuple[tuple[str, Annotated[np.ndarray, "3"] | None, float | None], ...]:
        """Name, components and noise of force and moment."""
        return ("force", self.force, self.force_noise), ("moment", self.moment, self.moment_noise)


@record
class Unknown(Record):
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

    KEYS: ClassVar = {"name": KEYS["effect"]["kind"], **dict.fromkeys(("guess", "low", "high"), KEYS["unknown"]["guess"])}
    AS = 'Unknown("bending_stiffness")'

    def _check(self, where: Where) -> None:
        """A prior has its two numbers; the study determines the meaning of all."""
        if self.prior is not None:
            here, said = where.at("prior"), KEYS["unknown"]["prior"].example
            given = v.table(self.prior, ("mean", "std"), here, '{"mean": 0.1, "std": 0.01}')
            keep(self, prior={k: v.array(v.required(given, k, here, said), None, here.at(k)) for k in ("mean", "std")})


@record
class EffectDeclaration(Record):
    """Known physics beyond the baseline model; a parameter to be estimated may be omitted.

    `poses`: the names of the poses in which it acts, None = all of them.

    Examples:
        >>> EffectDeclaration("point_mass", {"position": 0.42, "mass": 0.05}, poses=["sag-with-weight"]).poses
        ('sag-with-weight',)
    """

    kind: str
    parameters: dict[str, Value] = field(default_factory=dict)
    poses: tuple[str, ...] | None = None

    KEYS: ClassVar = {"kind": KEYS["effect"]["kind"]}
    AS = "EffectDeclaration(...)"

    def _check(self, where: Where) -> None:
        """The effect type and the names of its parameters exist; their values depend on the cable and its clamps."""
        if self.kind not in kind_names():
            said = f"unknown kind {v.shown(self.kind)}: {v.suggestion(self.kind, kind_names())}"
            raise Where("EffectDeclaration").at("kind").fail(said)
        given = v.table(self.parameters, None, where.at("parameters"), '{"position": 0.4}')
        v.table(given, kind_format(self.kind).names, where, "")
        keep(self, parameters={name: v.array(value, None, where.at(name)) for name, value in given.items()})
        if self.poses is None:
            return
        names = v.all_of_kind(self.poses, str, here := where.at("poses"), '"sag"')
        if not names:
            raise here.fail("got no pose: name the poses in which the effect acts, or leave the key out for all of them.")
        if twice := [name for name in names if names.count(name) > 1]:
            raise here.fail(f"it names {v.shown(twice[0])} twice: leave one out.")
        keep(self, poses=names)


@record
class Tolerance(Record):
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

    KEYS: ClassVar = TOLERANCE
    AS = "a Tolerance, as in Tolerance(length=0.002)"

    def __hash__(self) -> int:  # type: ignore[override]
        """Of its numbers."""
        return hash(tuple(vars(self).values()))

    @property
    def given(self) -> dict[str, float]:
        """The nonzero entries, and a stated roll, by name."""
        entries = {name: getattr(self, name) for name in TOLERANCE}
        return {name: value for name, value in entries.items() if value or (name == "clamp_roll" and value is not None)}


@record
class StudyPose(Record):
    """One pose: its supports and its measurements.

    `role` "fit" or "validate"; `end` None = a free end, `start` None = a free start (supports hold the cable); `turns` = full
    turns in addition to the quaternions; `scan` = file of a point cloud; `markers` = points tracked at known arc lengths;
    `guide_points` and `viewpoints` in m; `noise` = standard deviation of one coordinate (m), None = unknown; `gravity` (m/s^2)
    in this pose, None = the study's; `time` (s) of the measurement, None = only the order is known; `reset` True = the cable
    was taken out and straightened before this pose; `angle` and `wrench` = readings of angles and at clamps; `change_from` =
    name of the pose from whose equilibrium markers, angles and wrenches are changes.

    Examples:
        >>> held = Clamp([0, 0, 0], [0.7071068, 0, 0.7071068, 0])
        >>> StudyPose("sag", "fit", held, curve=MeasuredCurve([[0, 0, 0], [0.1, 0, -0.01]])).end is None
        True
    """

    name: str
    role: str
    start: Clamp | None = None
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
    angle: tuple[Angle, ...] = ()
    wrench: tuple[Wrench, ...] = ()
    change_from: str | None = None
    guide_points_path: Path | None = field(default=None, compare=False)

    KEYS: ClassVar = KEYS["pose"]
    PARTS: ClassVar = {
        "start": Clamp, "end": Clamp, "curve": MeasuredCurve, "markers": Markers, "angle": (Angle,), "wrench": (Wrench,)
    }  # fmt: skip
    AS = "StudyPose(...)"

    @property
    def files(self) -> dict[str, Path | None]:
        """The files that its measurements were read from, by key; None for one in memory."""
        paths = {"centre_curve": getattr(self.curve, "path", None), "scan": self.scan}
        return paths | {"markers": getattr(self.markers, "path", None), "guide_points": self.guide_points_path}

    @property
    def seen(self) -> bool:
        """Whether points of its shape were measured."""
        return self.curve is not None or self.scan is not None or self.markers is not None

    @property
    def measured(self) -> bool:
        """Whether anything was."""
        return self.seen or bool(self.angle) or bool(self.wrench)

    def _check(self, where: Where) -> None:
        for name in ("curve", "scan"):
            if self.change_from is not None and getattr(self, name) is not None:
                raise where.at(name).fail("a change is one of markers, angles and wrenches: leave it out, or change_from.")
        for i, one in enumerate(self.angle):
            if one.zero is None and self.change_from is None:
                raise where.at("angle").item(i + 1).at("zero").fail(f"it is missing: write {KEYS['angle']['zero'].written}.")
        if self.scan is not None:
            keep(self, scan=Path(v.of_kind(self.scan, (str, Path), where.at("scan"), "the path of a file with a point cloud")))
        if self.guide_points is not None:
            keep(self, guide_points=v.points(self.guide_points, 2, where.at("guide_points")))
