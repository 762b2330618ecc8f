"""The catalogue entry of a kind: the effect as amplitudes that are zero when it is absent.

An entry turns amplitudes into effects such that zero is *exactly* the base model and the derivative of the shape
there is the effect's first-order signature; kinds whose own parameters have no such zero (a ratio, a spring at
infinity, a place) are written in others that do. What has no first-order signature of its own (places, widths, knees)
is a *site*: one of a list to scan. ``size`` is one physical standard deviation of each amplitude, from the scales of
the cable in `Context`: it makes the evidence of different kinds comparable, so every size is written with its reason.
Each kind's file ends in its ``ENTRY``; `catalogue` lists them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from dataclasses import field as default
from typing import Any, Literal

import numpy as np
from jax import Array

from scan2flex_jax.rod.effect import AbstractEffect
from scan2flex_jax.study.kinds import ENDS

Site = dict[str, Any]
Varied = Literal["stiffness", "mass"]  # properties of the cable that may vary along it
Range = Callable[["Context"], tuple[float, float]]  # least and largest value
_EDGE = 0.01  # of the length: no place closer to a clamp


@dataclass(frozen=True)
class Context:
    """What sizes and sites depend on: the cable of the base model and the range of its shapes.

    ``length`` m, stiffnesses N m^2, ``axial_stiffness`` N, ``weight`` N/m (mass per length times |g|), ``gravity``
    m/s^2, ``curvature_range`` 1/m (smallest and largest of the poses' largest curvatures), ``lowest_range`` m (lowest
    and highest of the poses' lowest points, measured against gravity), ``points`` m (all measured ones), ``radius`` m,
    ``centre`` m (middle of the scanned shapes), ``previous`` 1/m (curvature of the pose before, for `memory_set`; it differs
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
        """The radius (m), or half a percent of the length where it was not given."""
        return 0.005 * self.length if self.radius is None else self.radius

    @property
    def mass_per_length(self) -> float:
        """kg/m; needs gravity."""
        return self.weight / max(float(np.linalg.norm(self.gravity)), 1e-12)

    @property
    def up(self) -> np.ndarray:
        """Unit vector against gravity; +z where there is none."""
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
        """The forces (N) that shape the cable: its weight, or what bends it through a radian where it has none."""
        return max(self.weight * self.length, 10.0 * self.bending_stiffness / self.length**2)


@dataclass(frozen=True)
class SameShapes:
    """What gives the same shapes as a kind: the ``other`` kind, or an input of the study (``gravity``) that may be in error;
    ``when``: the condition, or the part of the effect for which it holds ``always``, in every pose."""

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


def _no_other_starts(amplitude: Any, site: Site, context: Context, places: Any) -> list:
    return []


@dataclass(frozen=True)
class CatalogueEntry:
    """One kind, ready to be scanned for: the class of the ``effect``, and how `explain` looks for it.

    ``build(amplitude, site, context)`` makes the effects, ``sites(context)`` lists where to look (one empty site when
    there is no choice; a part ``position`` is an arc length, a part ``width`` the length of a span, both in m),
    ``size(context)`` the standard deviation of each amplitude, ``bounds(context)`` their least and largest values,
    ``one_sided`` which of them cannot be negative. ``to_parameters`` and ``from_parameters`` change to the format's
    parameters and back; ``rescaled`` says by which factor a parameter of the cable itself changes in that exchange. Where a
    kind is not linear in its own parameters, or its null depends on the cable, ``build`` makes another class of the same file
    that is linear and has no ``kind``: studies cannot declare it, and results report it as the kind that it represents.

    For refits: ``moving`` names the parts of a site that are continuous, each with its range; ``start_site(site, noise)`` is
    where they begin, given the standard deviation (m) of the measured points; ``inactive_of(site)`` says which amplitudes do
    nothing there. With a ``continuation`` the amplitudes are not estimated but set to these multiples of their sizes, one
    after the other: a stiff law (contact) is met softly first. ``other_starts(amplitude, site, context, places)`` lists more
    starts for a refit that ended there, with the cable at ``places`` (m, one per pose) at its position: amplitude, site, and
    factors on parameters of the cable.

    For verdicts: ``same_shapes`` are what shapes alone cannot tell from it; ``varies`` is the property of the cable that it
    makes vary along s: several effects of one property are pieces of a field, which describes it and names nothing.
    A ``field`` takes any form along the cable: it is not scanned for like the other kinds, and named only where it predicts
    poses that it never saw. ``signature``: what it looks like. ``settle``: the measurement that would settle a tie.
    """

    effect: type[AbstractEffect]
    amplitudes: tuple[str, ...]
    size: Callable[[Context], np.ndarray]
    build: Callable[[Array, Site, Context], tuple[AbstractEffect, ...]]
    to_parameters: Callable[[Any, Site, Context], dict[str, Any]]
    from_parameters: Callable[[dict[str, Any], Context], tuple[np.ndarray, Site]]
    signature: str
    settle: str
    sites: Callable[[Context], tuple[Site, ...]] = _one_site
    one_sided: tuple[bool, ...] = ()
    bounds_of: Callable[[Context], tuple[np.ndarray, np.ndarray]] | None = None
    moving: Mapping[str, Range] = default(default_factory=dict)
    start_site: Callable[[Site, float], Site] = _as_scanned
    inactive_of: Callable[[Site], np.ndarray] | None = None
    continuation: tuple[float, ...] = ()
    same_shapes: tuple[SameShapes, ...] = ()
    varies: Varied | None = None
    field: bool = False
    rescaled: Callable[[Any, Site, Context], dict[str, float]] = _not_rescaled
    other_starts: Callable[[Any, Site, Context, Any], list] = _no_other_starts

    def __post_init__(self) -> None:
        """Two-sided unless it is said otherwise."""
        object.__setattr__(self, "one_sided", self.one_sided or (False,) * len(self.amplitudes))

    @property
    def kind(self) -> str:
        """The name of the kind, in studies and results."""
        return self.effect.kind

    @property
    def null(self) -> np.ndarray:
        """The amplitudes of the base model."""
        return np.zeros(len(self.amplitudes))

    def bounds(self, context: Context) -> tuple[np.ndarray, np.ndarray]:
        """Least and largest amplitudes; where nothing else is said, twenty sizes, and zero for a one-sided one."""
        if self.bounds_of is not None:
            return self.bounds_of(context)
        most = 20.0 * self.size(context)
        return np.where(self.one_sided, 0.0, -most), most

    def inactive(self, site: Site) -> np.ndarray:
        """Which amplitudes do nothing at a site."""
        none = np.zeros(len(self.amplitudes), bool)
        return none if self.inactive_of is None else np.asarray(self.inactive_of(site), bool)

    def continued(self, step: int, context: Context) -> np.ndarray:
        """Amplitudes of one step of the ``continuation``, of the last one beyond it; no bound is passed."""
        factor = self.continuation[min(step, len(self.continuation) - 1)]
        return np.minimum(factor * self.size(context), self.bounds(context)[1])


def positions(context: Context, count: int = 19) -> np.ndarray:
    """Places (m) along the cable to scan, without the clamps themselves."""
    return context.length * np.linspace(0.05, 0.95, count)


def along_cable(context: Context) -> tuple[float, float]:
    """The range of a place (m) that moves along the cable, without the clamps themselves."""
    return _EDGE * context.length, (1 - _EDGE) * context.length


def loaded_places(context: Context) -> np.ndarray:
    """Places (m) where a load is looked for: `positions`, and the very tip of a free end."""
    places = positions(context)
    return np.append(places, context.length) if context.free_end else places


def along_loaded(context: Context) -> tuple[float, float]:
    """The range of the place (m) of a load: up to the very tip of a free end."""
    low, high = along_cable(context)
    return low, context.length if context.free_end else high
