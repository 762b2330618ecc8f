"""Whether a cable remembers: the test over orders of poses, studies that declare memory, and what `explain` says of others."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from benchmarks.blind import hysteresis
from benchmarks.memory import remembering, study_of_chains
from scan2flex_jax.effects import Friction, Relaxation
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.inference import MemoryTest, explain, memory_test
from scan2flex_jax.inference.memory import _permuted, other_orders
from scan2flex_jax.inference.planning import variations
from scan2flex_jax.inference.variants import _natural
from scan2flex_jax.posterior.program import Component, Program
from scan2flex_jax.posterior.settings import USUAL
from tests.fitting import scenes as cables

NOISE = 3e-4


GRIPS = [(0.75, 0.0, 0.0), (0.45, 0.05, 0.6), (0.75, 0.0, 0.0), (0.5, -0.1, -0.3), (0.6, 0.1, 0.3), (0.75, 0.0, 0.0)]


@cache
def study_with(share, count=6):
    """Poses whose plane shapes are stable in space without friction."""
    grips = [hysteresis.Grip(*g) for g in GRIPS[:count]]
    chains = hysteresis.posed(1.0, 1.0, hysteresis.Dahl(0.05, share, 2.0), grips)
    return study_of_chains(chains, grips, NOISE, seed=2)


def found(gain, *others):
    return MemoryTest("friction", gain, others, {"share": 0.5})


@pytest.mark.parametrize(
    ("test", "named", "words"),
    [
        (found(80.0, *[20.0] * 19), True, "the shapes depend on the poses before: friction gains 80.0 nats"),
        (found(80.0, *[20.0] * 18, 79.0), False, "other orders of the poses fit as well"),
        (found(80.0, *[20.0] * 9), False, "other orders of the poses fit as well"),
        (found(2.0, *[-20.0] * 19), False, "no memory is seen"),
        (found(80.0, *[80.0] * 19), False, "other orders of the poses fit as well"),
        (found(80.0, 79.0), False, "the best of one other order gains 79.0 (p = 0.50)"),
    ],
)
def test_memory_is_named_only_where_no_other_order_fits_as_well(test, named, words):
    """A lead over chance, over the parameters' cost, and over every order that was tried; nine orders cannot show p = 0.05."""
    assert test.named is named
    assert words in test.sentence()
    assert test.to_json()["p_value"] == (1 + sum(o >= test.gain for o in test.others)) / (1 + len(test.others))


ANY = cables.study_of(poses=cables.NAMES)


def test_another_order_keeps_times_and_resets_in_their_places():
    poses = tuple(replace(p, role="fit", time=float(i), reset=i == 3) for i, p in enumerate(ANY.poses))
    study = replace(ANY, poses=poses)
    for order in other_orders(len(poses), 20, np.random.default_rng(0)):
        other = _permuted(study, order).poses
        assert sorted(p.name for p in other) == sorted(p.name for p in poses)
        assert [p.name for p in other] != [p.name for p in poses]
        assert [(p.time, p.reset) for p in other] == [(p.time, p.reset) for p in poses]


@pytest.mark.parametrize(("count", "orders", "different"), [(1, 19, 0), (2, 19, 1), (3, 19, 5), (4, 19, 19), (4, 50, 23)])
def test_orders_are_drawn_without_replacement(count, orders, different):
    """A test by permutations is exact if none is drawn twice: two poses have one other order, and p is 1/2 at least."""
    drawn = other_orders(count, orders, np.random.default_rng(3))
    assert len(drawn) == len(set(drawn)) == different
    assert all(sorted(order) == list(range(count)) != list(order) for order in drawn)


def test_a_kind_without_memory_is_refused():
    with pytest.raises(Scan2FlexError, match="point_mass has no memory: test friction"):
        memory_test(ANY, "point_mass")


def test_another_pose_is_planned_after_all_of_the_study():
    words = [said for said, _ in variations(remembering(ANY))]
    assert words[:3] == [f"{name} again, last" for name in cables.NAMES[:3]]  # the last one is not fitted
    assert not any("again, last" in said for said, _ in variations(ANY))


@pytest.mark.slow
@pytest.mark.parametrize(("share", "named"), [(0.6, True), (0.0, False)])
def test_friction_of_another_solver_is_named_and_none_where_there_is_none(share, named):
    said = []
    tested = memory_test(study_with(share, 5), orders=19 if named else 3, elements=20, progress=said.append)
    assert tested.named is named
    assert said[:2] == ["with friction", "without friction"] and len(said) == 2 + len(tested.others)
    assert set(tested.parameters) == {"share", "slip_curvature"}


