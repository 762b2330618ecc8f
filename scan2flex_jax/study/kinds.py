"""Every key and quantity of a study, declared once: name, unit, shape and domain. SI units; `s` is arc length from 0 to L.

`keys.json` lists the keys of every table of `study.toml`: how a value is checked, and its row in docs/study.md. The reader, the
records in memory, the writer and the page come from it. `TABLE` lists the effect types that an `[[effect]]` may declare. It is
generated from the package's effect classes (`effects.format`), so that a study is read without JAX; a user's effect is added
by `register_kind(KindFormat(...))`.
"""

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study import values as v
from scan2flex_jax.study.values import Where

Place = Literal["clamps", "energy", "observation"]
# fraction: 0 <= value <= 1. along_cable: 0 <= value <= L. unit: a vector of length one, normalised when read.
Domain = Literal["any", "positive", "nonnegative", "fraction", "along_cable", "unit"]
Memory = Literal["none", "order", "time"]
Schema = dict[str, Any]
ENDS = ("start", "end")
INITIAL = "initial_set"  # parameter of effects with memory: the state before the first pose
UNIT_TOLERANCE = 1e-3  # quaternions and normals this close to length one are normalised: the rounding of four written digits
MOST_TURNS = 1000
FEWEST_PLACES = 2  # of a field along the cable: with fewer it would not vary, and is an effect type of its own
DOMAINS: dict[str, tuple[Schema, str]] = {
    "positive": ({"exclusiveMinimum": 0}, "a value above zero"),
    "nonnegative": ({"minimum": 0}, "zero or a value above it"),
    "along_cable": ({"minimum": 0}, "zero or a value above it"),
    "fraction": ({"minimum": 0, "maximum": 1}, "a fraction, from 0 to 1"),
}
"""Bounds of the entries of a quantity, in the terms of JSON schema and in words."""


def _name(value: Any, where: Where) -> str:
    if not v.text(value, where).strip():
        raise where.fail("the name is empty: give the pose a name.")
    return str(value)


def _components(value: Any, where: Where) -> Any:
    """Three components, NaN for those that were not measured."""
    found = v.array(value, None, where)
    if np.shape(found) != (3,) or np.all(np.isnan(found)) or not np.all(np.isnan(found) | (np.abs(found) <= v.LARGEST)):
        raise where.fail(f"got {v.shown(v.plain(value))}: write three numbers, nan for a component that was not measured.")
    return found


_ROW: Schema = {"type": "array", "minItems": 3, "maxItems": 3, "items": {"type": "number"}}
TYPES: dict[str, tuple[Callable[[Any, Where], Any] | None, Schema]] = {
    "text": (v.text, {"type": "string"}),
    "name": (_name, {"type": "string", "minLength": 1}),
    "flag": (v.boolean, {"type": "boolean"}),
    "turns": (lambda value, where: v.integer(value, MOST_TURNS, where),
              {"type": "integer", "minimum": -MOST_TURNS, "maximum": MOST_TURNS}),
    "numbers": (lambda value, where: v.array(value, None, where), {}),
    "points": (lambda value, where: v.points(value, 1, where), {"type": "array", "minItems": 1, "items": _ROW}),
    "components": (_components, _ROW),
    "names": (None, {"type": "array", "minItems": 1, "uniqueItems": True, "items": {"type": "string"}}),
    "file": (None, {"type": "string", "minLength": 1}), "table": (None, {}), "tables": (None, {}),
}  # fmt: skip
"""Check and JSON schema of keys that are no quantities; None: the modules that know them check them."""


