"""Effects that can stand for the stiffnesses: an unknown that only the usual size of an effect holds is not determined."""

import numpy as np
import pytest

from scan2flex_jax.effects.catalogue import entry_of
from scan2flex_jax.posterior.program import Component
from scan2flex_jax.posterior.quantities import estimates, known

from . import scenes

G = 9.81


@pytest.fixture(scope="module")
def variant():
    """A cable whose weight is declared 30 % too small."""
    return scenes.variant_of(scenes.study(gravity=(0.0, 0.0, -0.7 * G)))


def beside(variant, kind):
    """The hypothesis of an effect, from its null at the first place of the catalogue."""
    entry = entry_of(kind)
    component = Component(kind, entry.sites(variant.context)[0])
    return variant.refitted([component], [entry.null], variant.empty.x, variant.empty.shapes, others=False)


def test_a_load_along_gravity_leaves_the_ratio_of_the_stiffnesses_alone(variant):
    h = beside(variant, "uniform_load")
    told = estimates(h, (h,))
    EI, GJ = (told[name] for name in ("bending_stiffness", "torsional_stiffness"))
    for e in (EI, GJ):
        assert not e.identifiable and e.std is None and e.low is None
    assert any("beside uniform load of any size" in s and "torsional_stiffness" in s for s in known(h).sentences)
    plain = estimates(variant.empty, (variant.empty,))
    ratio = plain["torsional_stiffness"].value / plain["bending_stiffness"].value
    assert GJ.value / EI.value == pytest.approx(ratio, rel=0.05)


def test_an_effect_that_the_shapes_tell_from_the_stiffnesses_leaves_their_intervals(variant):
    h = beside(variant, "natural_curvature")
    for name, e in estimates(h, (h,)).items():
        assert e.identifiable and np.isfinite(e.std), name
