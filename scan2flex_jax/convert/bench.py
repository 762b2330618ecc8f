"""A study from the table of a bending test: a row a pose, with its load or its span, and its reading.

A `BendingTest` lists the columns of its table (`bench_table`) and writes the study: clamps, loads, a reading for each row, and
as the guess the closed form of small deflections, or Peirce's of a loop. Each shape is plane: gravity is along -z, the clamp
points along x, and nothing depends on torsion.

References: F. T. Peirce, "The 'handle' of cloth as a measurable quantity", J. Textile Inst. 21 (1930) T377 (loops, and the
overhang on an incline); ASTM D1388; S. Timoshenko, "Strength of Materials" (1940) (beams).
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq

from scan2flex_jax.convert.units import G
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study.model import Angle, Clamp, EffectDeclaration, Markers, Study, StudyPose, Tolerance, Unknown
from scan2flex_jax.study.values import suggestion

INCLINE = np.radians(41.5).item()  # rad, of ASTM D1388
_LEVEL = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])  # d3 along x, d1 along -z, d2 along y
_FLAT = 1000.0  # bending stiffness of a strip in its plane, over that across it: it stays in the plane of the test
_SEEN = 0.1  # rad: a loop that leaves its plane by more is seen to
_OVERHANG = 1.05  # length of the half beam over that to its support: what stands beyond carries nothing
_SMALL, _STEEP = 1e-4, 1.5  # deflections over half the span: of small slopes, and of beams that slip through
_LEAST = 1e-3  # of the length: least reading for a closed form

Row = dict[str, float]


@dataclass(frozen=True)
class BendingTest:
    """A bending test: ``columns`` and the optional ones, each with its quantity; ``needs``: "length", "density" and "span" as
    far as the study needs them; ``make`` writes the study, ``closed`` the stiffness (N m^2) of a row by a closed form."""

    columns: dict[str, str]
    optional: dict[str, str]
    needs: tuple[str, ...]
    make: Callable[["Bench"], Study]
    closed: Callable[["Bench", Row], float]


@dataclass(frozen=True)
class Bench:
    """What a test was given: its name, the rows (SI units) with their names, the ``length`` (m), the ``density`` (kg/m) and the
    ``span`` (m) as far as they are known, with the tolerance of both; ``noise`` (m) and the ``validate`` rows."""

    test: str
    rows: Sequence[Row]
    names: Sequence[str]
    length: float = 0.0
    density: float = 0.0
    span: float = 0.0
    tolerance: Tolerance = Tolerance()  # noqa: RUF009 - frozen
    noise: float | None = None
    validate: Sequence[str] = ()
    title: str = ""

    @property
    def guess(self) -> float | None:
        """The median over the rows of the closed form (N m^2); None where it says nothing."""
        found = [TESTS[self.test].closed(self, row) for row in self.rows]
        good = [EI for EI in found if np.isfinite(EI) and EI > 0]
        return float(np.median(good)) if good else None

    def pose(self, k: int, start: Clamp, end: Clamp | None = None, **given: Any) -> StudyPose:
        """The pose of row ``k``."""
        role = "validate" if self.names[k] in self.validate else "fit"
        return StudyPose(self.names[k], role, start, end, noise=self.noise, **given)

    def study(self, poses: Iterable[StudyPose], effects: Iterable[EffectDeclaration] = (), **given: Any) -> Study:
        """The study of the poses; the torsional stiffness has no influence on plane shapes."""
        EI = self.guess
        cable = {"length": self.length, "length_density": self.density, "torsional_stiffness": 0.8 * (EI or 1.0)}
        given = {"gravity": [0.0, 0.0, -G], "tolerance": self.tolerance, "title": self.title or self.test, **given}
        unknown = Unknown("bending_stiffness", guess=EI)
        return Study.from_arrays(cable | given.pop("cable", {}), tuple(poses), [unknown], effects=tuple(effects), **given)


def bench_study(bench: Bench) -> Study:
    """The study of a bending test, ready for `save_study`.

    Raises:
        Scan2FlexError: An unknown test, a name of no row, or a value that the test needs and has not.
    """
    if bench.test not in TESTS:
        raise Scan2FlexError(f"no test is called {bench.test[:40]!r}: {suggestion(bench.test, TESTS)}")
    for name in bench.validate:
        if name not in bench.names:
            raise Scan2FlexError(f"no pose is called {name[:60]!r}: {suggestion(name, bench.names)}")
    if set(bench.names) <= set(bench.validate):
        raise Scan2FlexError("every row is kept for validation: leave at least one to fit.")
    for name in TESTS[bench.test].needs:
        if not getattr(bench, name) > 0:
            raise Scan2FlexError(f"the {name} is not known, and the test {bench.test} needs it: give --{name}.")
    return TESTS[bench.test].make(bench)


def _tip(z: float, s: float) -> Markers:
    return Markers(np.array([[np.nan, np.nan, z]]), np.array([s]))


def _cantilever(b: Bench) -> Study:
    """A level cantilever with weights at its tip: the droop below the clamp, or the deflection from the unloaded shape."""
    clamp, poses, effects = Clamp.of(([0, 0, 0], _LEVEL)), list[StudyPose](), list[EffectDeclaration]()
    changes = any("deflection" in row for row in b.rows)
    poses += [StudyPose("unloaded", "fit", clamp)] if changes else []
    for k, row in enumerate(b.rows):
        if changes:
            given: dict[str, Any] = {"markers": _tip(-row["deflection"], b.length), "change_from": "unloaded"}
        else:
            given = {"markers": _tip(-row["droop"], b.length)}
        poses.append(b.pose(k, clamp, **given))
        if row.get("weight"):
            load: dict[str, Any] = {"position": b.length, "mass": row["weight"]}
            effects.append(EffectDeclaration("point_mass", load, (b.names[k],)))
    return b.study(poses, effects)


def _cantilever_closed(b: Bench, row: Row) -> float:
    """``(m g L^3 / 3 + w L^4 / 8) / droop``, the second term without the weight of the cable where changes were read."""
    own = 0.0 if "deflection" in row else b.density * G * b.length**4 / 8
    read = row.get("deflection", row.get("droop", 0.0))
    return (row.get("weight", 0.0) * G * b.length**3 / 3 + own) / read if read > _LEAST * b.length else np.nan


def _overhang(b: Bench) -> Study:
    """A strip over an edge until its tip meets an incline; the scan frame has x down the incline, and the tip is at z = 0."""
    angles = {row.get("angle", INCLINE) for row in b.rows}
    if len(angles) > 1:
        raise Scan2FlexError("the rows have several angles: make one study of each, or give the angle that all have.")
    (theta,), lengths = angles, np.array([row["overhang"] for row in b.rows])
    length, down = float(np.mean(lengths)), np.array([np.sin(theta), 0.0, -np.cos(theta)])
    half = 0.5 * (0.5 * np.pi - theta)  # the level tangent in the tilted frame
    level = np.array([np.cos(half), 0.0, np.sin(half), 0.0])
    error = max(float(np.std(lengths, ddof=1) / np.sqrt(len(lengths))) if len(lengths) > 1 else 0.0, 1e-3 * length)
    whole = Bench(b.test, b.rows, ("overhang",), length, b.density, 0.0, b.tolerance, b.noise or 1e-3 * length, (), b.title)
    pose = whole.pose(0, Clamp.of(([0, 0, 0], level)), markers=_tip(0.0, length))
    nearly = Tolerance(**{**b.tolerance.given, "length": error})
    return whole.study([pose], [], gravity=G * down, tolerance=nearly)


def _overhang_closed(b: Bench, row: Row) -> float:
    """``w c^3`` with the bending length ``c = l (cos(a / 2) / (8 tan(a)))^(1/3)`` (Peirce 1930)."""
    a = row.get("angle", INCLINE)
    return b.density * G * row["overhang"] ** 3 * np.cos(0.5 * a) / (8 * np.tan(a))


def _strip() -> EffectDeclaration:
    return EffectDeclaration("anisotropic_bending", {"ratio": _FLAT, "angle": 0.5 * np.pi})


def _in_plane(b: Bench) -> list[Angle]:
    """That the loop hangs in its plane, as is seen: a shape out of it may have the same depth at another stiffness."""
    return [Angle(0.25 * b.length, 0.0, _SEEN, axis, np.eye(3)[1], "d2") for axis in np.eye(3)[[0, 2]]]


def _heart(b: Bench) -> Study:
    """A strip with both ends in one clamp, the loop below it: it leaves upwards and comes back downwards."""
    up, down = Clamp.of(([0, 0, 0], [1, 0, 0, 0])), Clamp.of(([0, 0, 0], [0, 0, -1, 0]))
    middle, plane = [_tip(-row["height"], 0.5 * b.length) for row in b.rows], _in_plane(b)
    return b.study([b.pose(k, up, down, markers=mark, angle=plane) for k, mark in enumerate(middle)], [_strip()])


def _heart_closed(b: Bench, row: Row) -> float:
    """``w c^3``, ``c = l0 (cos(t) / tan(t))^(1/3)``, ``t = 32.85 deg (h - l0) / l0``, ``l0 = 0.1337 L`` (Peirce 1930)."""
    start = 0.1337 * b.length
    t = np.radians(32.85) * (row["height"] - start) / start
    return b.density * G * start**3 * np.cos(t) / np.tan(t) if 0 < t < 0.5 * np.pi else np.nan


def _ring(b: Bench) -> Study:
    """A strip closed to a ring, held at its top."""
    clamp = Clamp.of(([0, 0, 0], _LEVEL))
    middle, plane = [_tip(-row["depth"], 0.5 * b.length) for row in b.rows], _in_plane(b)
    return b.study([b.pose(k, clamp, clamp, markers=mark, angle=plane) for k, mark in enumerate(middle)], [_strip()])


def _ring_closed(b: Bench, row: Row) -> float:
    """``w c^3``, ``c = 0.133 L (cos(t) / tan(t))^(1/3)``, ``t = 157 deg (h - l0) / l0``, ``l0 = 0.3183 L`` (Peirce 1930)."""
    start = b.length / np.pi
    t = np.radians(157.0) * (row["depth"] - start) / start
    return b.density * G * (0.133 * b.length) ** 3 * np.cos(t) / np.tan(t) if 0 < t < 0.5 * np.pi else np.nan


def _hanging(b: Bench) -> Study:
    """A cable between two level clamps: its sag in the middle."""
    poses = []
    for k, row in enumerate(b.rows):
        end = Clamp.of(([row["span"], 0, 0], _LEVEL))
        poses.append(b.pose(k, Clamp.of(([0, 0, 0], _LEVEL)), end, markers=_tip(-row["sag"], 0.5 * b.length)))
    return b.study(poses)


def _three_point(b: Bench) -> Study:
    """Half of a beam on two supports, from its middle: the support pushes across the beam, at the arc length of `contact`.

    Deflections are changes, so that the weight of the beam has no influence of first order: the study has no gravity.
    """
    a, clamp, poses, effects = 0.5 * b.span, Clamp.of(([0, 0, 0], _LEVEL)), list[StudyPose](), list[EffectDeclaration]()
    places, slopes = np.transpose([contact(row["deflection"] / a) for row in b.rows])
    for k, (row, s) in enumerate(zip(b.rows, a * places, strict=True)):
        push = 0.5 * _force(row) * np.array([-np.tan(slopes[k]), 0.0, 1.0])
        poses.append(b.pose(k, clamp, markers=_tip(row["deflection"], s)))
        effects += [EffectDeclaration("point_load", {"position": s, "force": push}, (b.names[k],))] if np.any(push) else []
    cable = {"length": _OVERHANG * a * max(places), "length_density": 1.0}
    return b.study(poses, effects, gravity=[0.0, 0.0, 0.0], cable=cable)


def contact(deflection: float) -> tuple[float, float]:
    """Arc length from the middle of a beam to its support, over half the span, and the slope (rad) there, for a deflection over
    half the span.

    The support pushes across the beam with ``N``. For the angle ``p`` to the tangent there, ``EI/2 p'^2 = N sin(p)``: ``ds`` is
    in proportion to ``dp / sqrt(sin p)``, from ``p = t`` in the middle, and the slope ``t`` at the support gives the shape.
    """
    nodes, weights = np.polynomial.legendre.leggauss(40)
    u = 0.5 * (nodes + 1)  # p = t u^2 has no singularity at the support

    def shape(t: float) -> Any:
        p = t * u**2
        ds = weights * t * u / np.sqrt(np.sin(p))
        return [np.sum(f * ds) for f in (1.0, np.cos(t - p), np.sin(t - p))]

    def off(t: float) -> float:
        _, x, z = shape(t)
        return float(z / x - deflection)

    if not 0 <= deflection < _STEEP:
        raise Scan2FlexError(f"a deflection of {0.5 * deflection:.3g} times the span is no bending test between supports.")
    if deflection < _SMALL:
        return 1.0 + 0.6 * deflection**2, 1.5 * deflection
    t = float(brentq(off, 0.5 * deflection, 1.5))
    s, x, _ = shape(t)
    return float(s / x), t


def _force(row: Row) -> float:
    """The force (N) on the middle of a beam."""
    return row["force"] if "force" in row else row["weight"] * G


def _three_point_closed(b: Bench, row: Row) -> float:
    """``F span^3 / (48 d)``."""
    return _force(row) * b.span**3 / (48 * row["deflection"]) if row["deflection"] > 0 else np.nan


TESTS = {
    "droop": BendingTest(
        {"droop": "length"}, {"deflection": "length", "weight": "mass"}, ("length", "density"), _cantilever, _cantilever_closed
    ),
    "peirce": BendingTest({"overhang": "length"}, {"angle": "angle"}, ("density",), _overhang, _overhang_closed),
    "three-point": BendingTest(
        {"force": "force", "deflection": "length"}, {"weight": "mass"}, ("span",), _three_point, _three_point_closed
    ),
    "heart": BendingTest({"height": "length"}, {}, ("length", "density"), _heart, _heart_closed),
    "ring": BendingTest({"depth": "length"}, {}, ("length", "density"), _ring, _ring_closed),
    "hanging": BendingTest({"span": "length", "sag": "length"}, {}, ("length", "density"), _hanging, lambda b, row: np.nan),
}
"""The tests by their name for ``scan2flex new --test``."""
