"""Measured centre curves: reading from CSV, checks, and arc length.

The polyline through noisy points is longer than the curve, since noise adds to each step: `curve_length` averages neighbours.
"""

from pathlib import Path
from typing import Annotated

import numpy as np

from scan2flex_jax.study import values as v
from scan2flex_jax.study.files import CSV_LIMIT, read_text
from scan2flex_jax.study.limits import CURVE_POINTS, curve_limit
from scan2flex_jax.study.model import Markers, MeasuredCurve
from scan2flex_jax.study.values import Where

BLOCKS = 64  # averaged knots of a curve: a full loop over 64 chords is 0.04 % short, and noise falls with the points per block

FEW_BLOCKS = 8  # averaged knots of a lower bound: the noise of picked points adds nothing to chords of an eighth of the curve
ALONG = 0.8  # of the lower bound of the length: arc lengths that grow by less are in another unit
BEYOND = 5.0  # times that bound: arc lengths that look like per cent and grow by more are
_MEASURED = ("s,x,y,z", "s,x,y", "s,x,z", "s,y,z", "s,x", "s,y", "s,z")
MARKED = (*_MEASURED, *(f"{header},d1,d2" for header in _MEASURED))  # headers of markers
_COLUMNS = {"points": None, "arc_length": "s"}  # of a file, by the field of a record
_PERCENT = (90.0, 101.0)  # arc lengths of a whole cable, in per cent


def read_curve(path: Path, where: Where) -> MeasuredCurve:
    """The centre curve in a CSV with the header `x,y,z` or `s,x,y,z`; `where` names the file for the user."""
    names, table = read_csv(path, ("x,y,z", "s,x,y,z"), where)
    return checked_curve(table[:, -3:], table[:, 0] if names[0] == "s" else None, path, where)


def checked_curve(
    points: Annotated[np.ndarray, "n 3"], s: Annotated[np.ndarray, " n"] | None, path: Path | None, where: Where
) -> MeasuredCurve:
    """The measured curve of a file, with errors that name the file and the column."""
    with where.placed(_COLUMNS):
        return MeasuredCurve(points, s, path)


def read_markers(path: Path, where: Where) -> Markers:
    """The points at known arc lengths in a CSV with the header `s,x,y,z`, or `s` and the coordinates that were measured, as in
    `s,z`, in any order; two more columns `d1,d2` are their places beside the axis. `where` names the file for the user."""
    names, table = read_csv(path, MARKED, where)
    table = table[np.argsort(table[:, 0], kind="stable")]
    points = np.full((len(table), 3), np.nan)
    own = [name for name in names if name in "xyz"]
    points[:, ["xyz".index(name) for name in own]] = table[:, 1 : 1 + len(own)]
    with where.placed(_COLUMNS):
        return Markers(points, table[:, 0], path, table[:, -2:] if names[-1] == "d2" else None)


def read_guide_points(path: Path, where: Where) -> Annotated[np.ndarray, "k 3"]:
    """Points that a user marked on the surface, from start to end; header `x,y,z`."""
    return v.points(read_csv(path, ("x,y,z",), where)[1], 2, where)


def arc_length_fault(points: Annotated[np.ndarray, "n 3"], s: Annotated[np.ndarray, " n"]) -> str | None:
    """A sentence if arc lengths contradict the distances of their points, and whether they look like per cent.

    They may exceed the distances of sparse points, but never by a whole unit, and never fall below."""
    grown, along = float(s[-1] - s[0]), curve_length(points, FEW_BLOCKS)
    percent = any(_PERCENT[0] <= unit * s[-1] <= _PERCENT[1] for unit in (1.0, 10.0, 100.0, 1000.0))
    if grown >= ALONG * along and not (percent and grown > BEYOND * along):
        return None
    advice = "write it in metres"
    if percent:
        advice = "s looks like per cent of the length: leave the column out, or write it in metres"
    return f"its s grows by {grown:.4g} m along points that are {along:.4g} m long: {advice}"


def read_csv(path: Path, headers: tuple[str, ...], where: Where) -> tuple[list[str], Annotated[np.ndarray, "n c"]]:
    """Column names and numbers of a CSV whose header is one of `headers`."""
    missing, rows = "the file is not there: put it into the study's folder.", curve_limit()
    content = read_text(path, CSV_LIMIT * rows.points // CURVE_POINTS, where, missing, rows)
    first, *lines = content.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    names = [name.strip() for name in first.split(",")] if len(first) < 200 else []
    if ",".join(names) not in headers:
        raise where.at("header").fail(f"the first line is {v.shown(first)}: write the header {' or '.join(headers[:2])}.")
    table: list[float] = []
    for i, line in enumerate(lines, 2):
        if not line or line.isspace():
            continue
        cells = line.split(",")
        if len(cells) != len(names):
            raise where.at(f"line {i}").fail(f"got {v.counted(len(cells), 'column')} in {v.shown(line)}: write {len(names)}.")
        for cell in cells:
            try:
                table.append(float(cell.replace("_", "x").encode("ascii")))  # float takes 1_0, and the digits of every script
            except ValueError:
                said = f"{v.shown(cell.strip())} is no number: write a number, as in 0.125."
                raise where.at(f"line {i}").fail(said) from None
    if not table:
        raise where.fail("no point follows the header: give at least one line of numbers.")
    return names, np.array(table).reshape(-1, len(names))


def curve_length(points: Annotated[np.ndarray, "n 3"], blocks: int = BLOCKS) -> float:
    """Length (m) of the curve through noisy points: first point, averages of neighbours in blocks, last point.

    With a few blocks it is a lower bound."""
    return float(np.sum(np.linalg.norm(np.diff(_knots(points, blocks), axis=0), axis=1)))


def chord_deficit(points: Annotated[np.ndarray, "n 3"], start: float = 0.0, end: float = 0.0) -> float:
    """Shortfall (m) of `curve_length`: the chord h of an arc that turns by a is shorter by h (a / (2 sin(a / 2)) - 1).

    ``start`` and ``end``: angles (rad) between the curve's tangents there, if known, and its end chords."""
    chords = np.diff(_knots(points), axis=0)
    h = np.linalg.norm(chords, axis=1)
    cosine = np.sum(chords[1:] * chords[:-1], axis=1) / np.maximum(h[1:] * h[:-1], np.finfo(float).tiny)
    turn = np.arccos(np.clip(cosine, -1.0, 1.0))
    over = np.maximum(np.r_[2.0 * start, turn], np.r_[turn, 2.0 * end])  # the larger of the turns at the two ends of a chord
    return float(np.sum(h * (1 / np.sinc(np.minimum(over, np.pi) / (2 * np.pi)) - 1)))


def _knots(points: Annotated[np.ndarray, "n 3"], blocks: int = BLOCKS) -> Annotated[np.ndarray, "k 3"]:
    """First point, averages of neighbours if there are many, last point."""
    if len(points) <= blocks:
        return points
    edges = np.linspace(0, len(points), blocks + 1).astype(int)
    means = np.add.reduceat(points, edges[:-1], axis=0) / np.diff(edges)[:, None]
    return np.concatenate([points[:1], means, points[-1:]])
