"""Every quantity of a study, declared once: name, unit, shape and domain.

`CABLE` lists the keys of `[cable]`, `TOLERANCE` those of `[tolerance]`, and the table of effect types the effects that an
`[[effect]]` may declare. An effect acts on the clamps, on the energy of the rod, or on the observation of the shape.
The reader checks a study against these tables, and reports take names and units from them.

The package's effect classes define their own formats (`effects.format`). They are read here from `TABLE`, which is generated
from the classes, so that a study is read without JAX. A user's effect is added by `register_kind(KindFormat(...))`.
SI units; `s` is arc length from 0 to L.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from scan2flex_jax.errors import Scan2FlexError

Place = Literal["clamps", "energy", "observation"]
# fraction: 0 <= value <= 1. along_cable: 0 <= value <= L. unit: a vector of length one, normalised when read.
Domain = Literal["any", "positive", "nonnegative", "fraction", "along_cable", "unit"]
Memory = Literal["none", "order", "time"]
ENDS = ("start", "end")
INITIAL = "initial_set"
"""Parameter of effects with memory: the state before the first pose."""


@dataclass(frozen=True)
class ParameterFormat:
    """One quantity: `unit` as text ("-" for none), `shape` of one value, `domain` of its entries.

    `pair`: two entries, about d1 and d2, may replace a scalar. `per_end`: one value of `shape` for each clamped end, in the
    order start, end. `per_point`: one value of `shape` for each point of a field, along the cable or over a strain.
    `estimable`: it may be listed under `[unknown]`. `walk`: for a positive field that begins at 1, the prior standard deviation
    of its logarithm at the last point; from point to point that logarithm is a random walk. 0: no prior of its own.
    `optional`: a study may leave it out, and it is then zero.
    """

    name: str
    unit: str
    shape: tuple[int, ...] = ()
    domain: Domain = "any"
    pair: bool = False
    per_end: bool = False
    per_point: bool = False
    estimable: bool = True
    walk: float = 0.0
    optional: bool = False

    def shapes(self, ends: int = 2, points: int = 0) -> tuple[tuple[int, ...], ...]:
        """The admissible shapes of a whole value, with `ends` clamps or `points` of a field; the plainest first."""
        if self.per_point:
            return ((points, *self.shape),)
        if self.per_end:
            counts = (2,) if ends >= 2 else (1, 2)
            return tuple((count, *self.shape) for count in counts)
        return (self.shape, (2,)) if self.pair else (self.shape,)

    def bound_shapes(self, ends: int = 2, points: int = 0) -> tuple[tuple[int, ...], ...]:
        """The shapes of a guess or of one end of a range: a whole value, or a scalar for all entries."""
        return tuple(dict.fromkeys(((), self.shape, *self.shapes(ends, points))))


@dataclass(frozen=True)
class KindFormat:
    """One effect type: where it acts, its parameters, and its description `words`.

    `memory`: whether poses depend on those before them, by their "order" alone or by the "time" of each.
    """

    kind: str
    place: Place
    parameters: tuple[ParameterFormat, ...]
    words: str
    memory: Memory = "none"

    def parameter(self, name: str) -> ParameterFormat:
        """The parameter of this name."""
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        raise Scan2FlexError(f"The effect {self.kind} has no parameter {name!r}: it has {', '.join(self.names)}.")

    @property
    def names(self) -> tuple[str, ...]:
        """The names of its parameters."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def grid(self) -> ParameterFormat | None:
        """Of a field, the parameter that holds its points: places along the cable, or strains; None for other effect types."""
        return next((p for p in self.parameters if p.per_point and not p.estimable), None)


def _by_name(*formats: ParameterFormat) -> dict[str, ParameterFormat]:
    return {parameter.name: parameter for parameter in formats}


CABLE = _by_name(
    ParameterFormat("length", "m", domain="positive"),
    ParameterFormat("radius", "m", domain="positive", estimable=False),
    ParameterFormat("length_density", "kg/m", domain="positive"),
    ParameterFormat("shear_stiffness", "N", domain="positive", pair=True),
    ParameterFormat("axial_stiffness", "N", domain="positive"),
    ParameterFormat("bending_stiffness", "N m^2", domain="positive", pair=True),
    ParameterFormat("torsional_stiffness", "N m^2", domain="positive"),
    ParameterFormat("natural_curvature", "1/m", (3,)),
    ParameterFormat("natural_stretch", "-", (3,)),
)

TOLERANCE = _by_name(
    ParameterFormat("length", "m", domain="nonnegative"),
    ParameterFormat("clamp_position", "m", domain="nonnegative"),
    ParameterFormat("clamp_rotation", "rad", domain="nonnegative"),
    ParameterFormat("clamp_roll", "rad", domain="nonnegative"),
    ParameterFormat("gravity", "rad", domain="nonnegative"),
    ParameterFormat("length_density", "kg/m", domain="nonnegative"),
)

_KINDS: dict[str, KindFormat] = {}


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


TABLE = Path(__file__).parent / "kinds.json"  # effects of the package; `python -m scan2flex_jax.effects` writes it


def _read(kind: str, said: dict) -> KindFormat:
    parameters = [
        ParameterFormat(name, **{**given, "shape": tuple(given.get("shape", ()))}) for name, given in said["parameters"].items()
    ]
    return KindFormat(kind, said["place"], tuple(parameters), said["words"], said.get("memory", "none"))


for _kind, _said in json.loads(TABLE.read_text("utf-8")).items():
    register_kind(_read(_kind, _said))

DESCRIPTIVE_KINDS = tuple(k for k, form in _KINDS.items() if form.grid is not None and form.grid.domain == "along_cable")
"""Fields along the cable: possible answers when no other effect type explains the shapes. They can be declared like any."""
