"""Poses whose turns are off by a full turn: found from their measured shapes, said, and no matter for the estimates."""

from types import SimpleNamespace

import numpy as np
import pytest

from scan2flex_jax.fit import branches, fit
from scan2flex_jax.fit.run import Problem

from . import scenes

NAMES = ("plane", "twist-90", "aside-45", "unseen")


def with_turns(more):
    """The simulated cable with a full turn more (or less) than its poses have."""
    study = scenes.study_of(poses=NAMES)
    return branches.with_turns(study, {p.name: p.turns + more.get(p.name, 0) for p in study.poses})


def turns(study):
    return {p.name: p.turns for p in study.poses}


@pytest.fixture(scope="module")
def right():
    return fit(with_turns({}))


@pytest.mark.parametrize("wrong", [{"twist-90": 1}, {"twist-90": -1, "aside-45": 1}, {"unseen": 1}], ids="+".join)
def test_a_full_turn_too_many_is_found_and_said(right, wrong):
    f = fit(with_turns(wrong))
    assert {n for n in NAMES if any(f"pose {n} was solved with turns =" in s for s in f.sentences)} >= set(wrong)
    assert all(p.rms < 1.05 * right.poses[name].rms for name, p in f.poses.items())
    for name, estimate in right.estimates.items():
        assert f.estimates[name].value == pytest.approx(estimate.value, rel=1e-4)
    assert f.valid == right.valid


def test_right_turns_stay_and_nothing_is_said(right):
    assert right.turned == ()
    assert turns(right.calibrated) == turns(with_turns({}))


def test_distances_are_those_of_solved_poses():
    problem = Problem(with_turns({}))
    found = problem.evaluator(np.log([scenes.EI, scenes.GJ]))
    assert np.all(branches.distances(found, problem.poses.mask) < 1e-3)
    unsolved = SimpleNamespace(residual=found.residual, verdict=SimpleNamespace(code=np.array([0, 1, 0])))
    assert np.isinf(branches.distances(unsolved, problem.poses.mask)).tolist() == [False, True, False]
