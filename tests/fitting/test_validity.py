"""Poses that were never fitted: off by no more than noise, their own tolerances and the estimates' errors, or not."""

import re
from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.inference import Settings, fit
from scan2flex_jax.posterior.belief import validity
from scan2flex_jax.results.answer import FAIR, two_digits
from scan2flex_jax.study import EffectDeclaration, Tolerance

from . import scenes

LOOSE, NOISE = Tolerance(clamp_rotation=0.02), 2e-4  # rad and m


@pytest.fixture(scope="module")
def turned():
    """Four poses whose clamps are turned within the tolerance; the last one is kept for validation."""
    study = scenes.to_fit(scenes.study_of(poses=scenes.NAMES, tolerance=LOOSE))
    local = np.zeros((4, 12))
    local[:, [3, 4, 9, 10]] = np.random.default_rng(5).standard_normal((4, 4))
    local[3, [3, 4, 9, 10]] = [1.0, -1.2, 0.8, 1.1]
    return scenes.held_out(scenes.measured(study, scenes.exact_curves(study, scenes.TRUE, local), NOISE))


@pytest.fixture(scope="module")
def known(turned):
    return fit(turned, elements=scenes.ELEMENTS)


def test_turned_clamps_of_a_new_pose_are_no_fault_of_the_model(known):
    pose = known.poses["unseen"]
    assert pose.rms > 1.5 * np.sqrt(2) * NOISE
    assert known.valid is True and pose.ratio < 1.5
    assert f"{two_digits(pose.ratio)} times the expected one" in known.judgement


def test_without_the_tolerance_each_pose_deviates_by_itself(turned, known):
    """What the clamps do is a discrepancy then, which the intervals know of."""
    f = fit(replace(turned, tolerance=scenes.EXACT), elements=scenes.ELEMENTS)
    assert f.discrepancy.rms > 10 * NOISE and "the deviations of poses" in f.judgement
    for name, true in scenes.TRUE.items():
        e, before = f.estimates[name], known.estimates[name]
        assert e.low < true < e.high
        assert e.high - e.low > 1.5 * (before.high - before.low)


def test_an_undeclared_mass_leaves_no_yes():
    """30 g that nobody declared, and no stated noise: a random deviation of each pose fits them, and predicts the pose never
    fitted to within itself; the interval of EI excludes the truth."""
    mass = EffectDeclaration("point_mass", {"position": 0.4, "mass": 0.03})
    made = scenes.to_fit(scenes.study_of(poses=scenes.NAMES, effects=(mass,)))
    study = replace(scenes.measured(made, scenes.exact_curves(made, scenes.TRUE), 5e-4), effects=())
    f = fit(scenes.held_out(study), elements=scenes.ELEMENTS)
    assert f.valid and f.estimates["bending_stiffness"].high < scenes.EI
    assert f.answer.tone == FAIR
    first = " ".join(line.strip() for line in f.answer.lines()[:2])
    shown = np.sqrt(2) * 5e-4
    mm = [float(x) for x in re.findall(r"([\d.]+) mm", first)]
    np.testing.assert_allclose(mm, [1e3 * f.discrepancy.rms, 1e3 * shown], rtol=0.1)
    assert "with care: poses deviate" in first and "their points show" in first and "`scan2flex explain`" in first


def test_a_validate_pose_that_was_not_solved_has_no_error(known):
    lost = replace(known.poses["unseen"], rms=np.nan, ratio=np.inf, stable=False)
    valid, said = validity(known.poses | {"unseen": lost}, known.noise, False, NOISE, 1.0, misfit=False)
    assert valid is False
    assert "does not predict unseen" in said and "(no equilibrium was found)" in said


def test_belief_is_a_matter_of_settings_that_are_stored(turned):
    f = fit(turned, elements=scenes.ELEMENTS, settings=Settings(surprise=1e-3))
    assert f.valid is False
    assert Settings(**f.to_json()["settings"]) == f.settings == Settings(surprise=1e-3)


@pytest.mark.parametrize(("stated", "words"), [(NOISE, "more than the stated noise"), (None, "")])
def test_a_smooth_residual_beyond_the_stated_noise_is_not_believed(stated, words):
    """Curves of two poses that lie 3 mm aside at a quarter and at three quarters of the length; without a stated noise they may
    be noise. One of more than a hundredth of the length may not: `test_result.py`."""
    study = scenes.study_of(poses=("plane", "twist-90"))
    aside = 3e-3 * np.sin(3 * np.pi * scenes.STATIONS)[:, None] * np.array([0.0, 0.6, 0.8])
    curves = [c + aside for c in scenes.exact_curves(study, scenes.TRUE)]
    f = fit(scenes.measured(study, curves, NOISE, stated=stated), elements=scenes.ELEMENTS)
    assert f.believable is not bool(words)
    assert bool(f.misfits) is bool(words)
    said = [s for s in f.misfits if words in s]
    assert all("pose plane is" in s or "pose twist-90 is" in s for s in said) and bool(said) is bool(words)
