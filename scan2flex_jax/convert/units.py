"""Units of inputs from outside (a mass in g, a length in mm), read and checked by name: a study itself is in SI units.

Densities are a mass or a weight per length, as catalogues print them: kg/km, lb/1000ft, tex, N/m. A weight becomes a mass by
standard gravity.
"""

import math
import re
from itertools import pairwise

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study.tables import LENGTHS

G = 9.80665
"""Standard gravity (m/s^2), exactly: what a catalogue's weight is divided by, whatever gravity the study has."""
_POUND = 0.45359237
_LONG = {**LENGTHS, "\u00b5m": 1e-6, "km": 1e3, "yd": 0.9144, "kft": 304.8, "Mft": 304.8, "'": 0.3048, '"': 0.0254}
_LONG |= dict.fromkeys(("metre", "metres", "meter", "meters"), 1.0) | dict.fromkeys(("foot", "feet"), 0.3048)
_LONG |= dict.fromkeys(("inch", "inches"), 0.0254)
_WEIGHTS = {"N": 1 / G, "kN": 1e3 / G, "mN": 1e-3 / G, "gf": 1e-3, "kgf": 1.0, "kp": 1.0, "lbf": _POUND}
_MASSES = {"kg": 1.0, "g": 1e-3, "mg": 1e-6, "t": 1e3, "lb": _POUND, "lbs": _POUND, "oz": _POUND / 16, **_WEIGHTS}
_MASSES |= dict.fromkeys(("gram", "grams"), 1e-3) | dict.fromkeys(("kilogram", "kilograms"), 1.0)
_MASSES |= dict.fromkeys(("pound", "pounds"), _POUND) | dict.fromkeys(("ounce", "ounces"), _POUND / 16)
_YARN = {"tex": 1e-6, "dtex": 1e-7, "ktex": 1e-3, "den": 1e-6 / 9, "denier": 1e-6 / 9}  # g/km, and g per 9 km
_ANGLES = {"deg": math.pi / 180, "\u00b0": math.pi / 180, "mrad": 1e-3, "rad": 1.0}
UNITS = {"length": ("mm", "cm", "in", "m"), "mass": ("g", "lb", "N", "kg"), "force": ("mN", "g", "N"), "angle": ("deg", "rad")}
"""Usual units of a quantity; the last one is that of a bare number."""
_SI = {"length": "m", "mass": "kg", "length density": "kg/m"}
_SOME = {"length": "mm, cm, in, ft", "mass": "g, lb, oz, N", "length density": "g/m, kg/km, lb/ft, lb/1000ft, tex, N/m"}
NUMBER = r"[-+]?[0-9]*[.,]?[0-9]+(?:[eE][-+]?[0-9]+)?"
_PART = re.compile(rf"\s*({NUMBER})\s*((?:[A-Za-z\u00b5'\"]+(?:\s*/\s*[0-9]*\s*[A-Za-z]+)?)?)\s*")
_GROUPED = re.compile(r"[-+]?[1-9][0-9]{0,2},[0-9]{3}")  # 1,200 is 1200 in one country, 1.2 in another
_PER = re.compile(r"\s*([1-9][0-9]{0,5})?\s*([A-Za-z\u00b5]+)")
_MARK = re.compile(r"\+\s*/?\s*[-\u2212]|\u00b1")


def unit_of_quantity(name: str, what: str) -> float:
    """SI units in one unit of a length, a mass, a force or an angle, by its name, empty for that of a table; raises
    `Scan2FlexError`. A weight in newtons is a mass by standard gravity, and a mass a force by it."""
    known = {
        "length": _LONG, "mass": _MASSES, "angle": _ANGLES,
        "force": {unit: kg * G for unit, kg in _MASSES.items()},
    }[what]  # fmt: skip
    if not name:
        name = UNITS[what][-1]
    if name not in known:
        raise Scan2FlexError(f"the unit {name[:20]!r} is none of a {what}: use one of {', '.join(UNITS[what])}.")
    return known[name]


def length_unit(name: str) -> float:
    """Metres in one unit of length, by its name; raises `Scan2FlexError`."""
    if name not in LENGTHS:
        raise Scan2FlexError(f"the unit {name[:20]!r} is not known: use one of {', '.join(LENGTHS)}.")
    return LENGTHS[name]


def measured(text: str, what: str) -> tuple[float, float]:
    """A quantity and its standard deviation, from text such as ``302 +- 1 g``, ``336 g/m +/- 2 g/m`` or ``0.9 ± 1 %``.

    Without one it is 0; a missing unit of one is that of the other. Raises `Scan2FlexError`.
    """
    value, *more = _MARK.split(text)
    if not more:
        return quantity(text, what), 0.0
    spread = more[0].strip() if len(more) == 1 else text
    first, second = _stated(value), _stated(spread)
    found = _read(value if first else f"{value} {second}", text, what)
    if spread.endswith("%"):
        return found, 0.01 * found * _read(spread[:-1], text, what)
    return found, _read(spread if second else f"{spread} {first}", text, what)


def quantity(text: str, what: str) -> float:
    """A positive quantity in SI units from text such as ``0.9``, ``3 ft 3 in`` or ``36 kg/km``; a bare number is SI already.

    ``what``: "length" (m), "mass" (kg) or "length density" (kg/m). Raises `Scan2FlexError`.
    """
    return _read(text, text, what)


def is_weight(text: str) -> bool:
    """Whether a mass or a density is stated as a force in newtons, which `quantity` divides by `G`."""
    return _stated(text).partition("/")[0].strip() in ("N", "kN", "mN")


def _stated(text: str) -> str:
    """The last unit in a text, empty without one."""
    return next((found[2] for found in reversed(list(_PART.finditer(text))) if found[2]), "")


def decimal(number: str, shown: str) -> float:
    """The value of a `NUMBER`, whose decimals may begin with a comma; an error shows the text in which it stands."""
    if _GROUPED.fullmatch(number):
        both = f"{number.replace(',', '')} or {number.replace(',', '.')}"
        raise Scan2FlexError(f"{shown[:40]!r} may be {both}: write the one that is meant.")
    return float(number.replace(",", "."))


def _read(text: str, shown: str, what: str) -> float:
    """The sum of the parts of a quantity, each smaller than the one before; errors show the whole of the text."""
    parts, at = list[float](), 0
    while at < len(text) and (found := _PART.match(text, at)):
        alone = found.span() == (0, len(text))
        parts.append(decimal(found[1], shown) * _unit(found[2] or alone * _SI[what], what))
        at = found.end()
    total = sum(parts) if at == len(text) and all(a > b for a, b in pairwise(parts)) else math.nan
    if not (math.isfinite(total) and min(parts, default=0.0) > 0):
        raise Scan2FlexError(
            f"{shown[:40]!r} is no {what}: write a positive number of {_SI[what]}, or one with a unit ({_SOME[what]})."
        )
    return total


def _unit(name: str, what: str) -> float:
    """The SI value of a unit as it is written, or in lower case; NaN if it is none of this quantity."""
    for spelt in (name, name.lower())[: 1 if name.startswith("Mg") else 2]:
        mass, slash, along = spelt.partition("/")
        per = _PER.fullmatch(along)
        if what != "length density":
            found = (_LONG if what == "length" else _MASSES).get(spelt)
        elif slash and per and mass.strip() in _MASSES and per[2] in _LONG:
            found = _MASSES[mass.strip()] / (float(per[1] or 1) * _LONG[per[2]])
        else:
            found = _YARN.get(spelt)
        if found is not None:
            return found
    return math.nan
