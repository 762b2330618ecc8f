"""EI along a rod from how it droops, against rods of an independent solver."""

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks import rods
from scan2flex_jax import fit, load_study, plot, save_study
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting.parameters import layout_of, start_vector, values_of
from scan2flex_jax.results.along import StiffnessAlong
from scan2flex_jax.study import EffectDeclaration, Unknown

PLACES = np.linspace(0.0, rods.LENGTH, 9)


def declared(name, seed, **parameters):
    """The study of a rod with an unknown field."""
    study = rods.study(name, seed, sides=(("up", 1.0),))
    field = EffectDeclaration("stiffness_field", {"s": PLACES, "density_power": 0.5, **parameters})
    return replace(study, effects=(*study.effects, field), unknowns=(*study.unknowns, Unknown("stiffness_field.log_factor")))


@pytest.mark.slow
def test_ei_along_a_cone_is_found_with_its_band(tmp_path):
    """A cone whose EI falls fifty times, all nine places unknown; told in words, in JSON and as a curve."""
    study = declared("cone 50", 1)
    bent = EffectDeclaration("natural_curvature", {"curvature": np.array([0.0, -rods.RODS["cone 50"][2], 0.0])})
    result = fit(replace(study, effects=(*study.effects, bent)))
    form, middle, *_ = rods.RODS["cone 50"]
    EI, low, high = result.along.at(rods.TOLD)
    true = middle * form(rods.TOLD / rods.LENGTH)
    seen = rods.TOLD < 0.85 * rods.LENGTH  # near the tip nothing bends
    np.testing.assert_allclose(EI[seen], true[seen], rtol=0.2)
    assert np.mean((low <= true) & (true <= high)) >= 7 / 9
    estimate = result.estimates["bending_stiffness"]
    assert estimate.low < middle * form(np.array([0.5]))[0] < estimate.high
    assert abs(result.estimates["stiffness_field.log_factor"].value[4]) < 1e-3
    told = json.loads(json.dumps(result.to_json()))["stiffness_along"]
    assert set(told) == {"s", "bending", "low", "high", "factor", "absolute"}
    middle = np.interp(0.5 * rods.LENGTH, told["s"], told["bending"])
    np.testing.assert_allclose(told["bending"], np.array(told["factor"]) * middle, rtol=1e-2)
    assert "EI along the cable" in result.summary()
    assert plot.stiffness(result).get_ylabel().startswith("bending stiffness")
    save_study(result.calibrated, tmp_path)
    again = load_study(tmp_path)
    values = values_of(layout_of(again), start_vector(again, layout_of(again), {}))
    found = result.estimates["stiffness_field.log_factor"].value
    np.testing.assert_allclose(values["stiffness_field.log_factor"], found, atol=1e-6)


def test_a_band_is_told_at_a_few_places_and_withheld_where_it_is_open():
    s = np.linspace(0.05, 0.95, 10)
    along = StiffnessAlong(s, np.ones(10), np.full(10, 0.5), np.r_[np.full(9, 2.0), 40.0], np.ones(10))
    (said,) = along.sentences()
    assert said.startswith("EI along the cable (N m^2): 1 [0.5, 2] at 0.05 m")
    assert said.endswith("1 (not determined) at 0.95 m")
    (said,) = along.withheld().sentences()
    assert said.endswith("1 (no interval: not reliable) at 0.95 m")
    assert set(along.withheld().to_json()) == {"s", "bending", "factor", "absolute"}


def test_a_field_takes_no_prior_of_the_users():
    study = declared("uniform", 1)
    unknown = Unknown("stiffness_field.log_factor", prior={"mean": 0.0, "std": 1.0})
    with pytest.raises(Scan2FlexError, match="points of a field follow one another"):
        fit(replace(study, unknowns=(*study.unknowns[:1], unknown)))


def test_without_an_effect_that_varies_there_is_no_stiffness_to_draw():
    class Plain:
        along = None

    with pytest.raises(Scan2FlexError, match="nothing lets the stiffness vary"):
        plot.stiffness(Plain())
