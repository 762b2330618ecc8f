"""Opening lines of an explanation, and sensitivities of its estimates: those of the baseline fit, and those given an effect."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from scan2flex_jax.diagnosis import Explanation, confirm, report, verdict
from scan2flex_jax.diagnosis.answer import answer_of, belief_of, found_in_words
from scan2flex_jax.diagnosis.influence import influence_of_refit
from scan2flex_jax.diagnosis.refit import refit
from scan2flex_jax.diagnosis.residual import Law
from scan2flex_jax.diagnosis.result import parameter_in_words
from scan2flex_jax.diagnosis.search import Found
from scan2flex_jax.diagnosis.sensitivity import Bench, Component
from scan2flex_jax.diagnosis.stage import Stage
from scan2flex_jax.fitting import fit
from scan2flex_jax.fitting.answer import BAD, FAIR, GOOD
from scan2flex_jax.fitting.discrepancy import Discrepancy
from scan2flex_jax.fitting.noise import Noise
from tests.fitting import scenes
from tests.reporting.scenes import explained

NOISE = 2e-4


@pytest.fixture(scope="module")
def fitted():
    made = scenes.study_of(poses=("plane", "twist-90", "aside-45", "unseen"))
    made = replace(made, poses=tuple(replace(p, role="fit") for p in made.poses))  # each known number shows in several poses
    curves = scenes.exact_curves(made, {"bending_stiffness": scenes.EI, "torsional_stiffness": scenes.GJ})
    return fit(scenes.measured(made, curves, NOISE, seed=3, stated=NOISE), elements=scenes.ELEMENTS)


def staged(fitted, *components, amplitudes=()):
    """A stage that has its bench alone, and a refit with these components."""
    bench = Bench(fitted.problem, fitted.minimum)
    found = refit(bench, components, Law(Noise(NOISE, 1e-3 * NOISE, 0.05)), fitted.minimum.shared, amplitudes)
    stage = object.__new__(Stage)
    object.__setattr__(stage, "bench", bench)
    object.__setattr__(stage, "unseen", {})
    return stage, found


def test_without_an_effect_it_is_that_of_the_baseline_fit(fitted):
    """White noise of the size that the study states: both weigh every point alike. A refit settles to a hundredth of a unit of
    its cost, a fifth of a standard error."""
    stage, base = staged(fitted)
    own, plain = influence_of_refit(stage, base), fitted.influence
    assert (own.labels, own.poses) == (plain.labels, plain.poses)
    spread = [fitted.estimates[label].std / fitted.estimates[label].value for label in plain.labels]
    np.testing.assert_allclose(own.moved, plain.moved, atol=0.2 * max(spread))
    for name in ("length", "length_density"):
        np.testing.assert_allclose(own.stated[name], plain.stated[name], rtol=0.02, atol=0.01)
    np.testing.assert_allclose(own.left_out, confirm.left_out(stage, base), rtol=0.02)


def test_given_a_found_length_the_stated_one_does_not_count(fitted):
    """The mass has the same sensitivity, the stated length none."""
    stage, found = staged(fitted, Component("length_error", {}), amplitudes=(np.zeros(1),))
    moved = influence_of_refit(stage, found).stated
    np.testing.assert_allclose(moved["length_density"], 1.0, atol=0.02)
    assert np.all(np.abs(moved["length"]) < 0.2 * np.abs(fitted.influence.stated["length"]))


def widths(estimates):
    """Half the interval's width of the logarithm of each stiffness."""
    return np.array([np.log(estimates[n].high / estimates[n].value) for n in ("bending_stiffness", "torsional_stiffness")])


def test_intervals_include_the_baseline_model_where_no_effect_is_established(fitted, monkeypatch):
    """An effect that is not established had narrowed the interval of EI to a sixth of that of the fit, which held the truth."""
    stage, found = staged(fitted)
    monkeypatch.setattr(confirm, "uncertainty", lambda stage, r: r.covariance)
    base = replace(found, vector=found.vector + 0.3, covariance=4.0 * found.covariance)
    narrow, wide = report.estimates(stage, [found], found), report.estimates(stage, [found], found, least=base)
    assert all(wide[name].value == narrow[name].value for name in narrow)
    np.testing.assert_allclose(widths(wide), np.hypot(2.0 * widths(narrow), 1.959964 * 0.3), rtol=1e-6)


def test_intervals_with_a_discrepancy_are_those_of_students_t(fitted, monkeypatch):
    """The size of a discrepancy is known from the scatter between poses, which are few: four here."""
    stage, found = staged(fitted)
    monkeypatch.setattr(confirm, "uncertainty", lambda stage, r: r.covariance)
    differ = replace(found, law=replace(found.law, curvature=0.3))
    narrow, wide = report.estimates(stage, [found], found), report.estimates(stage, [differ], differ)
    np.testing.assert_allclose(widths(wide) / widths(narrow), 3.182446 / 1.959964, rtol=1e-6)
    assert all(wide[name].std == narrow[name].std for name in narrow)


def judged(fitted, said, **more):
    """The answer of an explanation with this verdict."""
    answer = answer_of(replace(explained(fitted, said), search=None, **more))
    return answer.tone, answer.belief


