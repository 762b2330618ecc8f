"""Centre curves from other tools: the columns and the unit of a table (`study.tables`).

Properties that the file determines are detected; an error requests the others. Coordinates are returned in metres, in the
order of the file, without consecutive duplicates.
"""

import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from scan2flex_jax.convert.motion_capture import captured, load_array
from scan2flex_jax.convert.polylines import Polyline, ordered, polyline_in
from scan2flex_jax.convert.units import length_unit
from scan2flex_jax.errors import StudyError
from scan2flex_jax.study.curves import arc_length_fault, checked_curve
from scan2flex_jax.study.files import read_text
from scan2flex_jax.study.limits import curve_limit
from scan2flex_jax.study.model import MeasuredCurve
from scan2flex_jax.study.scans import load_geometry
from scan2flex_jax.study.tables import SAMPLE, counts_rows, dialect, placed, rows
from scan2flex_jax.study.values import LARGEST, Where, one_line, shown
from scan2flex_jax.study.values import points as points_of

_FARTHER = 3.0  # times the nearest other point: the median step between points that are out of order
_ARC = 0.2  # relative difference up to which a column counts as the arc length of the points
_HEAD = 10_000  # bytes of a header
_DRAWN = {
    ".ply": (re.compile(rb"element edge\s+[1-9]"), re.compile(rb"element face\s+[1-9]")),
    ".obj": (re.compile(rb"^l\s", re.MULTILINE), re.compile(rb"^f\s", re.MULTILINE)),
}  # edges and faces
_PLANE = (
    "its points have two coordinates (a column that counts the rows is none): name their axes in the study, as in "
    "--columns x,z (right and up), or x,-z where the second grows downwards, as pixels do."
)


@dataclass(frozen=True)
class CurveFile:
    """A centre curve in metres, and the properties detected in its file, in words."""

    curve: MeasuredCurve
    notes: tuple[str, ...]


def read_foreign_curve(
    path: Path,
    *,
    units: str | None = None,
    columns: str | None = None,
    frame: int | None = None,
    arc_lengths: dict[str, float] | None = None,
) -> CurveFile:
    """The centre curve in a file of another tool; the markers of a motion capture, in their order, are one.

    ``units``: the unit of its lengths; by default that of the header, else m. ``columns``: the meaning of the columns,
    as in "s,x,y,z", "-,x,y,z" ("-" is ignored), or "x,-z" (in the plane y = 0, z downwards); by default from the header or the
    numbers, which must name three coordinates. ``frame``: of a motion capture,
    counted from 0; None: the mean of all. ``arc_lengths`` (m): of its markers, by name; others are left out. Raises
    `StudyError`.
    """
    where = Where(one_line(str(path), 300))
    capture = captured(path)
    if capture is None and (frame is not None or arc_lengths is not None):
        raise where.fail("it is no motion capture, which alone has frames and names of markers: leave both out for it.")
    if capture is None:
        points, s, notes = _read(Path(path), units, columns, where)
    else:
        points, s, notes = _still(capture, units, frame, arc_lengths, where)
    return CurveFile(checked_curve(points, s, None, where), notes)


def _still(capture, units, frame, arc_lengths, where):
    """Points (m), arc lengths (m) or None, and notes of a motion capture."""
    names, points, notes = capture.still(frame, where)
    unit = agreed_unit(units, capture.unit, where)
    if arc_lengths is None:
        return length_unit(unit) * points, None, (*notes, f"in {unit}, in the order of the file")
    known = sorted((name for name in names if name in arc_lengths), key=arc_lengths.__getitem__)
    if not known:
        raise where.fail(f"none of its markers ({', '.join(names[:6])}) has an arc length: name them as the file does.")
    spare = [name for name in names if name not in arc_lengths]
    notes += [f"without an arc length, and left out: {', '.join(spare)}"] * bool(spare)
    at = [names.index(name) for name in known]
    return length_unit(unit) * points[at], np.array([arc_lengths[name] for name in known]), (*notes, f"in {unit}")


def agreed_unit(given: str | None, stated: str | None, where: Where) -> str:
    """The unit of lengths, by the user or the file."""
    if given and stated and given != stated:
        said = f"it states {stated}, but the given unit is {given}"
        raise where.at("header").fail(f"{said}: leave the unit out, or correct the header.")
    return given or stated or "m"


