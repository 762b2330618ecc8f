"""Conversion of robot, tracker and CAD frames to the format's position and quaternion.

A frame is a 4x4 (or 3x4) matrix, a position with three angles in a *named* convention, a position with a quaternion, or a pose
as a robot prints it (`_PRINTED`), whose units and angles are those of the robot.
Its axis along the cable, from start to end, becomes d3; the two others follow in cyclic order (y, z, x for
a cable along x). Rotations are scipy's.
"""

import re
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from scan2flex_jax.convert.polylines import holds_messages
from scan2flex_jax.convert.units import length_unit
from scan2flex_jax.errors import Scan2FlexError, StudyError
from scan2flex_jax.study.files import TOML_LIMIT, read_text
from scan2flex_jax.study.limits import curve_limit
from scan2flex_jax.study.model import Clamp
from scan2flex_jax.study.rotations import quaternion_of, rigid_motion
from scan2flex_jax.study.tables import LENGTHS
from scan2flex_jax.study.values import LARGEST, Where, one_line

# upper case: about the rotated axes (intrinsic); lower case: about the fixed axes (extrinsic), as in scipy
CONVENTIONS = {
    "kuka": ("ZYX", "A, B, C about z, then the new y, then the new x"),
    "fanuc": ("xyz", "W, P, R about the fixed x, y, z"),
    "staubli": ("XYZ", "Rx, Ry, Rz about x, then the new y, then the new z"),
    "kawasaki": ("ZYZ", "O, A, T about z, then the new y, then the new z"),
    "rpy": ("xyz", "roll, pitch, yaw about the fixed x, y, z (URDF, ROS)"),
    "rotvec": ("", "a rotation vector: its direction is the axis, its length the angle (Universal Robots)"),
}
_SEQUENCE = re.compile(r"([xyz])(?!\1)([xyz])(?!\2)[xyz]|([XYZ])(?!\3)([XYZ])(?!\4)[XYZ]")
_AXES = {"x": np.eye(3)[:, [1, 2, 0]], "y": np.eye(3)[:, [2, 0, 1]], "z": np.eye(3)}  # columns d1, d2, d3
_POSITION, _QUATERNION, _ANGLES = ("x", "y", "z"), ("qw", "qx", "qy", "qz"), ("a", "b", "c")
_NUMBERED, _MATRIX = ("q1", "q2", "q3", "q4"), tuple(f"r{i}{j}" for i in "123" for j in "123")
SCALARS = ("scalar-first", "scalar-last")
"""Conventions of quaternions q1 to q4."""


def _pattern(form: str) -> re.Pattern[str]:
    """A pattern in which each # is a number and a blank any space."""
    return re.compile(form.replace(" ", r"\s*").replace("#", r"([-+]?[\d.]+(?:[eE][-+]?\d+)?)"))


# by robot: pattern, unit of the position, convention ("" for a quaternion, scalar first), order of the numbers
_PRINTED = {
    "Universal Robots": (_pattern(r"p\[ # , # , # , # , # , # \]"), "m", "rotvec", False, range(6)),
    "KUKA": (_pattern(r"\{ X # , Y # , Z # , A # , B # , C #[^}]*\}"), "mm", "kuka", True, range(6)),
    "Fanuc": (_pattern(r"X = # mm , Y = # mm , Z = # mm , W = # deg , P = # deg , R = # deg"), "mm", "fanuc", True, range(6)),
    "ABB": (_pattern(r"\[ \[ # , # , # \] , \[ # , # , # , # \][^;\n]*"), "mm", "", True, range(7)),
    "ROS": (_pattern(r"position: x: # y: # z: # orientation: x: # y: # z: # w: #"), "m", "", True, (0, 1, 2, 6, 3, 4, 5)),
}
_DECLARED = re.compile(
    r"(?i)\b(?:decl|global|const|pers|local|var|e6pos|pos|frame|robtarget|pose|movel|movej)\b|[:=({,&]+|\bUF.*|\bGP\d"
)
_STATED = re.compile(r"(.*?)(?:[\s_]*[\[(]\s*([a-z]+)\s*[\])])?")  # x [mm]
_END = re.compile(r"(?i)[_ ]*(start|end)$")


