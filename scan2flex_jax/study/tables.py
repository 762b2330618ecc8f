"""Rows of numbers in text files of other programs: the one place that detects how a table is written.

A `Dialect` is the separator, the decimal mark, the first row, the meaning of the columns and the unit of lengths, as the first
lines of a file show them. Centre curves, markers and guide points (`convert.curves`) and scans (`study.scans`) are read by it.
"""

import itertools
import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Annotated, NamedTuple

import numpy as np

from scan2flex_jax.study.values import Where, shown

LENGTHS = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 1e-3, "um": 1e-6, "in": 0.0254, "ft": 0.3048}  # metres
SAMPLE = 300  # lines that determine the dialect
_MARKS = ((";", "."), (";", ","), ("\t", "."), ("\t", ","), (",", "."), (None, "."), (None, ","))  # separator, decimal mark
_PREAMBLE = 60  # most lines before the first row
_COMMENT = ("#", "//")
_SEPARATED = {";": "by semicolons", "\t": "by tabs", ",": "by commas", None: "by blanks"}
_NAMES = {"s": "s", "arclength": "s", "arc": "s", "curvilinearabscissa": "s", "abscissa": "s",
          "points0": "x", "points1": "y", "points2": "z"}  # fmt: skip
_COORDINATE = re.compile(
    r"(?:pos|position|p|point|points|coord|coordinate|centre|center)?([xyz])(?:pos|position|coord|coordinate)?"
)
_UNIT = re.compile(r"(.*?)[\s_]*[\[(\s_]\s*([a-z]+)\s*[\])]?\s*")
_DRESS = re.compile(r"[{}()\[\]]|(?<![\w.])[xyz]\s*[=:]?\s+(?=[-+.\d])", re.IGNORECASE)  # {1, 2, 3} and X 1 Y 2 Z 3
_MEASURED = re.compile(r"(?<=[\d.])\s?(mm|cm|dm|um|m|in|ft)\b")  # 48.350mm
_GROUPED = {",": re.compile(r"[-+]?\d{1,3}(\.\d{3})+,\d*"), ".": re.compile(r"[-+]?\d{1,3}(,\d{3})+\.\d*")}


class Dialect(NamedTuple):
    """How a table is written; ``first``: index of its first row; ``names``: of each column "x", "y", "z", "s", or None for
    another; None without a header; ``texts``: columns of labels; ``unit``: None where none is stated."""

    mark: str | None
    decimal: str
    first: int
    width: int
    texts: frozenset[int] = frozenset()
    names: tuple[str | None, ...] | None = None
    unit: str | None = None

    def __str__(self) -> str:
        commas = ", with decimal commas" if self.decimal == "," else ""
        return f"separated {_SEPARATED[self.mark]}{commas}"

    def cells(self, line: str) -> list[float | None]:
        """The numbers of a line: NaN for an empty cell, None for text."""
        return _stripped(_cells(line, self.mark, self.decimal), self.width)


def dialect(lines: list[str], where: Where, fewest: int = 3) -> Dialect:
    """The dialect under which the most of these lines (not blank) are rows of three numbers, or of ``fewest``, or more."""
    found: list[tuple[int, int, Dialect]] = []
    for mark, decimal in _MARKS:
        rows = [_stripped(_cells(line, mark, decimal)) for line in lines[:SAMPLE]]
        if full := [i for i, row in enumerate(rows) if _numbers(row) >= fewest]:
            texts = frozenset(k for k, x in enumerate(rows[full[0]]) if x is None)
            how = Dialect(mark, decimal, full[0], len(rows[full[0]]), texts)
            found.append((len(full), -sum(rows[i].count(None) for i in full), how))
    if not found or (how := max(found, key=lambda one: one[:2])[2]).first > _PREAMBLE:
        raise where.fail("no line holds three numbers or more: give a text file with one point x,y,z a line.")
    first = how.first
    while first and len(row := how.cells(lines[first - 1])) == how.width > 1 and None not in row and not _numbers(row):
        first -= 1  # a row that has lost its numbers
    units = {match[1].lower() for line in lines[first : first + 3] for match in _MEASURED.finditer(line)}
    stated = units.pop() if len(units) == 1 else None
    header = _header(lines, first, how)
    names, unit = (None, None) if header is None else _named(header, where)
    return how._replace(first=first, names=names, unit=unit or stated)


def placed(names: Sequence[str | None], where: Where) -> list[int]:
    """The columns of x, y and z, which a header must name."""
    if lost := [c for c in "xyz" if c not in names]:
        raise where.at("header").fail(f"it names no {', '.join(lost)}: say what the columns are, as in s,x,y,z or -,x,y,z.")
    return [names.index(c) for c in "xyz"]


def counts_rows(column: Sequence[float | None] | Annotated[np.ndarray, " n"]) -> bool:
    """Whether numbers count their rows: from 0 or 1, by 1; five at least, since coordinates may begin so."""
    numbers = np.array(column, float)
    return len(numbers) > 4 and numbers[0] in (0.0, 1.0) and bool(np.all(np.diff(numbers) == 1.0))


