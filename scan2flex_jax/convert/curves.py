"""Centre curves from other tools: the columns and the unit of a table (`study.tables`).

Properties that the file determines are detected; an error requests the others. Coordinates are returned in metres, in the
order of the file, without consecutive duplicates.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
from scipy.spatial import cKDTree

from scan2flex_jax.convert.motion_capture import Capture, capture_in, read_c3d
from scan2flex_jax.convert.polylines import rows_of_polyline
from scan2flex_jax.convert.units import length_unit
from scan2flex_jax.study.curves import arc_length_fault, checked_curve
from scan2flex_jax.study.files import read_text
from scan2flex_jax.study.limits import curve_limit
from scan2flex_jax.study.model import MeasuredCurve
from scan2flex_jax.study.scans import load_geometry
from scan2flex_jax.study.tables import SAMPLE, Dialect, dialect, rows
from scan2flex_jax.study.values import Where, one_line, shown
from scan2flex_jax.study.values import points as points_of

_FARTHER = 3.0  # times the nearest other point: the median step between points that are out of order
_ARC = 0.2  # relative difference up to which a column counts as the arc length of the points


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
    as in "s,x,y,z" or "-,x,y,z" ("-" is ignored); by default from the header or the numbers. ``frame``: of a motion capture,
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


def read_arc_lengths(path: Path, *, units: str | None = None) -> dict[str, float]:
    """Arc lengths (m) of markers by name, from a CSV with the header ``name,s``; raises `StudyError`."""
    where, limit = Where(one_line(str(path), 300)), curve_limit()
    text = read_text(Path(path), limit.bytes, where, "the file is not there: name one.", limit, foreign=True)
    lines = [[cell.strip() for cell in re.split("[;,\t]", line)] for line in text.splitlines() if line.strip()]
    if not lines or [cell.lower() for cell in lines[0]] != ["name", "s"]:
        raise where.at("header").fail("write the header name,s.")
    found = {}
    for k, cells in enumerate(lines[1:]):
        try:
            name, s = cells
            found[name] = length_unit(units or "m") * float(s)
        except ValueError:
            raise where.at(f"line {k + 2}").fail(f"got {shown(','.join(cells))}: write a name and a number.") from None
    return found


def captured(path: Path) -> Capture | None:
    """The motion capture in a file; None for another file. Raises `StudyError`."""
    path, limit = Path(path), curve_limit()
    if path.suffix.lower() == ".c3d":
        return read_c3d(path)
    if path.suffix.lower() != ".csv":
        return None
    where = Where(one_line(str(path), 300))
    return capture_in(read_text(path, limit.bytes, where, "the file is not there: name one.", limit, foreign=True))


def _still(capture, units, frame, arc_lengths, where):
    """Points (m), arc lengths (m) or None, and notes of a motion capture."""
    names, points, notes = capture.still(frame, where)
    unit = _unit(units, capture.unit, where)
    if arc_lengths is None:
        return length_unit(unit) * points, None, (*notes, f"in {unit}, in the order of the file")
    known = sorted((name for name in names if name in arc_lengths), key=arc_lengths.__getitem__)
    if not known:
        raise where.fail(f"none of its markers ({', '.join(names[:6])}) has an arc length: name them as the file does.")
    spare = [name for name in names if name not in arc_lengths]
    notes += [f"without an arc length, and left out: {', '.join(spare)}"] * bool(spare)
    at = [names.index(name) for name in known]
    return length_unit(unit) * points[at], np.array([arc_lengths[name] for name in known]), (*notes, f"in {unit}")


def _unit(given, stated, where) -> str:
    """The unit of lengths, by the user or the file."""
    if given and stated and given != stated:
        said = f"it states {stated}, but the given unit is {given}"
        raise where.at("header").fail(f"{said}: leave the unit out, or correct the header.")
    return given or stated or "m"


def read_foreign_points(path: Path, *, units: str | None = None) -> Annotated[np.ndarray, "n 3"]:
    """Guide points (m) in a text file of another tool: at least two."""
    where = Where(one_line(str(path), 300))
    return points_of(_read(Path(path), units, None, where)[0], 2, where)


def _read(path, units, columns, where):
    """Points (m), arc length (m) or None, and the detected properties of the file."""
    limit = curve_limit()
    how, table = _table(path, limit, where)
    plain = [k for k in range(how.width) if k not in how.texts]
    if columns is not None:
        names = _given(columns, table.shape[1], where)
    elif how.names is not None:
        names = list(how.names)
    else:
        names = [None] * how.width
        for k, name in zip(plain, _guessed(table[:, plain], where), strict=True):
            names[k] = name
    unit = _unit(units, how.unit, where)
    by_name = {name: table[:, i] * length_unit(unit) for i, name in enumerate(names) if name}
    points = np.column_stack([by_name[name] for name in "xyz"])
    there = ~np.isnan(points).any(axis=1)
    new = np.r_[True, np.any(points[1:] != points[:-1], axis=1)]
    keep = there & new
    s = by_name["s"][keep] if "s" in by_name else None
    fault = None if s is None or len(s) < 2 else arc_length_fault(points[keep], s)
    s = s if fault is None else None
    given = ", ".join(name or "(left out)" for name in names)
    notes = [f"{int(keep.sum())} points in {unit}, columns {given}, {how}"]
    notes += [] if fault is None else [f"the column s was left out: {fault}"]
    notes += [f"{int(np.sum(there & ~new))} points that repeat the one before were left out"] * bool(np.any(there & ~new))
    if _out_of_order(points[keep]):
        notes.append("most points are nearer to others than to their neighbours in the file: sort them along the cable")
    notes += [f"{int(np.sum(~there))} rows without a point were left out"] * bool(not np.all(there))
    return points[keep], s, tuple(notes)


def _table(path, limit, where):
    """The dialect and the rows of a file."""
    if path.suffix.lower() == ".npy":
        return Dialect(None, ".", 0, 3), np.asarray(load_geometry(path).vertices)
    text = read_text(path, limit.bytes, where, "the file is not there: name one.", limit, foreign=True)
    lines = [line for line in (rows_of_polyline(text) or text).splitlines() if line.strip()]
    how = dialect(lines[:SAMPLE], where)
    return how, rows(lines[how.first :], how, where)


def _given(columns: str, count: int, where) -> list[str | None]:
    """The columns named by the user."""
    names = [cell.strip().lower() for cell in columns.split(",")]
    kept = [name for name in names if name not in ("-", "")]
    if sorted(kept) not in (["x", "y", "z"], ["s", "x", "y", "z"]):
        raise where.at("columns").fail(f"got {shown(columns)}: name x, y, z, if need be s, and - for what is left out.")
    if len(names) != count:
        raise where.at("columns").fail(f"got {len(names)} names for {count} columns: name each one, - for what is left out.")
    return [name if name in kept else None for name in names]


@np.errstate(all="ignore")  # numbers that are not finite are refused later, with their place
def _guessed(table, where) -> list[str | None]:
    """Columns of a table without header: three are x, y, z, possibly after a running number or the arc length."""
    count = table.shape[1]
    if count == 3:
        return ["x", "y", "z"]
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


def _out_of_order(points) -> bool:
    """Whether the steps from point to point are mostly far longer than the distances of nearest neighbours."""
    if len(points) < 4 or not np.all(np.isfinite(points)):  # refused later, if so
        return False
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    nearest = cKDTree(points).query(points, 2)[0][:-1, 1]
    return bool(np.median(steps / np.maximum(nearest, 1e-30)) > _FARTHER)


def _colours(columns):
    return np.all((columns >= 0) & (columns <= 255) & (columns == np.round(columns)))


def _normals(columns):
    return np.allclose(np.linalg.norm(columns, axis=1), 1.0, atol=1e-3)
