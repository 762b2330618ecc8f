"""What a summary opens with: stiffnesses with relative intervals, what they rest on, unseen poses, whether it is reliable; and
numbers in words: the digits that an interval resolves, and none that mean nothing."""

import re
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from scan2flex_jax.inference import fit
from scan2flex_jax.results.answer import BAD, FAIR, GOOD, moved_in_words, percent, rests_on, rows_of, two_digits
from scan2flex_jax.results.explanation import parameter_in_words
from scan2flex_jax.results.influence import Influence
from scan2flex_jax.study import MeasuredCurve, Tolerance, Unknown, describe, study_warnings

from . import scenes

NOISE = 2e-4
DENSITY = 0.2  # kg/m


def study(tolerance=scenes.EXACT, unknowns=scenes.BOTH, last="validate"):
    made = scenes.study_of(unknowns, poses=scenes.NAMES, tolerance=tolerance)
    curves = scenes.exact_curves(scenes.to_fit(scenes.study_of(poses=scenes.NAMES)), scenes.TRUE)
    return scenes.measured(made if last == "validate" else scenes.to_fit(made), curves, NOISE, seed=1, stated=NOISE)


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
    rest = rests_on(f.study, f.influence)
    assert "length 1 m (taken as exact) and mass 0.2 kg (taken as exact)" in rest
    assert "1 % of mass is 1 % of EI and GJ" in rest
    said = re.search(r"1 % of length \(at this mass per metre\) is (\S+) % of EI, (\S+) % of GJ", rest)
    for text, name in zip(said.groups(), ("bending_stiffness", "torsional_stiffness"), strict=True):
        assert float(text) == pytest.approx(stated["length"][name], rel=0.06)


def test_a_tolerance_of_the_mass_goes_into_the_intervals_and_is_said():
    """One per cent of the mass (one sigma) is two per cent of every stiffness (95 %), whatever the shapes say."""
    exact, f = fitted(), fitted(tolerance=Tolerance(length_density=0.01 * DENSITY))
    assert "mass 0.2 kg (+- 1 %, which is in the intervals)" in rests_on(f.study, f.influence)
    for name, e in f.estimates.items():
        own = np.log(exact.estimates[name].high / exact.estimates[name].value)
        assert np.log(e.high / e.value) == pytest.approx(np.hypot(own, 1.96 * 0.01), rel=0.02)


def test_a_mass_that_is_measured_elsewhere_is_said():
    density = Unknown("length_density", prior={"mean": DENSITY, "std": 0.02 * DENSITY})
    f = fit(study(unknowns=(*scenes.BOTH, density)), elements=scenes.ELEMENTS)
    rest = rests_on(f.study, f.influence)
    assert "mass per metre measured as 0.2 +- 2 % (which is in the intervals)" in rest and "1 % of mass" not in rest
    assert f.estimates["bending_stiffness"].high / f.estimates["bending_stiffness"].value > 1.035


def test_a_length_is_shown_by_its_change():
    f = fit(study(unknowns=(*scenes.BOTH, Unknown("length", guess=1.0))), elements=scenes.ELEMENTS)
    stated = replace(f, study=replace(f.study, cable={**f.study.cable, "length": 1.0}))
    row = next(row for row in rows_of(stated.study, stated.estimates) if row.name == "length")
    change = float(re.fullmatch(r"([+-][\d.]+(?:e-\d+)?) mm from the stated 1 m", row.note)[1])
    assert change == pytest.approx(1e3 * (f.estimates["length"].value - 1.0), rel=0.06)


def test_the_error_on_unseen_poses():
    f = fitted()
    assert f"{1e3 * f.rms('validate'):.3g} mm RMS" in f.answer.unseen and "1 held-out pose" in f.answer.unseen
    alone = fitted(last="fit")
    left_out = alone.influence.rms([len(p.residual) for p in alone.poses.values()])
    assert f"{1e3 * left_out:.3g} mm RMS" in alone.answer.unseen and "left out in turn" in alone.answer.unseen
    one = replace(alone, poses=dict([next(iter(alone.poses.items()))]))
    assert one.answer.unseen == "not known: there is one pose only"
    off = {n: replace(p, rms=np.nan, stable=False) if p.role == "validate" else p for n, p in f.poses.items()}
    lost = replace(f, poses=off)
    assert lost.answer.unseen == "not known: a validate pose could not be solved"


def test_whether_to_believe_it():
    f, alone = fitted(), fitted(last="fit")
    assert (f.answer.tone, f.answer.belief[:4]) == (GOOD, "yes:")
    assert (alone.answer.tone, "no validate pose" in alone.answer.belief) == (FAIR, True)
    assert alone.summary().count("no validate pose") == 1  # `check` says it too
    name = next(iter(f.poses))
    lost = replace(f, poses={**f.poses, name: replace(f.poses[name], stable=False, verdict="no equilibrium found")})
    for bad in (lost, replace(f, converged=False), replace(f, misfits=("pose plane is off",)), replace(f, valid=False)):
        assert bad.answer.tone == BAD and bad.answer.belief.startswith("no: ")
        assert bad.answer.lines()[0].startswith("  reliable?     no: ")  # before any value
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


@pytest.mark.parametrize(
    ("kind", "name", "value", "std", "said"),
    [
        ("point_mass", "position", 0.4512, 0.001, "0.4512 [0.4492, 0.4532] m"),  # 1.96 standard errors to both sides
        ("point_mass", "mass", 0.05, 0.1, "0.05 [0, 0.246] kg"),  # no mass is negative
        ("stiffness_profile", "factor", 2.0, 0.2, "+100 % [+64 %, +140 %]"),  # 2 exp(-0.196), 2 exp(0.196)
        ("stiffness_profile", "factor", 2.0, 200.0, "+100 %"),
        ("kink", "angle", np.array([0.2, 0.0, 0.0]), np.full(3, 0.1),
         "(0.2, 0, 0) [(0.004, -0.196, -0.196), (0.396, 0.196, 0.196)] rad"),
        ("length_error", "length", 1.001, 0.0001, "+1.0 mm from the stated 1 m [+0.80, +1.2]"),
    ],
)  # fmt: skip
def test_a_parameter_is_printed_with_its_interval(kind, name, value, std, said):
    assert parameter_in_words(scenes.example(), kind, name, value, std) == said


def test_shares_below_what_means_anything_are_not_spelt_out():
    assert [percent(x) for x in (9.8e-10, -9.8e-10, 0.123, -0.5)] == ["<0.001 %", "<0.001 %", "+12 %", "-50 %"]
    assert [two_digits(x) for x in (50.88, 9.8e-8, 0.0)] == ["51", "<0.001", "0"]


def test_a_direction_that_points_do_not_show_has_no_angle():
    pose = scenes.example().poses[0]
    points = pose.curve.points[:: len(pose.curve.points) // 8]
    noisy = points + 1e-3 * np.random.default_rng(0).normal(size=points.shape)

    def said(points):
        return describe(replace(scenes.example(), poses=(replace(pose, curve=MeasuredCurve(points)),)))

    assert "its points do not show its direction there" in said(noisy)
    assert "+-" not in said(noisy) and "deg [" in said(pose.curve.points)
