"""Formats of effect types follow from their classes; an effect goes to the format and back."""

import dataclasses
from typing import ClassVar

import equinox as eqx
import jax
import numpy as np
import pytest

import scan2flex_jax.effects as fx
from scan2flex_jax.effects.__main__ import table
from scan2flex_jax.effects.catalogue import EFFECTS
from scan2flex_jax.effects.format import format_of
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.rod.effect import AbstractEffect
from scan2flex_jax.study.kinds import ENDS, TABLE, kind_format, kind_names

from . import scene

ENTRIES = {entry.kind: entry for entry in EFFECTS}
DECLARED = [kind for kind in kind_names() if kind in ENTRIES]


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
        assert set(written) <= set(form.names) <= {*written, *(p.name for p in form.parameters if p.optional)}
        effect = fx.effect_of(kind, written, ends)
        for parameter in (p for p in form.parameters if p.name in written):
            expected = parameter.shapes(len(ends))[0]
            if parameter.per_point:  # which has as many points as it is given
                expected = (len(written[form.grid.name]), *expected[1:])
            assert np.shape(written[parameter.name]) == expected
            whole = expected if parameter.per_point else (2, *parameter.shape) if parameter.per_end else parameter.shape
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


@pytest.mark.parametrize("kind", kind_names())
def test_there_and_back(kind):
    given = scene.GIVEN[kind]
    back = fx.parameters_of(fx.effect_of(kind, given))
    fields = {f.name: f for f in dataclasses.fields(fx.effect_class(kind))}
    optional = {p.name: 0.0 for p in kind_format(kind).parameters if p.optional and fields[p.name].default is not None}
    assert back.keys() == (optional | given).keys()
    for name, value in (optional | given).items():
        np.testing.assert_allclose(back[name], value, rtol=1e-12)


def test_one_clamped_end():
    effect = fx.effect_of("elastic_clamp", {"stiffness": [0.5]}, ("end",))
    np.testing.assert_array_equal(effect.stiffness, [np.inf, 0.5])
    np.testing.assert_array_equal(fx.parameters_of(effect, ("end",))["stiffness"], [0.5])
    effect = fx.effect_of("clamp_rotation", {"rotation": [[0.1, 0.2, 0.3]]}, ("start",))
    np.testing.assert_array_equal(effect.rotation, [[0.1, 0.2, 0.3], [0, 0, 0]])


def test_order_of_clamp_effects_does_not_matter():
    a, b = scene.active("clamp_rotation"), scene.active("clamp_offset")
    assert fx.ordered((a, b)) == fx.ordered((b, a)) == (b, a)


@pytest.mark.parametrize(
    ("kind", "parameters", "message"),
    [
        ("gremlin", {}, "No effect kind is called"),
        ("kink", {"position": 0.1}, "lacks angle, width"),
        ("point_mass", {"position": 0.1, "mass": 0.1, "colour": 1.0}, "has no parameter colour"),
        ("uniform_load", {"force": [1.0, 2.0]}, "has shape"),
        ("distributed_load", {"s": [0.0, 1.0], "force": [[0.0, 0.0, 1.0]]}, "has 2 of s, 1 of force"),
    ],
)
def test_faults_are_one_sentence(kind, parameters, message):
    with pytest.raises(Scan2FlexError, match=message) as caught:
        fx.effect_of(kind, parameters)
    assert "\n" not in str(caught.value)
