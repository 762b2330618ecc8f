"""Centre curves from other tools: detection of a text file's separator, decimal mark, header, columns and unit.

Properties that the file determines are detected; an error requests the others. Coordinates are returned in metres, in the
order of the file, without consecutive duplicates.
"""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np

from scan2flex_jax.convert.units import LENGTHS, length_unit
from scan2flex_jax.study import arrays
from scan2flex_jax.study.curves import arc_length_fault, checked_curve
from scan2flex_jax.study.files import read_text
from scan2flex_jax.study.limits import curve_limit
from scan2flex_jax.study.model import MeasuredCurve
from scan2flex_jax.study.values import Where, one_line, shown

_DIALECTS = ((";", "."), (";", ","), ("\t", "."), ("\t", ","), (",", "."), (None, "."), (None, ","))  # separator, decimal mark
_SAMPLE = 300  # lines that determine the dialect
_PREAMBLE = 60  # most lines before the first point
_ARC = 0.2  # relative difference up to which a column counts as the arc length of the points
_NAMES = {"s": "s", "arclength": "s", "arc": "s", "curvilinearabscissa": "s", "abscissa": "s",
          "points0": "x", "points1": "y", "points2": "z"}  # fmt: skip
_COORDINATE = re.compile(
    r"(?:pos|position|p|point|points|coord|coordinate|centre|center)?([xyz])(?:pos|position|coord|coordinate)?"
)
_UNIT = re.compile(r"(.*?)[\s_]*[\[(\s_]\s*([a-z]+)\s*[\])]?\s*")


@dataclass(frozen=True)
class CurveFile:
    """A centre curve in metres, and the properties detected in its file, in words."""

    curve: MeasuredCurve
    notes: tuple[str, ...]


def read_foreign_curve(path: Path, *, units: str | None = None, columns: str | None = None) -> CurveFile:
    """The centre curve in a text file of another tool.

    ``units``: the unit of its lengths; by default that of the header, else m. ``columns``: the meaning of the columns,
    as in "s,x,y,z" or "-,x,y,z" ("-" is ignored); by default from the header or the numbers. Raises `StudyError`.
    """
    where = Where(one_line(str(path), 300))
    points, s, notes = _read(Path(path), units, columns, where)
    return CurveFile(checked_curve(points, s, None, where), notes)


def read_foreign_points(path: Path, *, units: str | None = None) -> Annotated[np.ndarray, "n 3"]:
    """Guide points (m) in a text file of another tool: at least two."""
    where = Where(one_line(str(path), 300))
    return arrays.points(_read(Path(path), units, None, where)[0], 2, where)


def _read(path, units, columns, where):
    """Points (m), arc length (m) or None, and the detected properties of the file."""
    rows = curve_limit()
    text = read_text(path, rows.bytes, where, "the file is not there: name one.", rows)
    lines = [line for line in (raw.strip() for raw in text.splitlines()) if line]
    mark, decimal, first = _dialect(lines, where)
    table = _table(lines[first:], mark, decimal, where)
    header = _header(lines, first, mark, table.shape[1])
    stated = None
    if columns is not None:
        names = _given(columns, table.shape[1], where)
    elif header is not None:
        names, stated = _named(header, where)
    else:
        names = _guessed(table, where)
    unit = units or stated or "m"
    if units and stated and units != stated:
        said = f"it states {stated}, but the given unit is {units}"
        raise where.at("header").fail(f"{said}: leave the unit out, or correct the header.")
    by_name = {name: table[:, i] * length_unit(unit) for i, name in enumerate(names) if name}
    points = np.column_stack([by_name[name] for name in "xyz"])
    keep = np.r_[True, np.any(points[1:] != points[:-1], axis=1)]
    s = by_name["s"][keep] if "s" in by_name else None
    fault = None if s is None or len(s) < 2 else arc_length_fault(points[keep], s)
    s = s if fault is None else None
    marks = {";": "semicolons", "\t": "tabs", ",": "commas", None: "blanks"}
    given = ", ".join(name or "(left out)" for name in names)
    notes = [f"{int(keep.sum())} points in {unit}, columns {given}, separated by {marks[mark]}"]
    notes += [] if fault is None else [f"the column s was left out: {fault}"]
    notes += ["with decimal commas"] * (decimal == ",")
    notes += [f"{int(np.sum(~keep))} points that repeat the one before were left out"] * bool(np.any(~keep))
    return points[keep], s, tuple(notes)


def _cells(line: str, mark: str | None, decimal: str) -> list[float] | None:
    """The numbers of a line, or None."""
    cells = [cell.strip().strip('"') for cell in line.split(mark)]
    while cells and not cells[-1]:
        cells.pop()
    try:
        return [float(cell.replace(",", ".") if decimal == "," else cell) for cell in cells]
    except ValueError:
        return None


def _dialect(lines, where):
    """``(separator, decimal mark, first line of numbers)`` under which the most lines are rows of three numbers or more."""
    best: tuple[int, tuple[str | None, str, int] | None] = (0, None)
    for mark, decimal in _DIALECTS:
        rows = [_cells(line, mark, decimal) for line in lines[:_SAMPLE]]
        wide = [len(row) if row is not None and len(row) >= 3 else 0 for row in rows]
        count = sum(w > 0 for w in wide)
        if count > best[0]:
            best = (count, (mark, decimal, next(i for i, w in enumerate(wide) if w)))
    if best[1] is None or best[1][2] > _PREAMBLE:
        raise where.fail("no line holds three numbers or more: give a text file with one point x,y,z a line.")
    return best[1]


def _table(lines, mark, decimal, where) -> Annotated[np.ndarray, "n c"]:
    """All rows from the first line of numbers on; a truncated row is an error."""
    rows = [_cells(line, mark, decimal) for line in lines]
    width = len(rows[0] or ())
    for i, row in enumerate(rows):
        if row is None or len(row) != width:
            here = where.at(f"point {i + 1}")
            raise here.fail(f"got {shown(lines[i])}: write {width} numbers, as on the line of the first point.")
    return np.array(rows, float)


def _header(lines, first, mark, columns) -> list[str] | None:
    """The cells of the line before the first point, if it has the same number of columns."""
    if first == 0:
        return None
    cells = [c.strip().strip('"') for c in lines[first - 1].lstrip("#/% ").split(mark)]
    while cells and not cells[-1]:
        cells.pop()
    return cells if len(cells) == columns else None


def _named(header, where) -> tuple[list[str | None], str | None]:
    """The meaning of each column of a header, and the unit that it states."""
    names, units = [], set()
    for cell in header:
        base, unit = cell.lower(), None
        found = _UNIT.fullmatch(base)
        if found and found[2] in LENGTHS and found[1]:
            base, unit = found[1], found[2]
        plain = re.sub(r"[^a-z0-9]", "", base)
        coordinate = _COORDINATE.fullmatch(plain)
        name = _NAMES.get(plain) or (coordinate and coordinate[1])
        name = name if name and name not in names else None
        names.append(name)
        if name and unit:
            units.add(unit)
    here = where.at("header")
    if not {"x", "y", "z"} <= set(names):
        raise here.fail(f"{shown(', '.join(header))} names no x, y, z: say what the columns are, as in s,x,y,z or -,x,y,z.")
    if len(units) > 1:
        raise here.fail(f"it states several units ({', '.join(sorted(units))}): convert the columns to one.")
    return names, next(iter(units), None)


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
    raise where.at("columns").fail(f"there is no header over the {count} columns: {advice}")
