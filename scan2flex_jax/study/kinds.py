"""Every quantity that a study can hold, declared once: name, unit, shape and the values it may take.

`CABLE` lists the keys of `[cable]`, `TOLERANCE` those of `[tolerance]`, and the table of kinds the effects that an
`[[effect]]` may declare. An effect acts on the clamps, on the energy of the rod, or on the observation of the shape.
The reader checks a study against these tables, and reports take names and units from them.

A later effect adds itself with `register_kind(KindFormat(...))`. SI units; `s` is arc length from 0 to L.
"""

from dataclasses import dataclass
from typing import Any, Literal

from scan2flex_jax.errors import Scan2FlexError

Place = Literal["clamps", "energy", "observation"]
# along_cable: 0 <= value <= L. unit: a vector of length one, normalised when read.
Domain = Literal["any", "positive", "nonnegative", "along_cable", "unit"]
ENDS = ("start", "end")


@dataclass(frozen=True)
class ParameterFormat:
    """One quantity: `unit` as text ("-" for none), `shape` of one value, `domain` of its entries.

    `pair`: two entries, about d1 and d2, may stand in place of a scalar. `per_end`: one value of `shape` for each end
    that has a clamp, in the order start, end. `per_point`: one value of `shape` for each point of a field along the cable.
    `estimable`: it may stand under `[unknown]`.
    """

    name: str
    unit: str
    shape: tuple[int, ...] = ()
    domain: Domain = "any"
    pair: bool = False
    per_end: bool = False
    per_point: bool = False
    estimable: bool = True

    def shapes(self, ends: int = 2, points: int = 0) -> tuple[tuple[int, ...], ...]:
        """The shapes that a whole value may have, with `ends` clamps or `points` of a field; the plainest first."""
        if self.per_point:
            return ((points, *self.shape),)
        if self.per_end:
            counts = (2,) if ends >= 2 else (1, 2)
            return tuple((count, *self.shape) for count in counts)
        return (self.shape, (2,)) if self.pair else (self.shape,)

    def bound_shapes(self, ends: int = 2, points: int = 0) -> tuple[tuple[int, ...], ...]:
        """The shapes of a guess or of one end of a range: a whole value, or a scalar for every entry alike."""
        return tuple(dict.fromkeys(((), self.shape, *self.shapes(ends, points))))


@dataclass(frozen=True)
class KindFormat:
    """One kind of effect: where it acts, its parameters, and `words` that say what it is."""

    kind: str
    place: Place
    parameters: tuple[ParameterFormat, ...]
    words: str

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

DESCRIPTIVE_KINDS = ("distributed_load", "curvature_profile")
"""Fields along the cable: what the package may answer when no kind explains the shapes. They can be declared like any kind."""

_KINDS: dict[str, KindFormat] = {}


def register_kind(kind: KindFormat) -> KindFormat:
    """Add a kind to the table; the same kind twice is no fault, another one of the same name is."""
    if _KINDS.get(kind.kind, kind) != kind:
        raise Scan2FlexError(f"The effect kind {kind.kind!r} is taken: give the new kind another name.")
    _KINDS[kind.kind] = kind
    return kind


def kind_format(kind: str) -> KindFormat:
    """The format of a declared or found kind."""
    if kind not in _KINDS:
        raise Scan2FlexError(f"No effect kind is called {kind!r}: the kinds are {', '.join(_KINDS)}.")
    return _KINDS[kind]


def kind_names() -> tuple[str, ...]:
    """The names of all kinds that a study may declare, in the order in which they were registered."""
    return tuple(_KINDS)


_POSITION = ParameterFormat("position", "m", domain="along_cable")
_WIDTH = ParameterFormat("width", "m", domain="positive")
_FACTOR = ParameterFormat("factor", "-", domain="positive")

