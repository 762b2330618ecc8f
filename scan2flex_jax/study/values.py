"""Conversion of untyped values, from a TOML file or a notebook, to checked numbers, arrays and texts.

Every function takes the value and its place `Where`, and raises one `StudyError` with the value found and the
remedy. Numbers may be Python's, NumPy's, JAX's or pandas'. A bool is never a number, and NaN, infinity and numbers
above `LARGEST` are refused.
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
from scan2flex_jax.study.kinds import Domain, ParameterFormat

LARGEST = 1e15
"""Larger numbers are wrong in every unit of a study, and their squares and cubes would overflow float64."""
UNIT_TOLERANCE = 1e-3
"""Quaternions and normals this close to length one are normalised: the rounding of four written digits."""

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

        ``names`` maps the last part of the object's key to its name in the file; None omits that part.
        """
        try:
            yield
        except StudyError as error:
            *above, last = (error.key or "").rpartition(".")
            name = (names or {}).get(last, last)
            below = "".join(above) + name if name else above[0]
            key = ".".join(part for part in (self.key, below) if part)
            raise StudyError(self.file, key or None, error.sentence) from None


def one_line(text: str, longest: int = 80) -> str:
    """`text` for a message: no line breaks or control characters, not too long."""
    if len(text) <= longest and text.isprintable():
        return text
    text = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text[: longest + 1])
    return text if len(text) <= longest else text[: longest - 3] + "..."


