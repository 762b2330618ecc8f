"""All effects of the package, in one list: whatever is known of a kind follows from its class and its entry in it.

A new kind of the package is a file beside the others, its format in `study.kinds`, and a line here; one's own kind is added
by `add_kind`.
"""

from scan2flex_jax.effects import (
    anisotropic_bending,
    bend_twist_coupling,
    clamp_offset,
    clamp_rotation,
    curvature_profile,
    density_profile,
    density_taper,
    distributed_load,
    elastic_clamp,
    elastic_support,
    extensibility,
    kink,
    length_error,
    memory_set,
    natural_curvature,
    nonlinear_bending,
    point_load,
    point_mass,
    scan_offset,
    scan_scale,
    stiffness_profile,
    stiffness_taper,
    support_plane,
    tension_stiffening,
    tension_twist_coupling,
    tether,
    uniform_load,
)
from scan2flex_jax.effects._registry import register_effect
from scan2flex_jax.effects.entry import CatalogueEntry, Context, SameShapes, along_cable, positions
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.rod.effect import AbstractEffect
from scan2flex_jax.study.kinds import KindFormat, register_kind

# The order decides between kinds that fit equally well.
EFFECTS: tuple[tuple[type[AbstractEffect], CatalogueEntry | None], ...] = (
    (natural_curvature.NaturalCurvature, natural_curvature.ENTRY),
    (kink.Kink, kink.ENTRY),
    (anisotropic_bending.AnisotropicBending, anisotropic_bending.ENTRY),
    (bend_twist_coupling.BendTwistCoupling, bend_twist_coupling.ENTRY),
    (nonlinear_bending.NonlinearBending, nonlinear_bending.ENTRY),
    (stiffness_profile.StiffnessProfile, stiffness_profile.ENTRY),
    (density_profile.DensityProfile, density_profile.ENTRY),
    (stiffness_taper.StiffnessTaper, stiffness_taper.ENTRY),
    (density_taper.DensityTaper, density_taper.ENTRY),
    (extensibility.Extensibility, extensibility.ENTRY),
    (tension_twist_coupling.TensionTwistCoupling, tension_twist_coupling.ENTRY),
    (tension_stiffening.TensionStiffening, tension_stiffening.ENTRY),
    (memory_set.MemorySet, memory_set.ENTRY),
    (point_mass.PointMass, point_mass.ENTRY),
    (point_load.PointLoad, point_load.ENTRY),
    (uniform_load.UniformLoad, uniform_load.ENTRY),
    (tether.Tether, tether.ENTRY),
    (support_plane.SupportPlane, support_plane.ENTRY),
    (elastic_support.ElasticSupport, elastic_support.ENTRY),
    (elastic_clamp.ElasticClamp, elastic_clamp.ENTRY),
    (clamp_rotation.ClampRotation, clamp_rotation.ENTRY),
    (clamp_offset.ClampOffset, clamp_offset.ENTRY),
    (length_error.LengthError, length_error.ENTRY),
    (scan_scale.ScanScale, scan_scale.ENTRY),
    (scan_offset.ScanOffset, scan_offset.ENTRY),
    (distributed_load.DistributedLoad, distributed_load.ENTRY),
    (curvature_profile.CurvatureProfile, curvature_profile.ENTRY),
)
for _class, _ in EFFECTS:
    register_effect(_class)

_ADDED: dict[str, CatalogueEntry] = {}


def add_kind(cls: type[AbstractEffect], format: KindFormat, entry: CatalogueEntry | None = None) -> None:
    """Make a class the effect of a new kind: studies may declare it, fits may estimate its parameters, and with an ``entry``
    `explain` looks for it. Adding the same again changes nothing; raises `Scan2FlexError` when the name is taken."""
    register_kind(format)
    register_effect(cls)
    if entry is not None:
        _ADDED[entry.kind] = entry


def catalogue() -> tuple[CatalogueEntry, ...]:
    """All kinds that can be scanned for: those that are no fields."""
    return tuple(entry for entry in _entries() if not entry.field)


def fields() -> tuple[CatalogueEntry, ...]:
    """The kinds that take any form along the cable."""
    return tuple(entry for entry in _entries() if entry.field)


def _entries():
    return (*(entry for _, entry in EFFECTS if entry is not None), *_ADDED.values())


def entry_of(kind: str) -> CatalogueEntry:
    """The entry of one kind."""
    for entry in _entries():
        if entry.kind == kind:
            return entry
    raise Scan2FlexError(f"The catalogue has no kind {kind!r}: it has {', '.join(e.kind for e in catalogue())}.")


__all__ = ["CatalogueEntry", "Context", "SameShapes", "add_kind", "along_cable", "catalogue", "entry_of", "positions"]
