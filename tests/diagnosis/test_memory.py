"""Whether a cable remembers: the test over orders of poses, and a study that declares memory in `explain` and `plan`."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.blind import hysteresis
from benchmarks.memory import remembering, study_of_chains
from scan2flex_jax.diagnosis import memory_test, planning
from scan2flex_jax.diagnosis.memory import LEAD, MemoryTest, _in_other_orders, _permuted
from scan2flex_jax.diagnosis.remembered import Remembering, said_of
from scan2flex_jax.diagnosis.search import Found
from scan2flex_jax.diagnosis.sensitivity import Bench, Component
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting.problem import Problem
from tests.fitting.test_memory import GRIPS

NOISE = 3e-4


def study_with(share, count=6):
    grips = [hysteresis.Grip(*g) for g in GRIPS[:count]]
    chains = hysteresis.posed(1.0, 1.0, hysteresis.Dahl(0.05, share, 2.0), grips)
    return study_of_chains(chains, grips, NOISE, seed=2)


def found(gain, *others, cost=6.0):
    return MemoryTest("friction", gain, others, {"share": 0.5}, cost)


@pytest.mark.parametrize(
    ("test", "named", "words"),
    [
        (found(80.0, *[20.0] * 19), True, "the cable remembers: friction gains 80.0 nats"),
        (found(80.0, *[20.0] * 18, 79.0), False, "other orders of the poses fit as well"),
        (found(80.0, *[20.0] * 9), False, "other orders of the poses fit as well"),
        (found(7.0, *[-20.0] * 19), False, "no memory is seen"),
        (found(80.0, *[80.0] * 19), False, "other orders of the poses fit as well"),
    ],
)
def test_memory_is_named_only_where_no_other_order_fits_as_well(test, named, words):
    """A lead over chance, over the parameters' cost, and over every order that was tried; nine orders cannot show p = 0.05."""
    assert test.named is named
    assert words in test.sentence()


def test_another_order_keeps_times_and_resets_in_their_places():
    poses = [replace(p, time=float(i), reset=i == 3) for i, p in enumerate(study_with(0.5).poses)]
    study = replace(study_with(0.5), poses=tuple(poses))
    for seed in range(20):
        other = _permuted(study, np.random.default_rng(seed)).poses
        assert sorted(p.name for p in other) == [p.name for p in poses]
        assert [p.name for p in other] != [p.name for p in poses]
        assert [(p.time, p.reset) for p in other] == [(p.time, p.reset) for p in poses]


def test_a_test_may_end_with_the_first_order_that_fits_as_well():
    """Memory is then not named, however the orders that were not tried fit."""
    gains, study, say = iter([20.0, 79.0, 10.0, 85.0]), study_with(0.5, 3), lambda said: None
    others = _in_other_orders(study, lambda study: next(gains), 19, 0, 80.0 - LEAD, say)
    assert others == (20.0, 79.0)
    assert not found(80.0, *others).named
    assert "the best of one other order gains 79.0 (p = 0.50)" in found(80.0, 79.0).sentence()
    assert len(_in_other_orders(study, lambda study: 79.0, 19, 0, np.inf, say)) == 19


def test_no_other_order_is_tried_where_the_order_of_measurement_gains_too_little_or_leaves_too_much():
    study = study_with(0.6, 3)
    used = memory_test(study, at_most=1e-9)
    assert not used.others
    assert not used.named
    assert used.sentence().startswith("memory is not tested: friction gains")
    assert used.untried
    assert "the best model without memory leaves less" in said_of(Remembering(used), object.__new__(Found))[1]
    assert not memory_test(study_with(0.0, 3), until_denied=True).others
    assert found(2.0).sentence() == "no memory is seen: friction gains 2.0 nats in the order of measurement"


def test_a_kind_without_memory_is_refused():
    with pytest.raises(Scan2FlexError, match="point_mass has no memory: test friction"):
        memory_test(study_with(0.5), "point_mass")


def test_another_pose_is_planned_after_all_of_the_study():
    words = [said for said, _ in planning.variations(remembering(study_with(0.5)))]
    assert words[:6] == [f"p{i} again, last" for i in range(1, 7)]
    assert not any("again, last" in said for said, _ in planning.variations(study_with(0.5)))


@pytest.mark.slow
@pytest.mark.parametrize(("share", "named"), [(0.6, True), (0.0, False)])
def test_friction_of_another_solver_is_named_and_none_where_there_is_none(share, named):
    """Orders are tried until one fits about as well: without friction none has to be."""
    assert memory_test(study_with(share), until_denied=True).named is named


@pytest.mark.slow
def test_effects_are_added_to_poses_with_their_history():
    """At zero amplitude they are the base, which is solved in the order of the poses."""
    study = remembering(study_with(0.6, 3), {"share": 0.5, "slip_curvature": 1.5})
    problem = Problem(study)
    minimum = problem.minimise("least-squares")
    bench = Bench(problem, minimum)
    vector = np.r_[minimum.shared, minimum.local.ravel()]
    mass = Component("point_mass", {"position": 0.5})
    with_mass = bench.shapes((mass,), np.r_[vector, 0.0, 0.5], derivative=False)
    for base, same in zip(bench.shapes((), vector), with_mass, strict=True):
        np.testing.assert_allclose(base.configuration.r, same.configuration.r, atol=1e-9)