def clamp_of_matrix(matrix: Annotated[np.ndarray, "3|4 4"], *, units: str = "m", tangent: str = "z") -> Clamp:
    """The clamp of a homogeneous matrix whose last column is the position in ``units``.

    ``tangent`` names the axis of the given frame that points along the cable from start to end: x, y, z, -x, -y or -z.
    Raises `Scan2FlexError` if the matrix is no rigid motion.
    """
    position, R = rigid_motion(matrix, Where("the frame"))
    return _clamp(position * length_unit(units), R, tangent)


def clamp_of_angles(
    position: ArrayLike, angles: ArrayLike, convention: str, *, units: str = "m", degrees: bool = True, tangent: str = "z"
) -> Clamp:
    """The clamp of a position (in ``units``) and three angles in a named convention: one of `CONVENTIONS`, or a sequence.

    A sequence is scipy's: upper case about the rotated axes ("ZYX"), lower case about the fixed ones ("xyz").
    """
    values = np.concatenate([np.asarray(x, float).ravel() for x in (position, angles)])
    if values.shape != (6,) or not np.all(np.abs(values) <= LARGEST):
        raise Scan2FlexError("a frame takes three coordinates and three angles, all finite.")
    sequence = sequence_of(convention)
    if sequence:
        turn = Rotation.from_euler(sequence, values[3:], degrees=degrees)
    else:
        turn = Rotation.from_rotvec(values[3:], degrees=degrees)
    return _clamp(values[:3] * length_unit(units), turn.as_matrix(), tangent)


def check_convention(convention: str) -> None:
    """Raise `Scan2FlexError` for a convention that is neither one of angles nor one of `SCALARS`."""
    if convention not in SCALARS:
        sequence_of(convention)


def sequence_of(convention: str) -> str:
    """The axes of a convention as scipy names them, empty for a rotation vector; raises `Scan2FlexError`."""
    sequence = CONVENTIONS[convention][0] if convention in CONVENTIONS else convention
    if convention != "rotvec" and not _SEQUENCE.fullmatch(sequence):
        names = ", ".join(CONVENTIONS)
        raise Scan2FlexError(f"the convention {convention[:20]!r} is not known: use {names}, or axes as in ZYX or xyz.")
    return sequence


def _clamp(position, R: np.ndarray, tangent: str) -> Clamp:
    return Clamp(position, quaternion_of(R @ axes_of(tangent)))


def axes_of(tangent: str) -> Annotated[np.ndarray, "3 3"]:
    """Columns d1, d2, d3 in the given frame, for the axis ``tangent`` along the cable; raises `Scan2FlexError`."""
    sign, axis = (-1.0, tangent[1:]) if tangent.startswith("-") else (1.0, tangent.removeprefix("+"))
    if axis not in _AXES:
        raise Scan2FlexError(f"the axis {tangent[:20]!r} is not known: use x, y, z, -x, -y or -z.")
    return _AXES[axis] * np.array([1.0, sign, sign])


def other_tangent(found: str, tangent: str) -> str:
    """The axis of the original frames that corresponds to the axis ``found`` (x, y, z for d1, d2, d3, with sign) of clamps made
    from them with ``tangent``."""
    along = axes_of(tangent) @ axes_of(found)[:, 2]
    k = int(np.argmax(np.abs(along)))
    return f"{'-' if along[k] < 0 else ''}{'xyz'[k]}"


def clamp_toml(clamp: Clamp) -> str:
    """The clamp on one line of the format, without the rounding noise of zeros."""
    rounded = [f"position = [{', '.join(f'{v:.9g}' for v in np.round(clamp.position, 12) + 0.0)}]"]
    if clamp.quaternion is not None:
        rounded.append(f"quaternion = [{', '.join(f'{v:.12g}' for v in np.round(clamp.quaternion, 14) + 0.0)}]")
    return f"{{ {', '.join(rounded)} }}"


