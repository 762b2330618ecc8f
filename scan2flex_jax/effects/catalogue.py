"""All effects of the package, in one list; everything about an effect type follows from its class and its catalogue entry.

A new effect type of the package is a file beside the others and a name in the list (``python -m scan2flex_jax.effects`` then
updates the table of the study reader); a user's own is registered by `add_kind`.
"""

from scan2flex_jax.effects import (
    anisotropic_bending,
    bend_twist_coupling,
    bending_law,
    clamp_offset,
    clamp_rotation,
    curvature_profile,
    dahl,
    density_profile,
    density_taper,
    distributed_load,
    elastic_clamp,
    elastic_support,
    extensibility,
    friction,
    kink,
    knife_edge,
    length_error,
    memory_set,
    moment,
    natural_curvature,
    nonlinear_bending,
    point_load,
    point_mass,
    relaxation,
    scan_offset,
    scan_scale,
    section_profile,
    stiffness_field,
    stiffness_profile,
    stiffness_taper,
    support,
    support_plane,
    tension_stiffening,
    tension_twist_coupling,
    tether,
    torsion_friction,
    torsion_law,
    uniform_load,
)
from scan2flex_jax.effects.entry import CatalogueEntry, Context, SameShapes, along_cable, positions
from scan2flex_jax.effects.format import format_of
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.rod.effect import AbstractEffect
from scan2flex_jax.study.kinds import kind_names, register_kind

# The order breaks ties between effect types that fit equally well.
EFFECTS: tuple[CatalogueEntry, ...] = tuple(
    module.ENTRY
    for module in (
        natural_curvature,
        kink,
        anisotropic_bending,
        bend_twist_coupling,
        nonlinear_bending,
        stiffness_profile,
        density_profile,
        stiffness_taper,
        density_taper,
        stiffness_field,
        section_profile,
        extensibility,
        tension_twist_coupling,
        tension_stiffening,
        memory_set,
        point_mass,
        point_load,
        uniform_load,
        tether,
        support_plane,
        elastic_support,
        elastic_clamp,
        clamp_rotation,
        clamp_offset,
        length_error,
        scan_scale,
        scan_offset,
        distributed_load,
        curvature_profile,
        bending_law,
        torsion_law,
        friction,
        dahl,
        torsion_friction,
        relaxation,
        support,
        knife_edge,
        moment,
    )
)
_CLASSES: dict[str, type[AbstractEffect]] = {entry.kind: entry.effect for entry in EFFECTS}
_ADDED: dict[str, CatalogueEntry] = {}


def register_effect(cls: type[AbstractEffect]) -> type[AbstractEffect]:
    """Make a class the effect of its ``kind``: studies may declare it, and fits may estimate its parameters.

    Usable as a decorator; registering the same class again changes nothing. Raises `Scan2FlexError` if the name is taken or the
    class does not define its format (`format_of`).
    """
    form = format_of(cls)
    if _CLASSES.get(cls.kind, cls) is not cls:
        raise Scan2FlexError(f"The effect kind {cls.kind!r} is taken: give the new kind another name.")
    if form is not None:
        register_kind(form)
    _CLASSES[cls.kind] = cls
    return cls


def add_kind(entry: CatalogueEntry) -> None:
    """Register the effect of an entry and add it to the search of `explain`; errors as in `register_effect`."""
    register_effect(entry.effect)
    _ADDED[entry.kind] = entry


def kinds() -> tuple[str, ...]:
    """All effect types that a study may declare, in the order of the format's table."""
    return tuple(kind for kind in kind_names() if kind in _CLASSES)


def effect_class(kind: str) -> type[AbstractEffect]:
    """The class of an effect type."""
    if kind not in _CLASSES:
        raise Scan2FlexError(f"No effect kind is called {kind!r}: the kinds are {', '.join(_CLASSES)}.")
    return _CLASSES[kind]


def catalogue() -> tuple[CatalogueEntry, ...]:
    """All effect types that can be scanned for, without the fields and those that have to be declared."""
    return tuple(entry for entry in _entries() if not entry.field and entry.searched)


def fields() -> tuple[CatalogueEntry, ...]:
    """The effect types with an arbitrary form along the cable that compete where nothing is complete."""
    return tuple(entry for entry in _entries() if entry.field and not entry.late)


def laws() -> tuple[CatalogueEntry, ...]:
    """The effect types with an arbitrary form over their strain, which are tried last."""
    return tuple(entry for entry in _entries() if entry.field and entry.late)


def _entries() -> tuple[CatalogueEntry, ...]:
    return (*EFFECTS, *_ADDED.values())


def entry_of(kind: str) -> CatalogueEntry:
    """The catalogue entry of an effect type."""
    for entry in _entries():
        if entry.kind == kind:
            return entry
    raise Scan2FlexError(f"The catalogue has no kind {kind!r}: it has {', '.join(e.kind for e in catalogue())}.")


__all__ = ["CatalogueEntry", "Context", "SameShapes", "add_kind", "along_cable", "catalogue", "entry_of", "positions"]
