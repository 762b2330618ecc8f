"""Poses in their order: derivatives through it, what a straightened cable forgets, and fits of poses from another solver."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.blind import hysteresis
from benchmarks.memory import study_of_chains
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting import residual_function
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.fitting.traced import traced_problem
from scan2flex_jax.inference import fit
from scan2flex_jax.prediction import predict
from scan2flex_jax.study import EffectDeclaration, Tolerance, Unknown
from scan2flex_jax.study.sense import check_study

from . import scenes

FRICTION = EffectDeclaration("friction", {})
RELAXATION = EffectDeclaration("relaxation", {})
OF_FRICTION = (Unknown("friction.share"), Unknown("friction.slip_curvature"), Unknown("friction.initial_set"))
STIFF = {"bending_stiffness": 0.1, "torsional_stiffness": 0.25}
NEW = {**STIFF, "friction.share": 0.4, "friction.slip_curvature": 1.0, "friction.initial_set": np.zeros(2)}
BENT = {**NEW, "friction.initial_set": np.array([0.4, -0.9])}
NAMES = tuple(p.name for p in scenes.example().poses)


def ordered(poses=NAMES, **changes):
    """The simulated cable with memory; its last pose is one for validation."""
    study = scenes.study_of((*scenes.BOTH, *OF_FRICTION), poses=poses, effects=(FRICTION,))
    return replace(study, poses=tuple(replace(p, **changes.get(p.name.replace("-", "_"), {})) for p in study.poses))


def evaluated(study, at=NEW, **given):
    problem = Problem(study, scenes.ELEMENTS)
    x = scenes.vector(problem.layout, at)
    return problem, x, problem.evaluator(x, **given)


def differences(problem, x, e, step=1e-6):
    """Central differences of the residuals, fourth order, each pose on its branch; so short that no slider turns in between."""
    columns = []
    for k in range(problem.layout.shared):
        way = step * np.eye(len(x))[k]
        r = [problem.evaluator(x + m * way, start=e.configuration).residual for m in (-2, -1, 1, 2)]
        columns.append((r[0] - 8 * r[1] + 8 * r[2] - r[3]) / (12 * step))
    return np.stack(columns, axis=-1)


def test_derivatives_go_through_the_order_of_poses():
    """By the set before the first pose too: exact against differences, and not those of poses that begin without history.

    At the shapes themselves, where the axes of a residual, which derivatives hold, have no part in it.
    """
    study = ordered(NAMES[:3])
    problem, x, e = evaluated(scenes.measured(study, scenes.exact_curves(study, BENT)), BENT)
    assert e.solved
    exact, by_differences = e.jacobian[..., : len(x)], differences(problem, x, e)
    scale = np.abs(exact).max(axis=(0, 1, 2))
    assert np.all(np.abs(exact[1:]).max(axis=(0, 1, 2))[-2:] > 1e-4)  # m per 1/m, in the poses after the first
    noise = 3e-8  # of the differences, m per 1/m: the solver's residual over their step
    assert np.all(np.abs(exact - by_differences).max(axis=(0, 1, 2)) < np.maximum(1e-6 * scale, noise))
    fresh = evaluated(ordered(NAMES[:3], twist_90={"reset": True}, aside_45={"reset": True}), BENT)[2]
    assert np.all(np.abs(exact - fresh.jacobian[..., : len(x)])[1:].max(axis=(0, 1, 2)) > 1e-3 * scale)


def predicted(study, at):
    """The poses of a study with these values as known ones."""
    values = {name.removeprefix("friction."): value for name, value in at.items() if name not in STIFF}
    known = replace(study, unknowns=(), cable={**study.cable, **STIFF}, effects=(EffectDeclaration("friction", values),))
    return predict(known, elements=scenes.ELEMENTS)


@pytest.mark.slow
def test_a_set_acts_from_the_first_pose_until_the_cable_is_straightened():
    """In fits as in predictions; after `reset` a pose is that of a cable without history, and before it nothing changes."""
    whole, bent = (evaluated(ordered(), at)[2].configuration.r for at in (NEW, BENT))
    assert np.abs(whole[0] - bent[0]).max() > 1e-3
    straightened = ordered(aside_45={"reset": True})
    alone = evaluated(ordered(("aside-45",)))[2].configuration.r
    for at, before in ((NEW, whole), (BENT, bent)):
        fresh = evaluated(straightened, at)[2].configuration.r
        np.testing.assert_array_equal(fresh[:2], before[:2])
        np.testing.assert_allclose(fresh[2], alone[0], atol=1e-12)
    assert np.abs(whole[2] - alone[0]).max() > 1e-3
    told = predicted(straightened, BENT)
    np.testing.assert_allclose(told["plane"].points, bent[0], atol=1e-9)
    np.testing.assert_allclose(told["aside-45"].points, alone[0], atol=1e-9)


def test_a_set_before_a_straightened_first_pose_is_refused():
    with pytest.raises(Scan2FlexError, match="the cable was straightened before its first pose, 'plane', and has no set"):
        check_study(ordered(plane={"reset": True}))


def test_the_order_matters_and_a_pose_for_validation_is_part_of_it():
    first, x, e = evaluated(ordered())
    study = first.study
    swapped = evaluated(replace(study, poses=(study.poses[1], study.poses[0], *study.poses[2:])))[2]
    assert np.abs(swapped.configuration.r[1] - e.configuration.r[0]).max() > 1e-4  # the same clamps, another past
    between = replace(study, poses=(study.poses[3], *study.poses[:3]))
    assert np.abs(evaluated(between)[2].configuration.r[0] - e.configuration.r[0]).max() > 1e-4
    found = first.evaluator_of(first.held_out)(x)
    told = predicted(study, NEW)
    np.testing.assert_allclose(told["unseen"].points, found.configuration.r[0], atol=1e-9)
    np.testing.assert_allclose(told["aside-45"].points, e.configuration.r[2], atol=1e-9)


def test_times_say_how_far_a_pose_relaxed():
    """A pose taken again, long after, differs from the first; at once, or without a share, it does not."""
    unknowns = (*scenes.BOTH, Unknown("relaxation.share"), Unknown("relaxation.time_constant"))
    at = {**STIFF, "relaxation.share": 0.3, "relaxation.time_constant": 60.0}

    def twice(later, **other):
        study = scenes.study_of(unknowns, poses=("aside-45",), effects=[RELAXATION])
        (pose,) = study.poses
        again = (replace(pose, time=5.0), replace(pose, name="again", time=later))
        return evaluated(replace(study, poses=again), {**at, **other})[2].configuration.r

    once, late = twice(5.0), twice(600.0)
    np.testing.assert_allclose(once[0], once[1], atol=1e-9)
    assert np.abs(late[1] - late[0]).max() > 1e-3
    np.testing.assert_allclose(*twice(600.0, **{"relaxation.share": 0.0}), atol=1e-9)


GRIPS = [(0.75, 0.0, 0.0), (0.45, 0.05, 0.6), (0.75, 0.0, 0.0), (0.5, -0.1, -0.8), (0.6, 0.1, 0.3), (0.75, 0.0, 0.0)]


class Sliders(hysteresis.Dahl):
    """Prandtl's sliders for the solver of the benchmark, with the thresholds of the package."""

    def stepped(self, k, before, z):
        thresholds = self.slip * np.array([0.25, 0.75, 1.25, 1.75])[:, None]
        z = np.tile(before, (4, 1)) if np.ndim(z) == 1 else z
        pull = np.clip(k - z, -thresholds, thresholds)
        stuck = np.mean(np.abs(k - z) < thresholds, axis=0)
        moment = self.EI * ((1 - self.share) * k + self.share * pull.mean(axis=0))
        return moment, self.EI * (1 - self.share + self.share * stuck), k - pull


