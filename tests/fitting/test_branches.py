"""Poses whose turns are off by a full turn: found from their measured shapes, said, and no matter for the estimates."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.inference import fit
from scan2flex_jax.posterior import branches
from scan2flex_jax.study import load_study

from . import scenes


def with_turns(more):
    """The simulated cable with a full turn more (or less) than its poses have."""
    study = scenes.study_of(poses=scenes.NAMES)
    return branches.with_turns(study, {p.name: p.turns + more.get(p.name, 0) for p in study.poses})


def turns(study):
    return {p.name: p.turns for p in study.poses}


@pytest.fixture(scope="module")
def right():
    return fit(with_turns({}), elements=scenes.ELEMENTS)


@pytest.mark.slow
@pytest.mark.parametrize("wrong", [{"aside-45": -1}, {"unseen": 1}], ids="+".join)
def test_a_full_turn_too_many_is_found_and_said(right, wrong):
    f = fit(with_turns(wrong), elements=scenes.ELEMENTS)
    assert {n for n in scenes.NAMES if any(f"pose {n} was solved with turns =" in s for s in f.sentences)} >= set(wrong)
    assert all(p.rms < 1.05 * right.poses[name].rms for name, p in f.poses.items())
    for name, estimate in right.estimates.items():
        assert f.estimates[name].value == pytest.approx(estimate.value, rel=1e-4)
    assert f.valid == right.valid


def test_right_turns_stay_and_nothing_is_said(right):
    assert right.turned == ()
    assert turns(right.calibrated) == turns(with_turns({}))


def test_turns_that_leave_a_pose_far_from_its_curve_are_not_believed(right):
    """What else is wrong is not known then: a missing effect is made up for by a turn in every pose."""
    turned = Problem(branches.with_turns(right.study, {"plane": 1}), elements=right.problem.elements)
    found = turned.evaluator(right.minimum.shared)
    off = branches.distances(found, turned.poses)[0]
    assert off > branches.ASTRAY * turned.length
    minimum = replace(right.minimum, evaluation=found)
    assert branches.believed(turned, minimum, (right.problem, right.minimum))[0] is right.problem
    assert branches.believed(right.problem, right.minimum, (turned, minimum))[0] is right.problem


def test_turns_that_are_about_as_likely_are_named_before_the_values(right):
    best = branches.Branch(right.problem, right.minimum, right.study)
    turned = Problem(branches.with_turns(right.study, {"plane": 1, "aside-45": -1}), elements=right.problem.elements)
    other = branches.Branch(turned, replace(right.minimum, shared=right.minimum.shared + np.log([1.0, 2.0])), right.study)
    best.log_posterior, other.log_posterior = 0.0, -3.0
    said = branches.doubt(best, [best, other])
    assert "turns = 1 in pose plane and turns = -1 in pose aside-45 and torsional_stiffness = 0.5 N m^2" in said
    assert said in replace(right, in_doubt=(said,)).doubts
    other.log_posterior = -8.0
    assert branches.doubt(best, [best, other]) == "" and right.in_doubt == ()


def folder_of(*names):
    folder = Path(os.environ.get("SCAN2FLEX_DATA", "-")).joinpath(*names)
    if not folder.is_dir():
        pytest.skip(f"{'/'.join(names)} is not here: name the folder above {names[0]}/ in SCAN2FLEX_DATA")
    return folder


def errors(f, EI, GJ):
    """Of the logarithms of the estimates, in standard errors."""
    found = zip((f.estimates["bending_stiffness"], f.estimates["torsional_stiffness"]), (EI, GJ), strict=True)
    return [np.log(e.value / true) / (np.log(e.high / e.low) / 3.92) for e, true in found]


@pytest.mark.slow
def test_a_fit_that_a_wrong_turn_drew_far_from_the_truth_finds_back():
    """The stiffnesses of the wrong branch leave its pose nearer than the right turns there would: they are wrong too."""
    f = fit(load_study(folder_of("branches", "study-b")))
    assert {n: t for n, t in turns(f.study).items() if t} == {"p1": 1}
    assert np.max(np.abs(errors(f, 0.31253, 0.07321))) < 2.5
    assert f.believable


@pytest.mark.slow
def test_poses_of_an_independent_simulator_are_put_on_their_branch():
    """A practice study in whose poses a turn more is a matter of convention; what its maker's own rod fits is the same."""
    f = fit(load_study(folder_of("practice", "cases", "d27")))
    assert len(f.turned) == 2 and all(any(f"pose {name} " in s for s in f.turned) for name in ("p3", "p5"))
    found = [f.estimates[name].value for name in ("bending_stiffness", "torsional_stiffness")]
    assert found == pytest.approx((0.119947439, 0.101332972), rel=2e-3)