def rows(lines: Iterable[str], how: Dialect, where: Where) -> Annotated[np.ndarray, "n c"]:
    """All rows of these lines, of which the first is the first row; NaN for labels and empty cells.

    A row of another width, or with text where a number stood, is an error that names the point by its number."""
    table = []
    for i, line in enumerate(lines):
        row = how.cells(line)
        if len(row) != how.width or any(x is None and k not in how.texts for k, x in enumerate(row)):
            here = where.at(f"point {i + 1}")
            raise here.fail(f"got {shown(line.strip())}: write {how.width} numbers, as on the line of the first point.")
        table.append([np.nan if x is None else x for x in row])
    return np.array(table, float)


def scanned(lines: Callable[[], Iterator[str]], where: Where) -> tuple[Annotated[np.ndarray, "n 3"], str | None]:
    """Points of a scan, and the unit that it states, from which they are converted to m.

    They are the columns x, y, z of its header, else the first three after the number of the row. ``lines`` begins to read the
    file, as often as it is called."""
    sample = list(itertools.islice(_filled(lines()), SAMPLE))
    how = dialect(sample, where)
    plain = [k for k in range(how.width) if k not in how.texts]
    first = [row[plain[0]] for row in map(how.cells, sample[how.first :]) if len(row) == how.width]
    at = plain[: 3 + counts_rows(first)] if how.names is None else placed(how.names, where)

    def body() -> Iterator[str]:
        kept = itertools.islice(_filled(lines()), how.first, None)
        return (line for line in kept if line[0] not in "#/" or not line.startswith(_COMMENT))

    plainly = (line.replace(",", ".") for line in body()) if how.decimal == "," else body()
    try:
        points = np.loadtxt(plainly, np.float64, delimiter=how.mark, usecols=at, comments=None, ndmin=2)
    except ValueError:  # labels, thousands, empty or quoted cells: slower
        points = rows(body(), how, where)[:, at]
    if how.names is None and counts_rows(points[:, 0]):
        points = points[:, 1:]
        if points.shape[1] < 3:
            raise where.fail("two columns follow the numbers of its rows, and a scan has x, y and z: export all three.")
    return points[:, :3] * LENGTHS[how.unit or "m"], how.unit


def _filled(lines: Iterable[str]) -> Iterator[str]:
    """Lines that are not blank, without the blanks around them; a tab in front is an empty cell."""
    return filter(None, (line.strip(" \r\n") for line in lines))


def _numbers(row: list[float | None]) -> int:
    return sum(x is not None and not math.isnan(x) for x in row)


def _number(cell: str, decimal: str) -> float | None:
    cell = cell.strip().strip('"').strip()
    if not cell:
        return np.nan
    if _GROUPED[decimal].fullmatch(cell):
        cell = cell.replace("." if decimal == "," else ",", "")
    elif decimal == "," and "." in cell:
        return None
    try:
        return float(cell.replace(",", ".") if decimal == "," else cell)
    except ValueError:
        return None


def _cells(line: str, mark: str | None, decimal: str) -> list[float | None]:
    """The cells of a line; one of several with three numbers between blanks is three cells."""
    if any(c.isdigit() for c in line):
        line = _MEASURED.sub(" ", _DRESS.sub(" ", line))
    row: list[float | None] = []
    cells = line.strip("\r\n").split(mark)
    for cell in cells:
        value, parts = _number(cell, decimal), cell.split()
        three = [_number(part, decimal) for part in parts] if value is None and len(parts) == 3 and len(cells) > 1 else [None]
        row += [value] if None in three else three
    return row


def _stripped(row: list[float | None], width: int = 0) -> list[float | None]:
    """A row without empty cells at its end, as far as it is wider than ``width``."""
    end = len(row)
    while end > width and (last := row[end - 1]) is not None and math.isnan(last):
        end -= 1
    return row[:end]


def _header(lines: list[str], first: int, how: Dialect) -> list[str] | None:
    """The cells of the line before the first row, if they are names, one of each column; one of three columns is x, y, z."""
    if first == 0:
        return None
    names = [c.strip().strip('"') for c in lines[first - 1].lstrip("#/% ").strip("\r\n").split(how.mark)]
    wide = [len(cell.split()) == 3 for cell in lines[first].strip("\r\n").split(how.mark)]
    if len(names) == len(wide):
        named = [name for cell, three in zip(names, wide, strict=True) for name in (list("xyz") if three else [cell])]
        names = named[: how.width]
    named = [name for name in names if name]  # the number of the row may have none
    return names if len(names) == how.width and named and all(_number(name, ".") is None for name in named) else None


def _named(header: list[str], where: Where) -> tuple[tuple[str | None, ...], str | None]:
    """The meaning of each column of a header, and the unit that it states."""
    names: list[str | None] = []
    units = set()
    for cell in header:
        stated = _UNIT.fullmatch(cell.lower())
        base, unit = (stated[1], stated[2]) if stated and stated[1] and stated[2] in LENGTHS else (cell.lower(), None)
        plain = re.sub(r"[^a-z0-9]", "", base)
        coordinate = _COORDINATE.fullmatch(plain)
        name = _NAMES.get(plain) or (coordinate and coordinate[1])
        names.append(name if name not in names else None)
        units |= {unit} if names[-1] and unit else set()
    if len(units) > 1:
        raise where.at("header").fail(f"it states several units ({', '.join(sorted(units))}): convert the columns to one.")
    return tuple(names), next(iter(units), None)