def test_whether_to_believe_it(fitted):
    kink = explained(fitted).chosen[0]
    assert judged(fitted, verdict.TIE)[0] == FAIR and "kink or natural curvature" in judged(fitted, verdict.TIE)[1]
    assert judged(fitted, verdict.EXPLAINED, chosen=(replace(kink, tied_with=()),)) == (
        GOOD, "yes, with kink: the remaining error is noise",
    )  # fmt: skip
    assert judged(fitted, verdict.PARTLY, chosen=(replace(kink, tied_with=()),))[0] == FAIR
    assert judged(fitted, verdict.NONE, chosen=())[0] == GOOD
    assert judged(fitted, verdict.UNEXPLAINED, chosen=()) == (
        BAD, "no: something is missing, and no known effect explains it",
    )  # fmt: skip
    assert judged(fitted, verdict.UNSOLVED, chosen=())[0] == BAD
    assert answer_of(Explanation(study=fitted.study, verdict=verdict.UNSOLVED)).tone == BAD
    differ = Discrepancy(0.3, 1.0, (np.eye(3),), (np.full((1, 2), 2e-3),))
    tone, belief = judged(fitted, verdict.NONE, chosen=(), discrepancy=differ)
    assert tone == FAIR and "poses differ by 2.8 mm beyond the noise" in belief
    of = SimpleNamespace(conspicuous=lambda noise: noise.total > 1e-3)
    search, smooth = object.__new__(Found), Noise(1e-4, 2e-3, 0.1)
    search.stage = SimpleNamespace(of=of)
    nothing = replace(explained(fitted, verdict.NONE), chosen=(), search=search)
    assert belief_of(nothing)[0] == GOOD
    tone, belief = belief_of(replace(nothing, noise=smooth))
    assert tone == FAIR and "if the curves err by 2.8 mm" in belief
    false = replace(fitted, valid=False, sentences=("the model does not predict p4",))
    nothing = replace(explained(false, verdict.NONE), chosen=())
    assert answer_of(nothing).tone == BAD and "does not predict p4" in answer_of(nothing).belief


def test_a_pose_far_from_its_curve_is_not_to_be_believed_whatever_the_test_says(fitted):
    """A photograph of a wire of 1.5 m, 21 mm off, was explained "within the noise" with a noise of 27 mm that nobody stated."""
    far = {n: replace(p, rms=0.02 if p.role == "fit" else p.rms) for n, p in explained(fitted).poses.items()}
    for said, believable in ((verdict.NONE, False), (verdict.TIE, False), (verdict.UNEXPLAINED, False), (verdict.PARTLY, True)):
        near = replace(explained(fitted, said), search=None)
        found = replace(near, poses=far)
        assert near.believable is (said != verdict.UNEXPLAINED) and found.believable is believable
        assert (answer_of(found).tone == BAD) is not believable
    tone, belief = judged(fitted, verdict.NONE, chosen=(), poses=far)
    assert tone == BAD and "20.00 mm (RMS) off its measured curve" in belief
    assert not Explanation(study=fitted.study, verdict=verdict.UNSOLVED).believable


def test_an_effect_that_is_not_established_does_not_explain_too_little(fitted):
    """A point load left 2.8 of 18 mm of the demo's photograph, and was said to explain too little. From one pose it cannot be
    established."""
    found = explained(fitted, verdict.UNEXPLAINED)
    kink, bent, mass = (replace(r, verdict="too little", tied_with=()) for r in found.ranking)
    several = replace(found, ranking=(kink, bent, mass), chosen=(), added=(kink,))
    name = next(n for n, p in found.poses.items() if p.role == "fit")
    alone = replace(several, poses={name: found.poses[name]})
    assert several.in_words(kink) == alone.in_words(kink) == "likeliest, not established"
    assert (several.in_words(bent), alone.in_words(bent)) == ("explains too little", "not established")
    likelier = [replace(bent, log_evidence=kink.log_evidence + more) for more in (0.9, 9.0)]
    assert [alone.in_words(r) for r in likelier] == ["as likely, less simple", "not established"]
    assert replace(several, verdict=verdict.EXPLAINED, chosen=(kink,)).in_words(mass) == "less likely"


def test_the_summary_opens_with_the_answer(fitted):
    found = explained(fitted)
    title, blank, ei, gj, rests, *_ = found.summary().splitlines()
    assert title.endswith(": tied") and blank == ""
    assert ei.split()[0] == "EI" and gj.split()[0] == "GJ" and rests.startswith("  rests on")
    assert found_in_words(found) == "kink or natural curvature"


def test_a_parameter_is_shown_by_its_change(fitted):
    study = fitted.study
    assert parameter_in_words(study, "length_error", "length", 1.00012, 2e-5) == "+0.12 mm from the stated 1 m (+- 0.02 mm)"
    assert parameter_in_words(study, "scan_scale", "factor", 1.0031, 1e-4) == "+0.31 % +- 0.01 %"
    assert parameter_in_words(study, "point_mass", "mass", 0.05, 0.002) == "0.05 +- 0.002 kg"
    assert parameter_in_words(study, "uniform_load", "force", [0.28, -7.45e-21, 0.539]) == "(0.28, 0, 0.539) N/m"
    vague = parameter_in_words(study, "tether", "anchor", np.array([0.1, 0.0, -0.4]), np.array([1e22, 1e17, 1e22]))
    assert vague == "(0.1, 0, -0.4) m"  # an error of kilometres says that nothing is known, and no more
