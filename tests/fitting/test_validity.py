"""Poses that were never fitted: off by no more than noise, their own tolerances and the estimates' errors, or not."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from scan2flex_jax.fitting import FitSettings, fit
from scan2flex_jax.fitting.belief import validity
from scan2flex_jax.fitting.noise import Noise
from scan2flex_jax.fitting.parameters import layout_of
from scan2flex_jax.fitting.statistics import unseen_spread
from scan2flex_jax.study import Tolerance

from . import scenes

TRUE = {"bending_stiffness": scenes.EI, "torsional_stiffness": scenes.GJ}
LOOSE, NOISE = Tolerance(clamp_rotation=0.02), 2e-4  # rad and m


@pytest.fixture(scope="module")
def turned():
    """Four poses whose clamps are turned within the tolerance; the last one is kept for validation."""
    study = scenes.study_of(poses=("plane", "twist-90", "aside-45", "unseen"), tolerance=LOOSE)
    study = replace(study, poses=tuple(replace(p, role="fit") for p in study.poses))
    local = np.zeros((4, 12))
    local[:, [3, 4, 9, 10]] = np.random.default_rng(5).standard_normal((4, 4))
    local[3, [3, 4, 9, 10]] = [1.0, -1.2, 0.8, 1.1]
    measured = scenes.measured(study, scenes.exact_curves(study, TRUE, local), NOISE)
    return replace(measured, poses=(*measured.poses[:3], replace(measured.poses[3], role="validate")))


def test_turned_clamps_of_a_new_pose_are_no_fault_of_the_model(turned):
    f = fit(turned)
    pose = f.poses["unseen"]
    assert pose.rms > 1.5 * np.sqrt(2) * NOISE
    assert pose.spread > pose.rms / 3
    assert f.valid is True
    assert f"{1e3 * pose.spread:.2g} mm" in f.sentences[-1]


def test_without_the_tolerance_they_are(turned):
    f = fit(replace(turned, tolerance=scenes.EXACT))
    assert f.poses["unseen"].rms > 2.0 * f.poses["unseen"].spread  # beyond what the discrepancy of the poses leads to expect
    assert f.valid is False


def test_a_validate_pose_that_was_not_solved_has_no_error():
    noise = Noise(2e-4, 0.0, 0.05, 1.5)
    poses = {"seen": SimpleNamespace(role="fit"), "lost": SimpleNamespace(role="validate", rms=np.nan, spread=np.nan)}
    valid, (said,) = validity(poses, noise, 2e-4, 1.0, 0.0, misfit=False)
    assert valid is False
    assert "does not predict lost" in said and "(no equilibrium was found, noise 0.28 mm)" in said


def test_belief_is_a_matter_of_settings_that_are_stored(turned):
    f = fit(turned, settings=FitSettings(predicted=1e-3))
    assert f.valid is False
    assert FitSettings(**f.to_json()["settings"]) == f.settings == FitSettings(predicted=1e-3)
    with pytest.raises(ValueError, match="predicted is -1"):
        FitSettings(predicted=-1.0)


def test_spread_adds_variances_and_leaves_out_what_is_not_determined():
    layout = layout_of(scenes.study_of(tolerance=LOOSE))
    J = np.zeros((5, 2, layout.shared + layout.local))
    J[:, 0, 0], J[:, 0, 1], J[:, 1, -1] = 3.0, 7.0, 4.0
    assert unseen_spread(layout, J, np.diag([0.25, np.inf])) == pytest.approx(np.sqrt(1.5**2 + 4.0**2))


@pytest.mark.parametrize(("stated", "offset", "believed"), [(NOISE, 0.003, False), (NOISE, 0.0, True), (None, 0.003, True)])
def test_a_residual_far_beyond_the_stated_noise_is_not_believed(stated, offset, believed):
    """Curves that bulge smoothly: with a noise stated they contradict it, without one a few millimetres may be noise."""
    f = fit(bulging(offset, stated))
    assert f.believable is believed
    said = [s for s in f.sentences if "more than the stated noise" in s]
    assert bool(said) is not believed
    assert all("pose plane is" in s or "pose twist-90 is" in s for s in said)


@pytest.mark.parametrize(("stated", "noise"), [(None, False), (0.02, True)])
def test_a_smooth_residual_beyond_one_percent_of_the_length_is_noise_only_if_stated(stated, noise):
    f = fit(bulging(0.03, stated))
    assert any("% of the length, too much for noise" in s for s in f.sentences) is not noise
    assert bool(f.misfits) is not noise
    assert noise or not f.believable


def bulging(height, stated):
    """Two poses whose curves lie ``height`` (m) aside at a quarter and at three quarters of the length."""
    study = scenes.study_of(poses=("plane", "twist-90"))
    aside = height * np.sin(3 * np.pi * scenes.STATIONS)[:, None] * np.array([0.0, 0.6, 0.8])
    return scenes.measured(study, [c + aside for c in scenes.exact_curves(study, TRUE)], NOISE, stated=stated)