@dataclass(frozen=True)
class ParameterFormat:
    """One quantity: `unit` as text ("-" for none), `shape` of one value, `domain` of its entries.

    `pair`: two entries, about d1 and d2, may replace a scalar. `per_end`: one value for each clamped end, in the order start,
    end. `per_point`: one value for each point of a field, along the cable or over a strain. `estimable`: it may be listed under
    `[unknown]`. `walk`: for a positive field that begins at 1, the prior standard deviation at the last point of its logarithm,
    a random walk from point to point; 0: no prior of its own. `smooth`: for a field along the cable that is zero in its middle,
    the size of its prior as a smooth random field. `optional`: a study may leave it out, and it is then zero. A key of
    `study.toml` has another `type` or `choices` where it is no quantity, the `default` where it is left out, an `example`, and
    its meaning in `words`."""

    name: str
    unit: str
    shape: tuple[int, ...] = ()
    domain: Domain = "any"
    pair: bool = False
    per_end: bool = False
    per_point: bool = False
    estimable: bool = True
    walk: float = 0.0
    smooth: float = 0.0
    optional: bool = False
    type: str = "quantity"
    choices: tuple[str, ...] = ()
    default: str = ""
    example: str = ""
    words: str = ""

    @property
    def required(self) -> bool:
        """Whether its table always has it."""
        return self.default == "required" or self.default.startswith("required in a")

    @property
    def written(self) -> str:
        """Advice to write it, with the example as it stands in a file."""
        return f"it, as in {'' if self.example.lstrip('[').startswith(self.name) else f'{self.name} = '}{self.example}"

    def shapes(self, ends: int = 2, points: int = 0) -> tuple[tuple[int, ...], ...]:
        """The admissible shapes of a whole value, with `ends` clamps or `points` of a field; the plainest first."""
        if self.per_point or self.per_end:
            counts = (points,) if self.per_point else (2,) if ends >= 2 else (1, 2)
            return tuple((count, *self.shape) for count in counts)
        return (self.shape, (2,)) if self.pair else (self.shape,)

    def bound_shapes(self, ends: int = 2, points: int = 0) -> tuple[tuple[int, ...], ...]:
        """The shapes of a guess or of one end of a range: a whole value, or a scalar for all entries."""
        return tuple(dict.fromkeys(((), self.shape, *self.shapes(ends, points))))

    def take(self, value: Any, where: Where, ends: int = 2, longest: float | None = None, points: int = 0) -> Any:
        """The checked value in a study with `ends` clamps, or of a field on `points`; unit vectors are normalised.

        `longest` (m) is the largest place on the cable, None if unknown."""
        if self.choices:
            return v.one_of(value, self.choices, where)
        if self.type != "quantity":
            check = TYPES[self.type][0]
            return value if check is None else check(value, where)
        checked = v.array(value, self.shapes(ends, points), where)
        if self.domain != "unit":
            return self.check(checked, where, longest)
        if abs((size := float(np.linalg.norm(checked))) - 1) > UNIT_TOLERANCE:
            order = " [w, x, y, z]" if self.name == "quaternion" else ""
            raise where.fail(f"got {v.shown(v.plain(checked))} of length {size:.6g}: give a unit {self.name}{order}.")
        # a unit vector keeps its digits, so that saving and loading changes nothing
        return checked if abs(size - 1) < 4 * np.finfo(float).eps else np.asarray(checked) / size

    def check(self, value: Any, where: Where, longest: float | None = None) -> Any:
        """`value`, whose entries must lie in the domain."""
        bounds, words = DOMAINS.get(self.domain, ({}, ""))
        for entry in (float(np.min(value)), float(np.max(value))):
            within = bounds.get("minimum", -np.inf) <= entry <= bounds.get("maximum", np.inf)
            if not within or entry <= bounds.get("exclusiveMinimum", -np.inf):
                raise where.fail(f"got {entry:g}: give {words}.")
            if self.domain == "along_cable" and longest is not None and entry > longest:
                raise where.fail(f"got {entry:g} m: give a place on the cable, from 0 to {longest:g} m.")
        return value

    def schema(self, shapes: Iterable[tuple[int, ...]] | None = None) -> Schema:
        """The JSON schema of a value, of a quantity in one of the ``shapes``: a negative size is that of any field."""
        if self.choices:
            return {"enum": list(self.choices)}
        if self.type != "quantity":
            return TYPES[self.type][1]
        arrays = [self._array(shape) for shape in (self.shapes() if shapes is None else shapes)]
        return arrays[0] if len(arrays) == 1 else {"anyOf": arrays}

    def _array(self, shape: tuple[int, ...]) -> Schema:
        if not shape:
            return {"type": "number", **DOMAINS.get(self.domain, ({},))[0]}
        count = {"minItems": FEWEST_PLACES} if shape[0] < 0 else {"minItems": shape[0], "maxItems": shape[0]}
        return {"type": "array", "items": self._array(shape[1:]), **count}


