"""The table of a bending test: a row a pose. Columns have a unit in their header, as in ``weight (g)``, or cells their own."""

import csv
import re
from collections.abc import Sequence
from pathlib import Path

from scan2flex_jax.convert.bench import TESTS, Row
from scan2flex_jax.convert.units import NUMBER, UNITS, decimal, unit_of_quantity
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study.files import CSV_LIMIT, read_text
from scan2flex_jax.study.values import Where, suggestion

_NAMED = re.compile(r"(.*?)[\s_]*[\[(]?\s*([A-Za-z\u00b0\u00b5]*)\s*[\])]?")
_NUMBER = re.compile(rf"({NUMBER})\s*([A-Za-z\u00b0\u00b5]*)")
_INSTEAD = {"droop": "deflection", "force": "weight"}  # columns that may stand in place of another


def read_table(path: Path, test: str) -> tuple[list[Row], list[str]]:
    """Rows (SI units) and their names of the table of a test; raises `StudyError` with the file and the line."""
    where = Where(path.name)
    lines = read_text(path, CSV_LIMIT, where, "the file is not there: name the table of the test.").splitlines()
    lines = [line for line in lines if line.strip() and not line.lstrip().startswith("#")]
    if len(lines) < 2:
        raise where.fail("it has no row below its header: write one for each reading.")
    mark = max(";\t,", key=lines[0].count)
    if mark == ";":  # where cells end with a semicolon, decimals begin with a comma
        lines = [re.sub(r"(?<=[0-9]),(?=[0-9])", ".", line) for line in lines]
    header, *rows = list(csv.reader(lines, delimiter=mark))
    return table_of(header, rows, test, where)


def table_of(header: Sequence[str], rows: Sequence[Sequence[str]], test: str, where: Where) -> tuple[list[Row], list[str]]:
    """Rows (SI units) and their names, from texts with their units."""
    if test not in TESTS:
        raise Scan2FlexError(f"no test is called {test[:40]!r}: {suggestion(test, TESTS)}")
    form = TESTS[test]
    known = form.columns | form.optional
    columns = [_column(cell, known, where) for cell in header]
    names = [name for name, _ in columns]
    for name in form.columns:
        if name not in names and not (name in _INSTEAD and _INSTEAD[name] in names):
            other = f" or {_INSTEAD[name]}" if name in _INSTEAD else ""
            raise where.at("header").fail(f"the column {name}{other} is missing: the test {test} has {', '.join(known)}.")
    out, called = list[Row](), list[str]()
    for i, cells in enumerate(rows, 1):
        here = where.at(f"row {i}")
        if len(cells) != len(header):
            raise here.fail(f"got {len(cells)} cells: write {len(header)}, one for each column.")
        row = {name: _value(cell, unit, known[name], here.at(name)) for (name, unit), cell in zip(columns, cells, strict=True)
               if name != "name"}  # fmt: skip
        out.append(row)
        label = cells[names.index("name")].strip() if "name" in names else f"row-{i}"
        if not label or label in called:
            raise here.at("name").fail(f"got {label!r}, which is empty or there already: give each row its own.")
        called.append(label)
    return out, called


def _column(cell: str, known: dict[str, str], where: Where) -> tuple[str, str]:
    """The name and the unit of a column."""
    plain = cell.strip().strip('"').lower()
    if plain in (*known, "name"):
        return plain, ""
    found = _NAMED.fullmatch(cell.strip().strip('"'))
    name = found[1].strip().lower() if found else plain
    if found is None or name not in known:
        raise where.at("header").fail(f"the column {cell.strip()[:40]!r} is not known: {suggestion(name, known)}")
    unit_of_quantity(found[2], known[name])
    return name, found[2]


def _value(cell: str, unit: str, what: str, where: Where) -> float:
    """A value in SI units: a number in the unit of its column, or with its own."""
    found = _NUMBER.fullmatch(cell.strip().strip('"'))
    if found is None:
        raise where.fail(f"got {cell.strip()[:40]!r}: write a number, as in 12.5 or '12.5 {UNITS[what][0]}'.")
    try:
        value = decimal(found[1], cell.strip())
    except Scan2FlexError as error:
        raise where.fail(str(error)) from None
    return value * unit_of_quantity(found[2] or unit or UNITS[what][-1], what)
