"""Conversion of untyped values, from a TOML file or a notebook, to checked numbers, arrays and texts.

Every function takes the value and its place `Where`, and raises one `StudyError` with the value found and the remedy. Numbers
may be Python's, NumPy's, JAX's or pandas'. A bool is never one, and NaN, infinity and numbers above `LARGEST` are refused.
"""

import difflib
import math
import reprlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from scan2flex_jax.errors import StudyError
from scan2flex_jax.names import printable

LARGEST = 1e15  # larger numbers are wrong in every unit of a study, and their squares and cubes would overflow float64
_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxlist, _SHORT.maxdict, _SHORT.maxstring, _SHORT.maxother = 2, 6, 3, 60, 60


@dataclass(frozen=True)
class Where:
    """A place in a study: the file in the user's notation, or the object, and the key in it (None: all of it)."""

    file: str
    key: str | None = None

    def at(self, name: str) -> "Where":
        """The place of a key below this one."""
        name = one_line(name)
        return Where(self.file, name if self.key is None else f"{self.key}.{name}")

    def item(self, label: object) -> "Where":
        """The place of one entry of an array of tables, as in pose[sag]."""
        return Where(self.file, f"{self.key}[{one_line(str(label))}]")

    def fail(self, sentence: str) -> StudyError:
        """The error to raise here."""
        return StudyError(self.file, self.key, sentence)

    @contextmanager
    def placed(self, names: Mapping[str, str | None] | None = None) -> Iterator[None]:
        """Re-raise errors of an object constructed inside as errors of this place, with its key below this one.

        ``names`` maps the last part of the object's key to its name in the file; None omits that part."""
        try:
            yield
        except StudyError as error:
            *above, last = (error.key or "").split(".")
            name = (names or {}).get(last, last)
            key = ".".join(part for part in (self.key, *above, name) if part)
            raise StudyError(self.file, key or None, error.sentence) from None


def one_line(text: str, longest: int = 80) -> str:
    """`text` for a message: no line breaks or control characters, not too long."""
    if len(text) <= longest and text.isprintable():
        return text
    text = printable(text[: longest + 1], keep="")
    return text if len(text) <= longest else text[: longest - 3] + "..."


def shown(value: Any) -> str:
    """A short, one-line representation of any value."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int) and abs(value) > LARGEST:
        return f"a whole number of {value.bit_length()} bits"
    return one_line(_SHORT.repr(value), 120)


def counted(number: int, noun: str) -> str:
    """A number with its noun, as in "1 point" and "2 points"."""
    return f"{number} {noun}{'s' * (number != 1)}"


def suggestion(name: str, names: Iterable[str]) -> str:
    """A hint for a name that is not among `names`: the nearest one, else all of them."""
    names = [one_line(known) for known in names]
    near = difflib.get_close_matches(name[:80], names, 1, 0.6)
    return f"did you mean {near[0]}?" if near else f"use one of {', '.join(names)}." if names else "leave it out."


def known(name: str, names: Iterable[str], where: Where, noun: str) -> None:
    """Refuse a name that is not among `names` of things called `noun`."""
    names = list(names)
    if name not in names:
        raise where.fail(f"no {noun} is called {shown(name)}: {suggestion(name, names)}")


def table(value: Any, names: Iterable[str] | None, where: Where, example: str) -> dict[str, Any]:
    """The contents of a table (a dict in memory) whose keys are among `names` (None: any)."""
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        what = "a dict" if example.startswith('{"') else "a table"
        raise where.fail(f"got {shown(value)}: give {what}, as in {example}.")
    keys = list(value if names is None else names)
    for key in value:
        if key not in keys:
            raise where.at(key).fail(f"unknown key {shown(key)}: {suggestion(key, keys)}")
    return dict(value)


def required(given: Mapping[str, Any], name: str, where: Where, example: str) -> Any:
    """The value of a required key."""
    if name not in given:
        raise where.at(name).fail(f"it is missing: write {example}.")
    return given[name]


def of_kind(value: Any, kind: type | tuple[type, ...], where: Where, example: str) -> Any:
    """`value`, which must be an instance of `kind`."""
    if not isinstance(value, kind):
        raise where.fail(f"got {shown(value)}: give {example}.")
    return value


def all_of_kind(values: Any, kind: type | tuple[type, ...], where: Where, example: str) -> tuple[Any, ...]:
    """Every entry of a list or tuple, each an instance of `kind`."""
    single = isinstance(values, str | Mapping) or not isinstance(values, Iterable) or getattr(values, "ndim", 1) == 0
    if single or isinstance(values, kind):
        raise where.fail(f"got {shown(values)}: give a list, as in [{example}].")
    return tuple(of_kind(entry, kind, where.item(i + 1), example) for i, entry in enumerate(values))


def text(value: Any, where: Where) -> str:
    """A string."""
    return str(of_kind(value, str, where, 'a text in quotation marks, as in "sag"'))


def one_of(value: Any, names: tuple[str, ...], where: Where) -> str:
    """One of some texts."""
    if text(value, where) not in names:
        first = ", ".join(f'"{name}"' for name in names[:-1])
        raise where.fail(f'got {shown(value)}: write {first} or "{names[-1]}".')
    return str(value)


def boolean(value: Any, where: Where) -> bool:
    """True or false."""
    return bool(of_kind(value, (bool, np.bool_), where, "true or false"))


def plain(value: Any) -> Any:
    """Scalars and arrays of NumPy, JAX or pandas as Python's numbers and lists; other values unchanged."""
    if isinstance(value, list | tuple):
        return [plain(entry) for entry in value]
    if not hasattr(value, "__array__"):
        return value
    try:
        return as_array(value).tolist()
    except (TypeError, ValueError):  # not really an array, such as a tracer of JAX
        return value