def read_foreign_points(path: Path, *, units: str | None = None) -> Annotated[np.ndarray, "n 3"]:
    """Guide points (m) in a text file of another tool: at least two."""
    where = Where(one_line(str(path), 300))
    return points_of(_read(Path(path), units, None, where)[0], 2, where)


@np.errstate(all="ignore")  # numbers that are not finite are refused later, with their place
def _read(path, units, columns, where):
    """Points (m), arc length (m) or None, and the detected properties of the file."""
    found = _table(path, curve_limit(), where)
    names = _names(found, columns, where)
    unit = agreed_unit(units, found.unit, where) if units or found.unit else found.usual or "m"
    by_name = {name[-1]: (-1 if name[0] == "-" else 1) * found.rows[:, i] for i, name in enumerate(names) if name}
    points = length_unit(unit) * np.column_stack([by_name.get(name, np.zeros(len(found.rows))) for name in "xyz"])
    there = np.flatnonzero(~np.isnan(points).any(axis=1))
    s = length_unit(unit) * by_name["s"] if "s" in by_name else None
    order = there if s is None else there[np.argsort(s[there], kind="stable")]
    fault = None if s is None or len(there) < 2 else arc_length_fault(points[order], s[order])
    order = order if fault is None else there
    same = np.r_[False, np.all(points[order][1:] == points[order][:-1], axis=1)][: len(order)]
    sorted_by_s, order = bool(np.any(np.diff(order) < 0)), order[~same]
    given = ", ".join(name or "(left out)" for name in names)
    notes = [f"{len(order)} points in {unit}, columns {given}, {found.said}"]
    notes += [f"in the plane {c} = 0" for c in "xyz" if c not in by_name]
    notes += ["put in the order of s"] * sorted_by_s
    notes += [] if fault is None else [f"the column s was left out: {fault}"]
    notes += [f"{int(np.sum(same))} points that repeat the one before were left out"] * bool(np.any(same))
    if _out_of_order(points[order]):
        notes.append("most points are nearer to others than to their neighbours in the file: sort them along the cable")
    lost = len(points) - len(there)
    notes += [f"{lost} rows without a point were left out"] * bool(lost)
    return points[order], None if s is None or fault is not None else s[order], tuple(notes)


class _Table(NamedTuple):
    """The rows of a file, how it was written, and what it says of its columns and its unit; ``usual``: that of its program."""

    rows: Annotated[np.ndarray, "n c"]
    said: str
    names: tuple[str | None, ...] | None = None
    unit: str | None = None
    usual: str | None = None
    texts: frozenset[int] = frozenset()


def _table(path, limit, where):
    """The rows of a text, of an array of numpy, or of the vertices of a PLY along its edges."""
    kind = path.suffix.lower()
    if kind == ".npy":
        return _array(path, limit, where)
    if kind == ".ply":
        return _edges(path, where)
    text = read_text(path, limit.bytes, where, "the file is not there: name one.", limit, foreign=True)
    line = polyline_in(text, where) or Polyline(text)
    lines = [row for row in line.text.splitlines() if row.strip()]
    try:
        how = dialect(lines[:SAMPLE], where)
    except StudyError as fault:
        try:
            how = dialect(lines[:SAMPLE], where, 2)  # points in a plane
        except StudyError:
            raise fault from None
    table = rows(lines[how.first :], how, where)
    return _Table(table, str(how), how.names, line.unit or how.unit, line.usual, how.texts)


def _array(path, limit, where):
    """An array of numpy: a point a row, or a coordinate a row."""
    array = load_array(path, limit, where)
    if array.dtype.names and {"x", "y", "z"} <= set(array.dtype.names) and array.ndim == 1:
        return _Table(np.column_stack([array[c] for c in "xyz"]).astype(float), "fields of an array", ("x", "y", "z"))
    if array.ndim != 2 or array.dtype.kind not in "fiu" or min(array.shape) < 2 or array.shape in ((2, 2), (3, 3)):
        said = f"an array of the shape {array.shape} and type {one_line(str(array.dtype))} is no list of points"
        raise where.fail(f"{said}: save one of the shape (n, 3).")
    turned = len(array) in (2, 3) and array.shape[1] > 3
    table = np.array(array.T if turned else array, float)
    return _Table(table, f"an array of the shape {array.shape}, a {'coordinate' if turned else 'point'} a row")


