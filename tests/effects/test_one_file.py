"""A kind is one file: class, format, entry. One list has them all, and the table for the reader of studies is made from it."""

import dataclasses
import importlib
import pkgutil
from typing import ClassVar

import equinox as eqx
import jax
import numpy as np
import pytest

import scan2flex_jax.effects as fx
from scan2flex_jax.effects.__main__ import table
from scan2flex_jax.effects.catalogue import EFFECTS, catalogue
from scan2flex_jax.effects.format import format_of
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.rod.effect import AbstractEffect
from scan2flex_jax.study.kinds import ENDS, TABLE, kind_format, kind_names

from . import scene

ENTRIES = {entry.kind: entry for entry in EFFECTS}
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


@pytest.mark.parametrize("entry", EFFECTS, ids=list(ENTRIES))
def test_class_and_entry_are_of_one_file_named_after_the_kind(entry):
    module, cls = importlib.import_module(f"{fx.__name__}.{entry.kind}"), entry.effect
    assert cls.__module__ == module.__name__
    assert entry is module.ENTRY
    assert getattr(fx, cls.__name__) is fx.effect_class(cls.kind) is cls


def test_every_kind_of_the_folder_is_in_the_list():
    listed = {entry.effect for entry in EFFECTS}
    for info in pkgutil.iter_modules(fx.__path__):
        module = importlib.import_module(f"{fx.__name__}.{info.name}")
        own = [x for x in vars(module).values() if isinstance(x, type) and x.__module__ == module.__name__]
        kinds = {x for x in own if issubclass(x, AbstractEffect) and "kind" in vars(x)}
        assert kinds <= listed, f"{info.name} lacks its line in EFFECTS"
        assert len(kinds) == 1 or not hasattr(module, "ENTRY")


def test_the_reader_of_studies_has_the_formats_of_the_classes():
    """It knows them without JAX, from a table."""
    assert TABLE.read_text("utf-8") == table(), "write it anew: python -m scan2flex_jax.effects"
    for entry in EFFECTS:
        form = format_of(entry.effect)
        assert form is None or form == kind_format(entry.kind)


def test_all_kinds_of_the_list_but_those_that_need_more_than_a_study_are_declared():
    assert set(ENTRIES) - set(DECLARED) == {"memory_set"}


@pytest.mark.parametrize("kind", DECLARED)
def test_class_entry_and_format_agree(kind):
    """The same parameters, of the same shape, one value per end where the format says so."""
    form, entry, cls = kind_format(kind), ENTRIES[kind], fx.effect_class(kind)
    fields = {f.name: f for f in dataclasses.fields(cls)}
    assert {name for name, f in fields.items() if f.default is dataclasses.MISSING} <= set(form.names) <= set(fields)
    for ends in (ENDS, ENDS[:1]):
        context = dataclasses.replace(scene.CONTEXT, clamped_ends=ends)
        written = entry.parameters(0.5 * entry.size(context), entry.sites(context)[0], context)
        assert set(written) == set(form.names)
        effect = fx.effect_of(kind, written, ends)
        for parameter in form.parameters:
            expected = parameter.shapes(len(ends))[0]
            if entry.field:  # which has as many points as it is given
                expected = (len(written[form.grid.name]), *expected[1:])
            assert np.shape(written[parameter.name]) == expected
            whole = expected if entry.field else (2, *parameter.shape) if parameter.per_end else parameter.shape
            assert getattr(effect, parameter.name).shape == whole


class Wind(AbstractEffect):
    """A class whose format is complete."""

    kind: ClassVar[str] = "wind_for_test"
    place: ClassVar[str] = "energy"
    words: ClassVar[str] = "wind blows"
    speed: jax.Array = fx.parameter("m/s", 3)
    drag: jax.Array = fx.parameter("-", domain="nonnegative", default=1.0)


def test_a_format_follows_from_the_class():
    form = format_of(Wind)
    assert (form.kind, form.place, form.words, form.names) == ("wind_for_test", "energy", "wind blows", ("speed", "drag"))
    assert (form.parameter("speed").unit, form.parameter("speed").shape) == ("m/s", (3,))
    assert form.parameter("drag").domain == "nonnegative"
    assert Wind([1.0, 0.0, 0.0]).drag == 1.0


def changed(**attributes):
    return type("Gale", (Wind,), attributes)


@pytest.mark.parametrize(
    ("cls", "message"),
    [
        (changed(words=None), "Gale has no text `words`"),
        (changed(place="sky"), "The place of Gale is 'sky': use one of clamps, energy, observation"),
        (changed(gust=eqx.field(kw_only=True), __annotations__={"gust": jax.Array}), "Gale.gust is no parameter"),
    ],
)  # fmt: skip
def test_a_class_that_says_too_little_is_refused(cls, message):
    with pytest.raises(Scan2FlexError, match=message):
        fx.register_effect(cls)
    assert "wind_for_test" not in kind_names()


def test_a_domain_that_does_not_exist_is_refused():
    with pytest.raises(Scan2FlexError, match="The domain of a parameter is 'postive': use one of any, positive"):
        fx.parameter("m/s", domain="postive")