def shown(value: Any) -> str:
    """A short, one-line representation of any value."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, int) and abs(value) > LARGEST:
        return f"a whole number of {value.bit_length()} bits"
    return one_line(_SHORT.repr(value), 120)


def suggestion(name: str, names: Iterable[str]) -> str:
    """A hint for a name that is not among `names`: the nearest one, else all of them."""
    names = [one_line(known) for known in names]
    near = difflib.get_close_matches(name[:80], names, 1, 0.6)
    return f"did you mean {near[0]}?" if near else f"use one of {', '.join(names)}." if names else "leave it out."


def allow(table: dict[str, Any], names: Iterable[str], where: Where) -> None:
    """Refuse the first key of `table` that is not among `names`."""
    names = list(names)
    for key in table:
        if key not in names:
            raise where.at(key).fail(f"unknown key {shown(key)}: {suggestion(key, names)}")


def required(table: dict[str, Any], name: str, where: Where, example: str) -> Any:
    """The value of a required key."""
    if name not in table:
        raise where.at(name).fail(f"it is missing: write {example}.")
    return table[name]


def text(value: Any, where: Where) -> str:
    """A string."""
    if not isinstance(value, str):
        raise where.fail(f'got {shown(value)}: write a text in quotation marks, as in "sag".')
    return str(value)


def boolean(value: Any, where: Where) -> bool:
    """True or false."""
    if not isinstance(value, bool | np.bool_):
        raise where.fail(f"got {shown(value)}: write true or false.")
    return bool(value)


def pose_name(value: Any, where: Where) -> str:
    """The name of a pose, which is not blank."""
    if not text(value, where).strip():
        raise where.fail("the name is empty: give the pose a name.")
    return str(value)


def sub_table(value: Any, where: Where, example: str) -> dict[str, Any]:
    """A table."""
    if not isinstance(value, dict):
        raise where.fail(f"got {shown(value)}: write a table, as in {example}.")
    return value


def tables(value: Any, where: Where) -> list[dict[str, Any]]:
    """An array of tables."""
    if not isinstance(value, list) or not all(isinstance(entry, dict) for entry in value):
        raise where.fail(f"got {shown(value)}: write each one as a table that begins with [[{where.key}]].")
    return value


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
    if isinstance(value, np.ma.MaskedArray):
        value = np.where(np.ma.getmaskarray(value), np.nan, value.data)
    return np.asarray(value)


def integer(value: Any, where: Where, largest: int) -> int:
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


def _shape(value: Any, depth: int = 3) -> tuple[int, ...] | None:
    """Shape of nested lists; None if they are ragged or deeper than any value of a study."""
    if not isinstance(value, list):
        return ()
    inner = {_shape(entry, depth - 1) for entry in value} if depth > 0 else set()
    if len(inner) != 1 or None in inner:
        return None
    return (len(value), *(inner.pop() or ()))


def _numbers(value: Any, where: Where) -> Any:
    return [_numbers(entry, where) for entry in value] if isinstance(value, list) else number(value, where)


def _wanted(shape: tuple[int, ...]) -> str:
    if not shape:
        return "one number"
    if len(shape) == 1:
        return f"a list of {shape[0]} number{'s' if shape[0] > 1 else ''}"
    return f"a list of {shape[0]} list{'s' if shape[0] > 1 else ''} of {shape[1]} numbers"


def array(value: Any, shapes: Iterable[tuple[int, ...]], where: Where) -> float | Annotated[np.ndarray, "..."]:
    """A number, or nested lists of numbers, of one of `shapes`; a float for shape ()."""
    value, shapes = plain(value), tuple(shapes)
    if _shape(value) not in shapes:
        raise where.fail(f"got {shown(value)}: write {' or '.join(map(_wanted, shapes))}.")
    found = _numbers(value, where)
    return found if isinstance(found, float) else np.array(found)


def any_array(value: Any, where: Where) -> float | Annotated[np.ndarray, "..."]:
    """A number, or an array of numbers of any shape; their domain is checked later."""
    value = plain(value)
    if _shape(value) is None:
        raise where.fail(f"got {shown(value)}: write a number, or a list of numbers.")
    found = _real(value, where)
    return found if isinstance(found, float) else np.array(found)


def _real(value: Any, where: Where) -> Any:
    """Real numbers, including infinities and NaN."""
    if isinstance(value, list):
        return [_real(entry, where) for entry in value]
    return float(value) if isinstance(value, float) else number(value, where)


def vector(value: Any, size: int, where: Where) -> Annotated[np.ndarray, " n"]:
    """A vector of `size` numbers."""
    return np.asarray(array(value, [(size,)], where))


def rows(value: Any, where: Where) -> Annotated[np.ndarray, "n 3"]:
    """A list of at least one point [x, y, z]."""
    value = plain(value)
    count = len(value) if isinstance(value, list) else 0
    if count == 0:
        raise where.fail(f"got {shown(value)}: write a list of points, as in [[0.5, -1.0, 0.3]].")
    return np.asarray(array(value, [(count, 3)], where))


def unit(value: Annotated[np.ndarray, " n"], where: Where, name: str) -> Annotated[np.ndarray, " n"]:
    """The vector normalised to unit length, if it is within `UNIT_TOLERANCE` of it."""
    length = float(np.linalg.norm(value))
    if abs(length - 1) > UNIT_TOLERANCE:
        raise where.fail(f"got {shown(value.tolist())} of length {length:.6g}: give a unit {name}.")
    # A unit vector keeps its digits, so that saving and loading changes nothing.
    return value if abs(length - 1) < 4 * np.finfo(float).eps else value / length


def check_domain(value: Any, domain: Domain, where: Where, longest: float | None = None) -> None:
    """Refuse entries outside a domain; `longest` (m) is the largest place on the cable, None if unknown."""
    lowest = float(np.min(value))
    if domain == "positive" and lowest <= 0:
        raise where.fail(f"got {lowest:g}: give a value above zero.")
    if domain in ("nonnegative", "along_cable") and lowest < 0:
        raise where.fail(f"got {lowest:g}: give zero or a value above it.")
    if domain == "fraction" and not 0 <= lowest <= float(np.max(value)) <= 1:
        raise where.fail(f"got {lowest if lowest < 0 else float(np.max(value)):g}: give a fraction, from 0 to 1.")
    if domain == "along_cable" and longest is not None and float(np.max(value)) > longest:
        raise where.fail(f"got {float(np.max(value)):g} m: give a place on the cable, from 0 to {longest:g} m.")


def quantity(
    value: Any, form: ParameterFormat, where: Where, ends: int = 2, longest: float | None = None, points: int = 0
) -> float | Annotated[np.ndarray, "..."]:
    """The value of a declared quantity in a study with `ends` clamps, or of a field on `points`."""
    result = array(value, form.shapes(ends, points), where)
    if form.domain == "unit":
        return unit(np.asarray(result), where, "vector")
    check_domain(result, form.domain, where, longest)
    return result
