"""The table of kinds and the effects agree, and an effect goes to the format and back."""

import numpy as np
import pytest

import scan2flex_jax.effects as fx
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.rod.effect import AbstractEffect
from scan2flex_jax.study.kinds import kind_format, kind_names

from . import scene

HOOKS = {
    "clamps": {"clamps", "cable", "section"},  # a grip that yields is in series with the end section
    "energy": {"cable", "section", "dead_load", "strain_energy", "node_potential"},
    "observation": {"observe"},
}


def test_every_declarable_kind_has_an_effect():
    assert set(fx.kinds()) == set(kind_names())


@pytest.mark.parametrize("kind", kind_names())
def test_table_and_effect_agree(kind):
    format, cls = kind_format(kind), fx.effect_class(kind)
    assert set(format.names) <= set(cls.__dataclass_fields__)
    hooks = {h for hooks in HOOKS.values() for h in hooks if getattr(cls, h) is not getattr(AbstractEffect, h)}
    assert hooks
    assert hooks <= HOOKS[format.place]


@pytest.mark.parametrize("kind", kind_names())
def test_there_and_back(kind):
    given = {**scene.VALUES[kind][0], **scene.VALUES[kind][1]}
    back = fx.parameters_of(fx.effect_of(kind, given))
    optional = {p.name: 0.0 for p in kind_format(kind).parameters if p.optional}
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
