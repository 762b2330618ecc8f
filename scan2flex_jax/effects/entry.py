"""What an effect type defines to enter the catalogue: its entry, in amplitudes that vanish when the effect is absent.

An entry maps amplitudes to effects such that zero is *exactly* the baseline model and the derivative of the shape
there is the effect's first-order signature; effect types whose own parameters have no such zero (a ratio, an infinite
spring stiffness, a place) are reparametrised. Parameters without a derivative at the null (location, width, threshold) form a
*site*, one of a list of candidates to scan. ``size`` is the prior standard deviation of each amplitude, from the scales of
the cable in `Context`: it makes the evidence of different effect types comparable, so every size is written with its
reason.

A new effect type is a class with the hooks that it needs (`rod.effect`) and an ``ENTRY`` at the end of its file, with at least
the fields of `CatalogueEntry` that have no default; `catalogue` lists the entries.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from dataclasses import field as default
from functools import partial
from typing import Any, cast

import jax.numpy as jnp
import numpy as np
from jax import Array

from scan2flex_jax.effects.format import format_of, parameters_of
from scan2flex_jax.rod.effect import AbstractEffect
from scan2flex_jax.study.kinds import ENDS, INITIAL, KindFormat

Site = dict[str, Any]
Range = Callable[["Context"], tuple[float, float]]  # smallest and largest value
_EDGE = 0.01  # of the length: smallest distance of a place from a clamp


@dataclass(frozen=True)
class Context:
    """Scales for sizes and candidate locations: the cable of the baseline model and the range of its shapes.

    ``length`` m, stiffnesses N m^2, ``axial_stiffness`` N, ``weight`` N/m (mass per length times |g|), ``gravity``
    m/s^2, ``curvature_range`` 1/m (smallest and largest of the poses' largest curvatures), ``lowest_range`` m (lowest
    and highest of the poses' lowest points, along gravity), ``points`` m (all measured ones), ``radius`` m,
    ``centre`` m (middle of the scanned shapes), ``previous`` 1/m (curvature of the previous pose, for `memory_set`; it differs
    from pose to pose), ``free_end`` whether the end hangs free in some pose.
    """

    length: float
    bending_stiffness: float
    torsional_stiffness: float
    weight: float
    gravity: np.ndarray
    curvature_range: tuple[float, float]
    lowest_range: tuple[float, float] = (-1.0, 0.0)
    radius: float | None = None
    axial_stiffness: float = 1.0e5
    centre: np.ndarray = default(default_factory=lambda: np.zeros(3))
    points: np.ndarray = default(default_factory=lambda: np.zeros((0, 3)))
    clamped_ends: Sequence[str] = ENDS
    previous: Any = default(default_factory=lambda: np.zeros((2, 3)))
    free_end: bool = False

    @property
    def radius_or_guess(self) -> float:
        """The radius (m), or half a per cent of the length if none was given."""
        return 0.005 * self.length if self.radius is None else self.radius

    @property
    def mass_per_length(self) -> float:
        """Mass per length (kg/m); needs gravity."""
        return self.weight / max(float(np.linalg.norm(self.gravity)), 1e-12)

    @property
    def up(self) -> np.ndarray:
        """Unit vector against gravity; +z without gravity."""
        size = float(np.linalg.norm(self.gravity))
        return -np.asarray(self.gravity) / size if size > 0 else np.array([0.0, 0.0, 1.0])

    @property
    def lowest(self) -> np.ndarray:
        """The lowest measured point (m)."""
        if len(self.points):
            return self.points[np.argmin(self.points @ self.up)]
        return self.centre + (self.lowest_range[0] - self.centre @ self.up) * self.up

    @property
    def force(self) -> float:
        """Force (N) that shapes the cable: its weight; without weight, the force that bends it through a radian."""
        return max(self.weight * self.length, 10.0 * self.bending_stiffness / self.length**2)


@dataclass(frozen=True)
class SameShapes:
    """An alternative with the same shapes: the ``other`` effect type, or an input of the study that may be in error
    (``gravity``); ``when``: the condition, or the part of the effect for which it holds ``always``, in every pose."""

    other: str
    when: str
    always: bool = False

    @property
    def words(self) -> str:
        """The condition in words."""
        return f"{self.when}, always" if self.always else self.when


def _one_site(context: Context) -> tuple[Site, ...]:
    return ({},)


def _as_scanned(site: Site, noise: float) -> Site:
    return site


def _not_rescaled(amplitude: Any, site: Site, context: Context) -> dict[str, float]:
    return {}


def _all_there(context: Context) -> Site:
    return {}


def _like_nothing(effects: Any, stiffness: Any, site: Site) -> None:
    return None


def _no_other_starts(amplitude: Any, site: Site, context: Context, places: Any) -> list:
    return []


def _of_parameters(amplitudes: Array, site: Site, _context: Any, effect: Any = AbstractEffect) -> tuple[AbstractEffect, ...]:
    """The ``effect`` with the parameters that a site has, and the amplitudes as the one that is left; zero at absent ends."""
    given = {f.name: site[f.name] for f in fields(effect) if f.name in site}
    (left,) = (f.name for f in fields(effect) if f.name not in site and f.default is MISSING)
    value = jnp.where(jnp.repeat(site["ends"], len(amplitudes) // 2) > 0, amplitudes, 0.0) if "ends" in site else amplitudes
    shape = cast(KindFormat, format_of(effect)).parameter(left).shapes(len(ENDS))[0]
    return (effect(**given, **{left: value.reshape(shape)}),)


@dataclass(frozen=True)
class CatalogueEntry:
    """One effect type as a candidate of the search: the class of the ``effect``, and the settings of `explain` for it.

    ``sites(context)`` lists the candidate locations (one empty site if there is no choice; an entry ``position`` is an arc
    length, an entry ``width`` the length of a span, both in m), ``size(context)`` the standard deviation of each amplitude,
    ``bounds(context)`` their smallest and largest values, ``one_sided`` the mask of non-negative ones. ``build(amplitudes,
    site, context)`` makes the effects: by default the class with the parameters that the site has, and with the amplitudes as
    its one other parameter without a default. If an effect is not linear in its own parameters, or its null depends on the
    cable, ``build`` makes another class of the same file that is linear and has no ``kind``: studies cannot declare it. Its
    method ``reported(context)`` gives the parameters of the effect type that it stands for, and ``rescaled`` the factors by
    which parameters of the cable itself differ beside these.

    For refits: ``moving`` names the continuous entries of a site, each with its range; ``start_site(site, noise)`` gives
    their start, for a standard deviation ``noise`` (m) of the measured points; ``inactive_of(site)`` marks the inactive
    amplitudes. With a ``continuation`` the amplitudes are not estimated but set to these multiples of their sizes, one
    after the other, so that a stiff law (contact) is approached from a soft one. ``other_starts(amplitude, site, context,
    places)`` lists further starts after a refit that ended there, given the points ``places`` (m, one per pose) of the
    cable at the site: amplitude, site, and factors on parameters of the cable. ``like(effects, stiffness, site)`` gives the
    amplitudes of a law that is as stiff at each strain as the energy laws ``effects`` on sections of that ``stiffness`` (6, 6).
    ``rest(context)``: neutral values of entries that only some sites have.

    For verdicts: ``same_shapes`` lists alternatives with the same shapes. A ``field`` has an arbitrary form: along the cable it
    is a description and no cause; one that is ``late``, a law over the strain, is tried after all others, where they leave a
    discrepancy or have its shapes. One that ``varies`` has an arbitrary form too, and is a cause like any: the stiffness along
    a cable. An effect type that is not ``searched`` has to be declared.
    ``signature``: a description of its residual. ``settle``: the measurement that would resolve a tie.
    """

    effect: type[AbstractEffect]
    amplitudes: tuple[str, ...]
    size: Callable[[Context], np.ndarray]
    signature: str
    settle: str
    build: Callable[[Array, Site, Context], tuple[AbstractEffect, ...]] = _of_parameters
    sites: Callable[[Context], tuple[Site, ...]] = _one_site
    one_sided: tuple[bool, ...] = ()
    bounds_of: Callable[[Context], tuple[np.ndarray, np.ndarray]] | None = None
    moving: Mapping[str, Range] = default(default_factory=dict)
    start_site: Callable[[Site, float], Site] = _as_scanned
    inactive_of: Callable[[Site], np.ndarray] | None = None
    continuation: tuple[float, ...] = ()
    same_shapes: tuple[SameShapes, ...] = ()
    field: bool = False
    late: bool = False
    varies: bool = False
    searched: bool = True
    rescaled: Callable[[Any, Site, Context], dict[str, float]] = _not_rescaled
    like: Callable[[Any, Any, Site], np.ndarray | None] = _like_nothing
    other_starts: Callable[[Any, Site, Context, Any], list] = _no_other_starts
    rest: Callable[[Context], Site] = _all_there

    def __post_init__(self) -> None:
        """Two-sided by default, and built from its parameters."""
        object.__setattr__(self, "one_sided", self.one_sided or (False,) * len(self.amplitudes))
        if self.build is _of_parameters:
            object.__setattr__(self, "build", partial(_of_parameters, effect=self.effect))

    @property
    def kind(self) -> str:
        """Name of the effect type in studies and results."""
        return self.effect.kind

    @property
    def null(self) -> np.ndarray:
        """Amplitudes of the baseline model."""
        return np.zeros(len(self.amplitudes))

    def parameters(self, amplitudes: Any, site: Site, context: Context) -> dict[str, Any]:
        """The format's parameters of the effect with these amplitudes at a site."""
        effect = self.build(jnp.asarray(amplitudes, float), site, context)[0]
        return parameters_of(effect, context.clamped_ends, self.effect, context)

    def bounds(self, context: Context) -> tuple[np.ndarray, np.ndarray]:
        """Smallest and largest amplitudes; by default twenty sizes, and zero as the lower bound of a one-sided one."""
        if self.bounds_of is not None:
            return self.bounds_of(context)
        most = 20.0 * self.size(context)
        return np.where(self.one_sided, 0.0, -most), most

    def inactive(self, site: Site) -> np.ndarray:
        """Mask of the amplitudes that are inactive at a site."""
        none = np.zeros(len(self.amplitudes), bool)
        return none if self.inactive_of is None else np.asarray(self.inactive_of(site), bool)

    def continued(self, step: int, context: Context) -> np.ndarray:
        """Amplitudes at one step of the ``continuation``, of the last one beyond it; within the bounds."""
        factor = self.continuation[min(step, len(self.continuation) - 1)]
        return np.minimum(factor * self.size(context), self.bounds(context)[1])


def entry_of_memory(
    effect: Any, at: str, value: Callable[[Context], float], *, share: float, none: Any, **words: Any
) -> CatalogueEntry:
    """The entry of an effect with memory: its ``share`` of usual size as amplitude, and as site its threshold or time ``at``,
    with a ``value`` to begin from, and the initial set, ``none`` without one.

    It relates poses, so the search, which treats them one by one, does not try it (`inference.variants` does).
    """
    return CatalogueEntry(
        effect, ("share",), lambda c: np.array([share]),
        build=lambda a, site, c: (effect(a[0], jnp.asarray(site[at]), jnp.asarray(site[INITIAL])),),
        sites=lambda c: ({at: value(c), INITIAL: none},),
        one_sided=(True,), bounds_of=lambda c: (np.zeros(1), np.ones(1)), searched=False, **words,
    )  # fmt: skip


def positions(context: Context, count: int = 19) -> np.ndarray:
    """Places (m) along the cable to scan, excluding the clamps."""
    return context.length * np.linspace(0.05, 0.95, count)


def along_cable(context: Context) -> tuple[float, float]:
    """Range of a place (m) that moves along the cable, excluding the clamps."""
    return _EDGE * context.length, (1 - _EDGE) * context.length


def loaded_places(context: Context) -> np.ndarray:
    """Candidate places (m) of a load: `positions`, and the tip of a free end."""
    places = positions(context)
    return np.append(places, context.length) if context.free_end else places


def along_loaded(context: Context) -> tuple[float, float]:
    """Range of the place (m) of a load, up to the tip of a free end."""
    low, high = along_cable(context)
    return low, context.length if context.free_end else high
