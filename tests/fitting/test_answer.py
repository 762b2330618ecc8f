"""What a summary opens with: stiffnesses with relative intervals, what they rest on, unseen poses, whether to believe it."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from scan2flex_jax.fitting.noise import Noise
from scan2flex_jax.inference import fit
from scan2flex_jax.inference.answer import (
    BAD,
    FAIR,
    GOOD,
    digits_of,
    in_mm,
    moved_in_words,
    noise_in_words,
    number,
    percent,
    rests_on,
    symbol_of,
    two_digits,
)
from scan2flex_jax.inference.estimate import Estimate
from scan2flex_jax.inference.fit_result import in_words
from scan2flex_jax.inference.influence import Influence
from scan2flex_jax.study import Tolerance, Unknown, study_warnings

from . import scenes

NOISE = 2e-4
DENSITY = 0.2  # kg/m


def study(tolerance=scenes.EXACT, unknowns=scenes.BOTH, last="validate"):
    made = scenes.study_of(unknowns, poses=("plane", "twist-90", "aside-45", "unseen"), tolerance=tolerance)
    made = replace(made, poses=(*made.poses[:3], replace(made.poses[3], role=last)))
    curves = scenes.exact_curves(scenes.study_of(poses=("plane", "twist-90", "aside-45", "unseen"), unknowns=scenes.BOTH),
                                 {"bending_stiffness": scenes.EI, "torsional_stiffness": scenes.GJ})  # fmt: skip
    return scenes.measured(made, [*curves, *_unseen()][:4], NOISE, seed=1, stated=NOISE)


def _unseen():
    """The curve of the validate pose, which `exact_curves` leaves out."""
    made = scenes.study_of(poses=("unseen",))
    made = replace(made, poses=tuple(replace(p, role="fit") for p in made.poses))
    return scenes.exact_curves(made, {"bending_stiffness": scenes.EI, "torsional_stiffness": scenes.GJ})


@cache
def fitted(tolerance=scenes.EXACT, last="validate"):
    return fit(study(tolerance, last=last), elements=scenes.ELEMENTS)


def test_the_summary_opens_with_the_answer():
    f = fitted()
    title, blank, ei, gj, rests, *_ = f.summary().splitlines()
    assert (title, blank) == (f.study.title, "")
    assert rests.startswith("  rests on")
    for line, name in ((ei, "bending_stiffness"), (gj, "torsional_stiffness")):
        e = f.estimates[name]
        symbol, value, low, high = re.fullmatch(r"  (EI|GJ) +([\d.]+) N m\^2 +\((-[\d.]+) % (\+[\d.]+) %\)", line).groups()
        assert symbol == {"bending_stiffness": "EI", "torsional_stiffness": "GJ"}[name]
        assert float(value) == pytest.approx(e.value, abs=0.2 * (e.high - e.low))
        assert float(low) == pytest.approx(100 * (e.low / e.value - 1), rel=0.06)
        assert float(high) == pytest.approx(100 * (e.high / e.value - 1), rel=0.06)


def test_what_the_poses_do_not_determine_has_no_sensitivity():
    f = fitted()
    assert "of EI and GJ" in rests_on(f.study, f.influence) and "GJ" not in rests_on(f.study, f.influence, ["GJ"])


def test_a_change_beyond_the_first_order_is_not_printed_as_a_number():
    """A pose left out of two had been said to move EI by a 2 with thirty-three zeros, per cent."""
    found = np.array([[77.0, np.log(1.12)], [-20.0, 0.0]])
    moved = Influence(("bending_stiffness", "torsional_stiffness"), np.array([True, True]), ("a", "b"), found, np.zeros(2))
    assert moved_in_words(moved, "a") == "EI not determined, GJ +12 %"
    assert moved_in_words(moved, "b") == "EI not determined, GJ +0 %"


def test_what_it_rests_on_is_what_the_influence_says():
    f = fitted()
    stated = {name: dict(zip(f.influence.labels, moved, strict=True)) for name, moved in f.influence.stated.items()}
    assert "length 1 m (taken as exact) and mass 0.2 kg (taken as exact)" in f.answer.rest
    assert "1 % of mass is 1 % of EI and GJ" in f.answer.rest
    said = re.search(r"1 % of length \(at this mass per metre\) is (\S+) % of EI, (\S+) % of GJ", f.answer.rest)
    for text, name in zip(said.groups(), ("bending_stiffness", "torsional_stiffness"), strict=True):
        assert float(text) == pytest.approx(stated["length"][name], rel=0.06)


def test_a_tolerance_of_the_mass_goes_into_the_intervals_and_is_said():
    """One per cent of the mass (one sigma) is two per cent of every stiffness (95 %), whatever the shapes say."""
    exact, f = fitted(), fitted(tolerance=Tolerance(length_density=0.01 * DENSITY))
    assert "mass 0.2 kg (+- 1 %, which is in the intervals)" in f.answer.rest
    for name, e in f.estimates.items():
        own = np.log(exact.estimates[name].high / exact.estimates[name].value)
        assert np.log(e.high / e.value) == pytest.approx(np.hypot(own, 1.96 * 0.01), rel=0.02)


def test_a_mass_that_is_measured_elsewhere_is_said():
    density = Unknown("length_density", prior={"mean": DENSITY, "std": 0.02 * DENSITY})
    f = fit(study(unknowns=(*scenes.BOTH, density)), elements=scenes.ELEMENTS)
    assert "mass per metre measured as 0.2 +- 2 % (which is in the intervals)" in f.answer.rest
    assert "1 % of mass" not in f.answer.rest
    assert f.estimates["bending_stiffness"].high / f.estimates["bending_stiffness"].value > 1.035


def test_a_length_is_shown_by_its_change():
    f = fit(study(unknowns=(*scenes.BOTH, Unknown("length", guess=1.0))), elements=scenes.ELEMENTS)
    stated = replace(f, study=replace(f.study, cable={**f.study.cable, "length": 1.0}))
    row = next(row for row in stated.answer.rows if row.name == "length")
    change = float(re.fullmatch(r"([+-][\d.]+(?:e-\d+)?) mm from the stated 1 m", row.note)[1])
    assert change == pytest.approx(1e3 * (f.estimates["length"].value - 1.0), rel=0.06)


def test_the_error_on_unseen_poses():
    f = fitted()
    assert f"{1e3 * f.rms('validate'):.3g} mm RMS" in f.answer.unseen and "1 pose that the fit never saw" in f.answer.unseen
    alone = fitted(last="fit")
    left_out = alone.influence.rms([len(p.residual) for p in alone.poses.values()])
    assert f"{1e3 * left_out:.3g} mm RMS" in alone.answer.unseen and "left out in turn" in alone.answer.unseen
    one = replace(alone, poses=dict([next(iter(alone.poses.items()))]))
    assert one.answer.unseen == "not known: there is one pose only"
    lost = replace(f, poses={n: replace(p, stable=p.role == "fit") for n, p in f.poses.items()})
    assert lost.answer.unseen == "not known: a validate pose could not be solved"


@pytest.mark.parametrize(("value", "text"), [(123.4, "120"), (0.01234, "0.012"), (3.456, "3.5"), (0.0, "0"), (1e-4, "0.0001")])
def test_two_digits_without_an_exponent(value, text):
    assert two_digits(value) == text
    assert two_digits(value, sign=True) == f"+{text}"


def test_a_parameter_is_named_before_its_effect():
    assert symbol_of("nonlinear_bending.slip_curvature") == "slip curvature (nonlinear bending)"
    assert symbol_of("tether.anchor", 2) == "anchor[2] (tether)"
    assert (symbol_of("bending_stiffness"), symbol_of("bending_stiffness", 1)) == ("EI", "EI2")


def test_whether_to_believe_it():
    f, alone = fitted(), fitted(last="fit")
    assert (f.answer.tone, f.answer.belief[:4]) == (GOOD, "yes:")
    assert (alone.answer.tone, "no validate pose" in alone.answer.belief) == (FAIR, True)
    assert alone.summary().count("no validate pose") == 1  # `check` says it too
    name = next(iter(f.poses))
    lost = replace(f, poses={**f.poses, name: replace(f.poses[name], stable=False, verdict="no equilibrium found")})
    for bad in (lost, replace(f, converged=False), replace(f, misfits=("pose plane is off",)), replace(f, valid=False)):
        assert bad.answer.tone == BAD and bad.answer.belief.startswith("no: ")
        assert bad.answer.lines()[0].startswith("  believe it?   no: ")  # before any value
    assert f.answer.lines()[0].startswith("  EI")
    for what_next in (replace(f, misfits=("pose plane is off",)), replace(f, valid=False)):
        assert what_next.answer.belief.endswith("`scan2flex explain` looks for what is missing")
    turned = replace(f, turned=("pose plane fits with one more turn",))
    assert (turned.answer.tone, "full turns" in turned.answer.belief) == (FAIR, True)
    assert turned.answer.doubts[:1] == turned.turned
    assert turned.summary().splitlines()[1].strip() == turned.turned[0]
    assert turned.summary().count(turned.turned[0]) == 1


def test_the_warnings_of_check_are_repeated():
    f = fitted()
    short = replace(f.study, poses=tuple(replace(p, curve=replace(p.curve, points=p.curve.points[8:])) for p in f.study.poses))
    warned = study_warnings(short)
    assert warned and all(w in replace(f, study=short).answer.warnings for w in warned)
    assert "- " + warned[0][:60] in replace(f, study=short).summary()


def test_an_undetermined_value_has_no_number():
    f = fitted()
    open_ = replace(f.estimates["torsional_stiffness"], identifiable=False, low=None, high=None, std=None)
    answer = replace(f, estimates={**f.estimates, "torsional_stiffness": open_}).answer
    row = next(row for row in answer.rows if row.name == "torsional_stiffness")
    assert (row.value, row.interval, row.note) == ("", "", "not determined by these poses")
    assert answer.belief.endswith("these poses do not determine GJ")


def test_numbers():
    assert percent(0.0412) == "+4.1 %" and percent(-1.2345e-6) == "-0.00012 %" and percent(1.5) == "+150 %"
    assert number(0.1, 3) == "0.100" and number(123.0, 3) == "123" and number(1.2e-7, 2) == "1.2e-07"
    assert in_mm(2.71828e-7) == "0.000272" and in_mm(1.6e-4) == "0.160"
    said, assumed = noise_in_words(Noise(1e-5, 2e-6, 0.03), 1.0).split("; ")
    assert said == "white 0.0100 mm, correlated 0.00200 mm over 30 mm, per normal"
    assert assumed == "the least that is assumed: the shapes show less"
    assert noise_in_words(Noise(1e-4, 2e-6, 0.03), 1.0).endswith("over 30 mm, per normal")
    assert in_mm(0.01234567) == "12.346" and in_mm(0.0) == "0.000"
    assert digits_of(0.318, 0.308, 0.331) == 3 and digits_of(0.1, 0.09999, 0.10001) == 5 and digits_of(0.0, -1.0, 1.0) == 3


def test_an_estimate_is_told_from_the_ends_of_its_interval():
    """However narrow it is: no `0.1 [0.1, 0.1]`."""
    sharp = Estimate(0.0999998, 2.6e-7, 0.0999993, 0.1000003, identifiable=True, at_bound=False, unit="N m^2")
    assert in_words(sharp) == "0.0999998 [0.0999993, 0.100000] N m^2"