def as_array(value: Any) -> Annotated[np.ndarray, "..."]:
    """The array of an array-like; masked entries become NaN, which is refused later, and never their hidden values."""
    masked = isinstance(value, np.ma.MaskedArray)
    return np.where(np.ma.getmaskarray(value), np.nan, value.data) if masked else np.asarray(value)


def integer(value: Any, largest: int, where: Where) -> int:
    """A whole number of magnitude at most `largest`."""
    value = plain(value)
    if isinstance(value, bool) or not isinstance(value, int):
        raise where.fail(f"got {shown(value)}: write a whole number, as in 0 or -1.")
    if abs(value) > largest:
        raise where.fail(f"got {shown(value)}: write a whole number between {-largest} and {largest}.")
    return value


def number(value: Any, where: Where) -> float:
    """A finite real number."""
    value = plain(value)
    if isinstance(value, str):
        raise where.fail(f"got the text {shown(value)}: write a number without quotation marks.")
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise where.fail(f"got {shown(value)}: write a number.")
    if isinstance(value, float) and not math.isfinite(value):
        raise where.fail(f"got {value}: write a finite number.")
    if abs(value) > LARGEST:
        raise where.fail(f"got {shown(value)}: write a number below {LARGEST:g} in SI units.")
    return float(value)


def _wanted(shape: tuple[int, ...]) -> str:
    lists = [counted(shape[0], "list")] if len(shape) > 1 else []
    return "one number" if not shape else f"a list of {' of '.join([*lists, counted(shape[-1], 'number')])}"


def array(value: Any, shapes: Iterable[tuple[int, ...]] | None, where: Where) -> float | Annotated[np.ndarray, "..."]:
    """A number, or nested lists of numbers, of one of `shapes`; a float for shape (). With None any shape will do, and NaN."""
    value = plain(value)
    wanted = None if shapes is None else tuple(shapes)
    try:
        shape = np.shape(value) if isinstance(value, list) else ()
    except (TypeError, ValueError):  # ragged lists, tracers of JAX
        shape = (0,)
    if 0 in shape or (wanted is not None and shape not in wanted):
        said = "a number, or a list of numbers" if wanted is None else " or ".join(map(_wanted, wanted))
        raise where.fail(f"got {shown(value)}: write {said}.")
    entries = np.array(value, object).ravel().tolist()
    numbers = [x if wanted is None and isinstance(x, float) else number(x, where) for x in entries]
    return np.array(numbers).reshape(shape) if shape else numbers[0]


def points(value: Any, fewest: int, where: Where, partial: bool = False) -> Annotated[np.ndarray, "n 3"]:
    """At least `fewest` points, one per row: all finite, and no two neighbours equal.

    With ``partial``, a coordinate that is NaN in every row was not measured, and neighbours may share the others."""
    rows = _rows(value, where, "points in metres, one row [x, y, z] for each: an array of shape (n, 3)")
    if rows.ndim != 2 or rows.shape[1] != 3:
        turned = rows.ndim == 2 and rows.shape[0] == 3
        advice = "transpose it, so that each row is a point" if turned else "give one row [x, y, z] for each point"
        raise where.fail(f"got {shown(value) if isinstance(value, list) else f'an array of shape {rows.shape}'}: {advice}.")
    if len(rows) < fewest:
        raise where.fail(f"got {counted(len(rows), 'point')}: give at least {fewest}.")
    unseen = np.all(np.isnan(rows), axis=0) & partial
    unseen = unseen & ~np.all(unseen)
    bad = np.flatnonzero(~np.all((np.abs(rows) <= LARGEST) | unseen, axis=1))
    if len(bad):
        raise where.fail(f"point {int(bad[0]) + 1} is {shown(rows[bad[0]].tolist())}: give finite numbers in metres.")
    same = np.flatnonzero(np.all(rows[1:] == rows[:-1], axis=1))  # never with NaN
    if len(same):
        i = int(same[0])
        raise where.fail(f"points {i + 1} and {i + 2} are the same, {shown(rows[i].tolist())}: leave one out.")
    return rows


def growing(value: Any, count: int, where: Where, what: str = "arc length in metres") -> Annotated[np.ndarray, " n"]:
    """Strictly increasing finite numbers, one for each of `count` points; `what` each of them is."""
    grid = _rows(value, where, f"one {what} for each point: an array of shape ({count},)")
    if grid.shape != (count,):
        raise where.fail(f"got an array of shape {grid.shape}: give one {what} for each of the {count} points.")
    if not np.all(np.abs(grid) <= LARGEST):
        raise where.fail(f"a number is not finite: give one {what} for every point.")
    back = np.flatnonzero(np.diff(grid) <= 0)
    if len(back):
        i = int(back[0])
        said = f"it does not grow from point {i + 1} ({grid[i]:g}) to point {i + 2} ({grid[i + 1]:g})"
        raise where.fail(f"{said}: order the points from start to end.")
    return grid


def _rows(value: Any, where: Where, wanted: str) -> Annotated[np.ndarray, "..."]:
    try:
        rows = as_array(value)
    except (TypeError, ValueError) as error:  # ragged lists, tracers of JAX
        raise where.fail(f"got {shown(value)}: give {wanted}.") from error
    flags = isinstance(value, list) and any(isinstance(x, bool) for row in value if isinstance(row, list) for x in row)
    if rows.dtype.kind not in "iuf" or flags:
        what = shown(value) if rows.ndim == 0 else f"an array of {rows.dtype}"
        raise where.fail(f"got {what}: give {wanted}.")
    return rows.astype(np.float64, copy=False)