@dataclass(frozen=True)
class KindFormat:
    """One effect type: where it acts, its parameters, and its description `words`.

    `memory`: whether poses depend on those before them, by their "order" alone or by the "time" of each."""

    kind: str
    place: Place
    parameters: tuple[ParameterFormat, ...]
    words: str
    memory: Memory = "none"

    def parameter(self, name: str) -> ParameterFormat:
        """The parameter of this name."""
        if name not in self.names:
            raise Scan2FlexError(f"The effect {self.kind} has no parameter {name!r}: it has {', '.join(self.names)}.")
        return self.parameters[self.names.index(name)]

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its parameters."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def position(self) -> str | None:
        """The name of the parameter that is its one place along the cable, if it has one."""
        return next((p.name for p in self.parameters if p.domain == "along_cable" and not p.per_point), None)

    @property
    def grid(self) -> ParameterFormat | None:
        """Of a field, the parameter that holds its points: places along the cable, or strains; None for other effect types."""
        return next((p for p in self.parameters if p.per_point and not p.estimable), None)

    def count(self, parameters: Mapping[str, Any], where: Where) -> int:
        """Number of points of a field; they increase."""
        if self.grid is None or self.grid.name not in parameters:
            return 0
        grid, here = parameters[self.grid.name], where.at(self.grid.name)
        if (count := int(np.size(grid))) < FEWEST_PLACES:
            raise here.fail(f"got {v.counted(count, 'point')}: give at least {FEWEST_PLACES}.")
        return len(v.growing(grid, count, here, f"number in {self.grid.unit}"))


def _formats(given: dict[str, dict]) -> tuple[ParameterFormat, ...]:
    lists = ("shape", "choices")
    return tuple(ParameterFormat(name, **said | {k: tuple(said.get(k, ())) for k in lists}) for name, said in given.items())


KEYS = {
    table: {key.name: key for key in _formats(given)}
    for table, given in json.loads((Path(__file__).parent / "keys.json").read_text("utf-8")).items()
}
"""The keys of each table of `study.toml`."""
CABLE = KEYS["cable"]
TOLERANCE = KEYS["tolerance"]
AXES, FRAMES = KEYS["angle"]["of"].choices, KEYS["wrench"]["frame"].choices

_KINDS: dict[str, KindFormat] = {}
TABLE = Path(__file__).parent / "kinds.json"  # effects of the package; `python -m scan2flex_jax.effects` writes it


def register_kind(kind: KindFormat) -> KindFormat:
    """Add an effect type to the table; the same one twice is no error, another one of the same name is."""
    if _KINDS.get(kind.kind, kind) != kind:
        raise Scan2FlexError(f"The effect kind {kind.kind!r} is taken: give the new kind another name.")
    _KINDS[kind.kind] = kind
    return kind


def kind_format(kind: str) -> KindFormat:
    """The format of an effect type."""
    if kind not in _KINDS:
        raise Scan2FlexError(f"No effect kind is called {kind!r}: the kinds are {', '.join(_KINDS)}.")
    return _KINDS[kind]


def split_name(name: str) -> tuple[str, int | None, str]:
    """``(kind, number, parameter)`` of the name of an unknown: ("", None, name) for a key of `[cable]`; the number is None for
    "kind.parameter", and counts the effects of one kind from 1 in "kind[number].parameter".

    Examples:
        >>> split_name("point_mass[2].mass")
        ('point_mass', 2, 'mass')
    """
    effect, _, parameter = name.rpartition(".")
    kind, bracket, number = effect.rstrip("]").partition("[")
    return kind, int(number) if bracket and effect.endswith("]") and number.isdecimal() else None, parameter


def kind_names() -> tuple[str, ...]:
    """The names of all effect types that a study may declare, in the order of registration."""
    return tuple(_KINDS)


for _kind, _said in json.loads(TABLE.read_text("utf-8")).items():
    register_kind(KindFormat(_kind, **_said | {"parameters": _formats(_said["parameters"])}))