def read_frames(
    path: Path, *, units: str = "m", convention: str | None = None, degrees: bool = True, tangent: str = "z"
) -> dict[str, Clamp]:
    """Clamps by name from a text file: matrices, each under a line with its name, a CSV with a header, or poses of a robot.

    Columns of a CSV: ``name`` or ``pose,end``; ``x,y,z``; and ``qw,qx,qy,qz``, or ``q1`` to ``q4`` (``convention`` one of
    `SCALARS`), or ``a,b,c`` (angles in ``convention``), or ``r11`` to ``r33`` (row by row), or none (a ball joint). A unit in
    its header (``x [mm]``, ``a [rad]``) holds whatever ``units`` and ``degrees`` are. Poses of a robot are those that Universal
    Robots, KUKA, Fanuc, ABB and ROS print, each under or behind its name; their units and angles are the robot's. Names are
    "POSE start" and "POSE end". Raises `Scan2FlexError` with file and line.
    """
    where = Where(one_line(str(path), 300))
    text = read_text(Path(path), TOML_LIMIT, where, "the file is not there: name one.", curve_limit())
    lines = [(i, kept) for i, line in enumerate(text.splitlines(), 1) if (kept := line.split("#")[0].strip())]
    if not lines:
        raise where.fail("it holds no frame: write matrices, or a CSV with a header.")
    header, units, degrees = _header(lines[0][1], where, units, degrees)
    rows = _table if set(_POSITION) <= set(header) else _matrices
    found: dict[str, Clamp] = {}
    robot = next((robot for robot, (pattern, *_) in _PRINTED.items() if pattern.search(text)), None)
    frames = _printed(text, robot, tangent) if robot else rows(lines, where, header, units, convention, degrees, tangent)
    for number, name, make in frames:
        here = where.at(f"line {number}")
        if name in found:
            raise here.fail(f"two frames are called {name[:60]!r}: give each its own name.")
        try:
            with here.placed():
                found[name] = make()
        except StudyError:
            raise
        except Scan2FlexError as error:
            raise here.fail(str(error)) from error
    return found


def holds_frames(path: Path) -> bool:
    """Whether a text file begins with poses of a robot, or as a table of clamps: with the header of names and x, y, z."""
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as file:
            text = file.read(4000)
            header, *_ = _header(text.partition("\n")[0][:300], Where(path.name))
    except (OSError, StudyError):
        return False
    if holds_messages(text):
        return False  # the points of a curve
    printed = any(pattern.search(text) for pattern, *_ in _PRINTED.values())
    return printed or (set(_POSITION) <= set(header) and _is_named(header))


def _header(line: str, where: Where, units: str = "m", degrees: bool = True) -> tuple[list[str], str, bool]:
    """The names of a table's columns, and the unit of lengths and whether angles are in degrees, where the header states it."""
    cells = [_STATED.fullmatch(cell.strip().strip('"').lower()) for cell in re.split(r"[,;\t]", line)]
    stated = {(cell[1] in _ANGLES, cell[2]) for cell in cells if cell and cell[2] and cell[1] in _POSITION + _ANGLES}
    lengths, angles = {unit for angle, unit in stated if not angle}, {unit for angle, unit in stated if angle}
    if len(lengths) > 1 or not lengths <= set(LENGTHS) or len(angles) > 1 or not angles <= {"deg", "rad"}:
        raise where.at("header").fail("it states units that are unknown or differ: write one of lengths, and deg or rad.")
    names = [cell[1] if cell else "" for cell in cells]
    return names, next(iter(lengths), units), next(iter(angles), "deg" if degrees else "rad") == "deg"


def _is_named(header: list[str]) -> bool:
    """Whether a header has the columns that name a frame."""
    return "name" in header or {"pose", "end"} <= set(header)


def _table(lines, where, header, units, convention, degrees, tangent):
    """Rows of a CSV as (line, name, constructor of the clamp)."""
    mark = next(m for m in ";\t," if m in lines[0][1])
    known = {"name", "pose", "end", *_POSITION, *_QUATERNION, *_ANGLES, *_NUMBERED, *_MATRIX}
    if not _is_named(header) or set(header) - known or len(set(header)) < len(header):
        raise where.at("line 1").fail("write a header with name (or pose,end), x,y,z and qw,qx,qy,qz or a,b,c.")
    angles, matrix = set(_ANGLES) <= set(header), set(_MATRIX) <= set(header)
    if angles and convention is None:
        raise where.fail(f"its angles a,b,c need a convention: name one of {', '.join(CONVENTIONS)}, or axes as in ZYX.")
    quaternion = next((names for names in (_QUATERNION, _NUMBERED) if set(names) <= set(header)), None)
    if quaternion == _NUMBERED:
        if convention not in SCALARS:
            raise where.fail(f"its quaternions q1,q2,q3,q4 need a convention: name {SCALARS[0]} (ABB) or {SCALARS[1]}.")
        quaternion = _NUMBERED if convention == SCALARS[0] else ("q4", "q1", "q2", "q3")
    for number, line in lines[1:]:
        cells = [cell.strip().strip('"') for cell in line.split(mark)]
        if len(cells) != len(header):
            raise where.at(f"line {number}").fail(f"got {len(cells)} columns: write {len(header)}.")
        row = dict(zip(header, cells, strict=True))

        def make(row=row):
            position = _numbers(row, _POSITION, mark)
            if angles and any(row[k] for k in _ANGLES):
                turn = _numbers(row, _ANGLES, mark)
                return clamp_of_angles(position, turn, convention, units=units, degrees=degrees, tangent=tangent)
            if quaternion and any(row[k] for k in quaternion):
                return _clamp(position * length_unit(units), _turn(_numbers(row, quaternion, mark)), tangent)
            if matrix:
                R = _numbers(row, _MATRIX, mark).reshape(3, 3)
                return clamp_of_matrix(np.column_stack([R, position]), units=units, tangent=tangent)
            return Clamp(position * length_unit(units))

        yield number, row["name"] if "name" in row else f"{row['pose']} {row['end'].lower()}", make


