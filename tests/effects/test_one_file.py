"""A kind is one file: its class, its entry and its format (declared without JAX) agree, and one list has them all."""

import dataclasses
import importlib
import pkgutil

import numpy as np
import pytest

import scan2flex_jax.effects as fx
from scan2flex_jax.effects.catalogue import EFFECTS, catalogue
from scan2flex_jax.rod.effect import AbstractEffect
from scan2flex_jax.study.kinds import ENDS, kind_format, kind_names

from . import scene

ENTRIES = {entry.kind: entry for _, entry in EFFECTS if entry is not None}
DECLARED = [kind for kind in kind_names() if kind in ENTRIES]
ORDER = [
    "natural_curvature", "kink", "anisotropic_bending", "bend_twist_coupling", "nonlinear_bending", "stiffness_profile",
    "density_profile", "stiffness_taper", "density_taper", "extensibility", "tension_twist_coupling", "tension_stiffening",
    "memory_set", "point_mass", "point_load", "uniform_load", "tether", "support_plane", "elastic_support", "elastic_clamp",
    "clamp_rotation", "clamp_offset", "length_error", "scan_scale", "scan_offset",
]  # fmt: skip


def test_the_order_of_the_catalogue_is_fixed():
    """Ties in a ranking keep it."""
    assert [entry.kind for entry in catalogue()] == ORDER


@pytest.mark.parametrize(("cls", "entry"), EFFECTS, ids=[cls.kind for cls, _ in EFFECTS])
def test_class_and_entry_are_of_one_file_named_after_the_kind(cls, entry):
    module = importlib.import_module(f"{fx.__name__}.{cls.kind}")
    assert cls.__module__ == module.__name__
    assert entry is getattr(module, "ENTRY", None)
    assert entry is None or entry.kind == cls.kind
    assert getattr(fx, cls.__name__) is fx.effect_class(cls.kind) is cls


def test_every_kind_of_the_folder_is_in_the_list():
    listed = {cls for cls, _ in EFFECTS}
    for info in pkgutil.iter_modules(fx.__path__):
        module = importlib.import_module(f"{fx.__name__}.{info.name}")
        own = [x for x in vars(module).values() if isinstance(x, type) and x.__module__ == module.__name__]
        kinds = {x for x in own if issubclass(x, AbstractEffect) and "kind" in vars(x)}
        assert kinds <= listed, f"{info.name} lacks its line in EFFECTS"
        assert len(kinds) == 1 or not hasattr(module, "ENTRY")


def test_all_kinds_of_the_list_but_those_that_need_more_than_a_study_are_declared():
    assert set(ENTRIES) - set(DECLARED) == {"memory_set"}


@pytest.mark.parametrize("kind", DECLARED)
def test_class_entry_and_format_agree(kind):
    """The same parameters, of the same shape, one value per end where the format says so, and the same place."""
    form, entry, cls = kind_format(kind), ENTRIES[kind], fx.effect_class(kind)
    fields = {f.name: f for f in dataclasses.fields(cls)}
    assert {name for name, f in fields.items() if f.default is dataclasses.MISSING} <= set(form.names) <= set(fields)
    assert entry.place == form.place
    for ends in (ENDS, ENDS[:1]):
        context = dataclasses.replace(scene.CONTEXT, clamped_ends=ends)
        written = entry.to_parameters(0.5 * entry.size(context), entry.sites(context)[0], context)
        assert set(written) == set(form.names)
        effect = fx.effect_of(kind, written, ends)
        for parameter in form.parameters:
            expected = parameter.shapes(len(ends))[0]
            if entry.field:  # which has as many places as it is given
                expected = (len(written["s"]), *expected[1:])
            assert np.shape(written[parameter.name]) == expected
            whole = expected if entry.field else (2, *parameter.shape) if parameter.per_end else parameter.shape
            assert getattr(effect, parameter.name).shape == whole