def _edges(path, where):
    """The vertices of a PLY: in the order along its edges, if it has any."""
    loaded = load_geometry(path)
    if getattr(loaded, "faces", None) is not None or not hasattr(loaded, "vertices"):
        raise where.fail("it is a mesh and no curve: read it as a scan.")
    points, parts = np.asarray(loaded.vertices, float), getattr(loaded, "entities", None)
    if parts is None:
        return _Table(points, "vertices of a PLY", ("x", "y", "z"))
    joined = ordered((pair for part in parts for pair in pairwise(part.points.tolist())), points.tolist(), where)
    return _Table(np.array(joined), "vertices of a PLY along its edges", ("x", "y", "z"))


def _names(found, columns, where) -> list[str | None]:
    """The meaning of the columns: by the user, the header or the numbers."""
    count, given = found.rows.shape[1], None if columns is None else _given(columns, where)
    if given is not None and len(given) == count:
        return given
    if found.names is not None:
        names = list(found.names)
    else:
        plain = [k for k in range(count) if k not in found.texts]
        by_column = dict(zip(plain, _guessed(found.rows[:, plain], where), strict=True))
        names = [by_column.get(k) for k in range(count)]
    plane = [k for k, name in enumerate(names) if name and name in "xyz"]
    if given is None and len(plane) == 2:
        raise where.at("columns").fail(_PLANE)
    if given is None:
        placed(names, where)
        return names
    if not len(given) == len(plane) == 2:
        raise where.at("columns").fail(f"got {len(given)} names for {count} columns: name each one, - for what is left out.")
    return [given[plane.index(k)] if k in plane else None for k in range(count)]


def _given(columns: str, where) -> list[str | None]:
    """The columns named by the user."""
    names = [cell.strip().lower() for cell in columns.split(",")]
    kept = [name for name in names if name not in ("-", "")]
    axes = sorted(name.removeprefix("-") for name in kept if name != "s")
    if kept.count("s") > 1 or axes not in (["x", "y", "z"], ["x", "y"], ["x", "z"], ["y", "z"]):
        advice = "name x, y, z (two for a plane), if need be s, and - for what is left out."
        raise where.at("columns").fail(f"got {shown(columns)}: {advice}")
    return [name if name in kept else None for name in names]


def _guessed(table, where) -> list[str | None]:
    """Columns of a table without header: three are x, y, z, possibly after a running number or the arc length."""
    count = table.shape[1]
    if count == 2:
        return ["x", "y"]
    if count == 3:
        return [None, "x", "y"] if counts_rows(table[:, 0]) else ["x", "y", "z"]
    advice = "say what they are, as in s,x,y,z or -,x,y,z."
    if count == 4 and len(table) > 1:
        step, along = np.diff(table[:, 0]), np.linalg.norm(np.diff(table[:, 1:], axis=0), axis=1)
        if np.all(step == 1.0):
            return [None, "x", "y", "z"]
        if np.all(step > 0) and abs(np.sum(step) - np.sum(along)) < _ARC * np.sum(along):
            return ["s", "x", "y", "z"]
    if count == 6 and (_colours(table[:, 3:]) or _normals(table[:, 3:])):
        return ["x", "y", "z", None, None, None]
    raise where.at("columns").fail(f"there is no header over the {count} columns: {advice}")


def is_polyline(path: Path) -> bool:
    """Whether a PLY or OBJ holds edges and no faces: a line, and neither cloud nor mesh."""
    kind = path.suffix.lower()
    if kind not in _DRAWN:
        return False
    with path.open("rb") as file:
        text = file.read(_HEAD if kind == ".ply" else curve_limit().bytes)
    edges, faces = _DRAWN[kind]
    return bool(edges.search(text)) and not faces.search(text)


def _out_of_order(points) -> bool:
    """Whether the steps from point to point are mostly far longer than the distances of nearest neighbours."""
    if len(points) < 4 or not np.all(np.abs(points) <= LARGEST):  # refused later, if so
        return False
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    nearest = cKDTree(points).query(points, 2)[0][:-1, 1]
    return bool(np.median(steps / np.maximum(nearest, 1e-30)) > _FARTHER)


def _colours(columns):
    return np.all((columns >= 0) & (columns <= 255) & (columns == np.round(columns)))


def _normals(columns):
    return np.allclose(np.linalg.norm(columns, axis=1), 1.0, atol=1e-3)
