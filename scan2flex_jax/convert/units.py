"""Units of inputs from outside (a mass in g, a length in mm), read and checked by name: a study itself is in SI units."""

import math
import re

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study.tables import LENGTHS

_MASSES = {"kg": 1.0, "g": 1e-3, "lb": 0.45359237, "oz": 0.028349523125}
_DENSITIES = {f"{m}/{x}": a / b for m, a in _MASSES.items() for x, b in LENGTHS.items()}
_OF = {"length": LENGTHS, "mass": _MASSES, "length density": _DENSITIES}
_SI = {"length": "m", "mass": "kg", "length density": "kg/m"}
_QUANTITY = re.compile(r"\s*([-+]?[0-9]*[.,]?[0-9]+(?:[eE][-+]?[0-9]+)?)\s*([A-Za-z/]*)\s*")


def length_unit(name: str) -> float:
    """Metres in one unit of length, by its name; raises `Scan2FlexError`."""
    if name not in LENGTHS:
        raise Scan2FlexError(f"the unit {name[:20]!r} is not known: use one of {', '.join(LENGTHS)}.")
    return LENGTHS[name]


def measured(text: str, what: str) -> tuple[float, float]:
    """A quantity and its standard deviation, from text such as ``302 +- 1 g`` or ``0.9 ± 0.001``; 0 if none is given.

    A missing unit of one is that of the other. Raises `Scan2FlexError`.
    """
    value, mark, spread = text.replace("\u00b1", "+-").partition("+-")
    if not mark:
        return quantity(text, what), 0.0
    found, own = _QUANTITY.fullmatch(value), _QUANTITY.fullmatch(spread)
    first, second = (match[2] if match else "" for match in (found, own))
    with_unit = [text if unit else f"{text} {other}" for text, unit, other in ((value, first, second), (spread, second, first))]
    return quantity(with_unit[0], what), quantity(with_unit[1], what)


def quantity(text: str, what: str) -> float:
    """A positive quantity in SI units from text such as ``0.9``, ``900 mm`` or ``336 g/m``; a bare number is SI already.

    ``what``: "length" (m), "mass" (kg) or "length density" (kg/m). Raises `Scan2FlexError`.
    """
    units, found = _OF[what], _QUANTITY.fullmatch(text)
    unit = found and (found[2] or _SI[what])
    value = float(found[1].replace(",", ".")) * units[unit] if found and unit in units else math.nan
    if not (math.isfinite(value) and value > 0):
        some = ", ".join(list(units)[:6])
        raise Scan2FlexError(
            f"{text[:40]!r} is no {what}: write a positive number of {_SI[what]}, or one with a unit ({some})."
        )
    return value