_TABLE: tuple[tuple[Any, ...], ...] = (
    ("natural_curvature", "energy", "the cable is bent at rest, alike along s",
     ParameterFormat("curvature", "1/m", (3,))),
    ("kink", "energy", "a set bend, local in s", _POSITION, ParameterFormat("angle", "rad", (3,)),
     ParameterFormat("width", "m", domain="nonnegative")),
    ("anisotropic_bending", "energy", "bending stiffness differs between two axes of the cross section",
     ParameterFormat("ratio", "-", domain="positive"), ParameterFormat("angle", "rad")),
    ("bend_twist_coupling", "energy", "bending and twist are coupled", ParameterFormat("coupling", "-", (2,))),
    ("nonlinear_bending", "energy", "bending softens beyond a curvature of slip",
     ParameterFormat("slip_curvature", "1/m", domain="positive"), ParameterFormat("ratio", "-", domain="nonnegative")),
    ("stiffness_profile", "energy", "a span is stiffer or softer", _POSITION, _WIDTH, _FACTOR),
    ("extensibility", "energy", "the cable stretches", ParameterFormat("axial_stiffness", "N", domain="positive")),
    ("point_mass", "energy", "a mass hangs on the cable", _POSITION,
     ParameterFormat("mass", "kg", domain="nonnegative")),
    ("density_profile", "energy", "a span is heavier or lighter", _POSITION, _WIDTH, _FACTOR),
    ("uniform_load", "energy", "a dead load along the whole cable", ParameterFormat("force", "N/m", (3,))),
    ("point_load", "energy", "a dead force at one place", _POSITION, ParameterFormat("force", "N", (3,))),
    ("tether", "energy", "a string or spring from a fixed point", _POSITION, ParameterFormat("anchor", "m", (3,)),
     ParameterFormat("stiffness", "N/m", domain="positive"),
     ParameterFormat("rest_length", "m", domain="nonnegative")),
    ("support_plane", "energy", "the cable rests on a plane", ParameterFormat("normal", "-", (3,), domain="unit"),
     ParameterFormat("offset", "m")),
    ("elastic_clamp", "clamps", "a grip yields in rotation",
     ParameterFormat("stiffness", "N m/rad", domain="positive", per_end=True)),
    ("clamp_rotation", "clamps", "a clamp is turned from where it is said to be",
     ParameterFormat("rotation", "rad", (3,), per_end=True)),
    ("clamp_offset", "clamps", "a clamp is shifted from where it is said to be",
     ParameterFormat("offset", "m", (3,), per_end=True)),
    ("length_error", "clamps", "the length between the clamps is not the nominal one",
     ParameterFormat("length", "m", domain="positive")),
    ("scan_scale", "observation", "every measured coordinate is off by one factor", _FACTOR),
    ("scan_offset", "observation", "measured shapes are shifted", ParameterFormat("offset", "m", (3,))),
)
_PLACES = ParameterFormat("s", "m", domain="along_cable", per_point=True, estimable=False)
_TABLE += (
    ("distributed_load", "energy", "a dead load that varies along the cable", _PLACES,
     ParameterFormat("force", "N/m", (3,), per_point=True)),
    ("curvature_profile", "energy", "the cable is bent at rest, differently along s", _PLACES,
     ParameterFormat("curvature", "1/m", (3,), per_point=True)),
)
for _kind, _place, _words, *_parameters in _TABLE:
    register_kind(KindFormat(_kind, _place, tuple(_parameters), _words))

for _format in (  # real cables show these too; the format's table does not have them
    KindFormat("stiffness_taper", "energy", (ParameterFormat("taper", "-"),), "stiffness grows from start to end"),
    KindFormat("density_taper", "energy", (ParameterFormat("taper", "-"),), "mass per length grows from start to end"),
    KindFormat("tension_twist_coupling", "energy", (ParameterFormat("lever", "m"),), "tension twists the cable"),
    KindFormat("tension_stiffening", "energy", (ParameterFormat("gain", "m^2"),), "bending stiffens under tension"),
    KindFormat(
        "elastic_support",
        "energy",
        (
            ParameterFormat("normal", "-", (3,), domain="unit"),
            ParameterFormat("offset", "m"),
            ParameterFormat("stiffness", "N/m^2", domain="nonnegative"),
        ),
        "a soft bed holds the cable on both sides of a plane",
    ),
):
    register_kind(_format)