@pytest.mark.slow
def test_a_fit_recovers_friction_and_the_set_that_a_cable_came_with():
    """From the poses of another solver: a plane chain of rigid segments, kept at a curvature before its first pose, that goes
    from pose to pose in small steps. It turns back in places on its way, which a fit does not know: values to some per cent."""
    law, grips = Sliders(0.05, 0.6, 2.0), [hysteresis.Grip(*g) for g in GRIPS]
    chains = hysteresis.posed(1.0, 1.0, law, grips, kept=1.5)
    study = study_of_chains(chains, grips, noise=3e-4, seed=1)
    prior = Unknown("friction.initial_set", prior={"mean": 0.0, "std": 3.0})
    found, new = (
        fit(replace(study, effects=(FRICTION,), unknowns=(*study.unknowns, *OF_FRICTION[:2], *more))) for more in ((prior,), ())
    )
    e = {name: estimate.value for name, estimate in found.estimates.items()}
    assert e["bending_stiffness"] == pytest.approx(0.05, rel=0.05)
    assert e["friction.share"] == pytest.approx(0.6, rel=0.15)
    assert e["friction.initial_set"][1] == pytest.approx(-1.5, rel=0.15)  # the plane of the chain is that across -d2
    assert abs(e["friction.initial_set"][0]) < 0.1
    assert found.posterior.score > new.posterior.score + 100.0
    assert max(p.rms for p in found.poses.values()) < 0.5 * min(p.rms for p in new.poses.values())


def test_what_cannot_follow_the_order_says_so():
    study = replace(ordered(), tolerance=Tolerance())
    for call in (residual_function, traced_problem):
        with pytest.raises(Scan2FlexError, match="friction makes poses depend on those before them"):
            call(study)