@pytest.mark.slow
def test_effects_are_added_to_poses_with_their_history():
    """At zero amplitude they are the base, which is solved in the order of the poses; they change the history, too."""
    study = remembering(study_with(0.6, 3), {"share": 0.5, "slip_curvature": 1.5})
    problem = Problem(study)
    minimum = problem.minimise("least-squares")
    program, vector = Program(problem, minimum), np.r_[minimum.shared, minimum.local.ravel()]
    with_mass = program.shapes((Component("point_mass", {"position": 0.5}),), np.r_[vector, 0.0, 0.5])
    for base, same in zip(program.shapes((), vector), with_mass, strict=True):
        np.testing.assert_allclose(base.configuration.r, same.configuration.r, atol=1e-9)
    bent = (Component("natural_curvature", {}),)
    more, at = 1e-3 * np.eye(len(vector) + 3)[-2], np.r_[vector, np.zeros(3)]
    less, here, beyond = (program.shapes(bent, at + step * more) for step in (-1, 0, 1))
    for low, own, high in zip(less, here, beyond, strict=True):  # the derivative too, through what earlier poses leave
        moved = (high.residual - low.residual) / 2e-3
        np.testing.assert_allclose(own.columns[..., -2], moved, atol=1e-3 * np.abs(moved).max())


K = np.diag([1e5, 1e5, 1e4, 0.02, 0.02, 0.015])


def natural(effect, path, reset=(False, False), held=(0.0, 0.0)):
    """Natural curvature about d2 of one element for poses of these curvatures."""
    excess = np.zeros((len(path), 1, 6))
    excess[:, 0, 4] = path
    return np.asarray(_natural(effect, excess, np.tile(K, (len(path), 1, 1, 1)), np.array(held), np.array(reset)))[:, 0, 4]


def test_a_slider_acts_like_the_natural_curvature_that_it_takes_off_the_moment():
    """Of share 1 it leaves the moment EI clip(k - q, -slip, slip) of EI k: the difference is that of a natural curvature."""
    effect = Friction(1.0, 1.0, spread=(1.0,), rounding=1e-9)
    np.testing.assert_allclose(natural(effect, [3.0, 1.0]), [2.0, 2.0], atol=1e-7)  # it pulls back with all its force
    np.testing.assert_allclose(natural(effect, [1.0, 3.0]), [0.0, 2.0], atol=1e-7)
    np.testing.assert_allclose(natural(effect, [3.0, 1.0], reset=(False, True)), [2.0, 0.0], atol=1e-7)


def test_relaxation_acts_like_the_part_of_the_last_bend_that_crept_away():
    found = natural(Relaxation(1.0, 60.0), [2.0, 0.5], held=(60.0, 0.0))
    np.testing.assert_allclose(found, [0.0, 2.0 * (1.0 - np.exp(-1.0))])


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.6, 0.0])
def test_friction_of_another_solver_is_found_and_none_where_there_is_none(share):
    """The friction of Dahl, about one axis: named by its law, and not tied with that of sliders."""
    found = explain(study_with(share), mesh=False, settings=replace(USUAL, most_effects=1))  # sets are not the question here
    kinds = {k for r in found.chosen for k in (r.kind, *r.tied_with)}
    assert kinds == ({"dahl"} if share else set()), (found.verdict, kinds)
    assert (found.verdict == "no missing effect") is (share == 0)
    if share:
        (effect,) = found.study.effects
        assert effect.parameters["share"] == pytest.approx(share, abs=0.02)
        assert [loop.of for loop in found.loops] == ["bending"]  # a plane cable has no twist


@pytest.mark.slow
def test_friction_is_found_beside_another_effect():
    """The same cable, its curves shifted by the scanner: neither effect explains the shapes alone."""
    study, shift = study_with(0.6), np.array([0.003, 0.004, -0.002])
    poses = (replace(p, curve=replace(p.curve, points=np.asarray(p.curve.points) + shift)) for p in study.poses)
    found = explain(replace(study, poses=tuple(poses)), mesh=False, elements=20, settings=replace(USUAL, most_effects=1))
    assert found.verdict == "explained" and [r.kind for r in found.chosen] == ["dahl", "scan_offset"]
    friction, offset = found.study.effects
    assert friction.parameters["share"] == pytest.approx(0.6, abs=0.02) == found.chosen[0].parameters["share"]
    np.testing.assert_allclose(offset.parameters["offset"], shift, atol=5e-4)
    assert found.estimates["bending_stiffness"].value == pytest.approx(0.05, rel=0.03)