def _turn(quaternion) -> np.ndarray:
    """The rotation matrix of a quaternion, scalar first."""
    size = np.linalg.norm(quaternion)
    if not abs(size - 1) <= 1e-3:  # NaN too
        raise Scan2FlexError(f"its quaternion has the length {size:.4g}: give a unit one, scalar first.")
    return Rotation.from_quat(quaternion, scalar_first=True).as_matrix()


def _printed(text, robot, tangent):
    """Poses as a robot prints them, as (line, name, constructor of the clamp); a name stands before its pose."""
    pattern, units, convention, degrees, order = _PRINTED[robot]
    ended = 0
    for k, found in enumerate(pattern.finditer(text)):
        try:
            values = np.array([float(found[1 + i]) for i in order])
        except ValueError:  # 0.5.7: what the pose itself says of it
            values = np.full(len(order), np.nan)
        before = [_DECLARED.sub(" ", line).strip("\"'-;#!\t ") for line in text[ended : found.start()].splitlines()]
        name = " ".join(next((line for line in reversed(before) if line), f"frame {k + 1}").split())
        name = _END.sub(lambda end: f" {end[1].lower()}", name)
        ended = found.end()

        def make(values=values):
            if convention:
                return clamp_of_angles(values[:3], values[3:], convention, units=units, degrees=degrees, tangent=tangent)
            return _clamp(values[:3] * length_unit(units), _turn(values[3:]), tangent)

        yield text.count("\n", 0, found.start()) + 1, name, make


def _numbers(row, names, mark):
    cells = [row[name].replace(",", ".") if mark != "," else row[name] for name in names]
    try:
        values = np.array([float(cell) for cell in cells])
    except ValueError:
        shown = ", ".join(one_line(c[:20]) or "empty" for c in cells)
        raise Scan2FlexError(f"{', '.join(names)} are {shown}: write numbers.") from None
    if not np.all(np.abs(values) <= LARGEST):
        raise Scan2FlexError(f"{', '.join(names)} are not all finite: write finite numbers.")
    return values


def _matrices(lines, where, header, units, convention, degrees, tangent):
    """Matrices as (line, name, constructor of the clamp); a line without numbers is the name of the next matrix."""
    values: list[list[float]] = []
    name, begun, count = "", lines[0][0], 0
    for number, line in [*lines, (lines[-1][0], None)]:
        row = None if line is None else _row(line)
        if row is not None:
            begun = begun if values else number
            values += [row]
            if len(row) != 4 or len(values) > 4:
                raise where.at(f"line {number}").fail(f"a row of a 4x4 matrix has four numbers, got {line[:60]!r}.")
        done = len(values) == 4 or (row is None and values)
        if done:
            count += 1
            label, rows = name or f"frame {count}", np.array(values)
            yield begun, label, lambda rows=rows: clamp_of_matrix(rows, units=units, tangent=tangent)
            name, values = "", []
        if row is None and line is not None:
            name = line.rstrip(":=[ ").strip("\"' ") or name
    if not count:
        raise where.fail("it holds no frame: write 4x4 matrices, or a CSV with a header that has x,y,z.")


def _row(line):
    """The numbers of a line, or None if it holds anything else."""
    try:
        return [float(cell) for cell in re.sub(r"[\[\](),;]", " ", line).split()] or None
    except ValueError:
        return None
