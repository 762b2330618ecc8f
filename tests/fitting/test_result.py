"""Results: real measured studies, the format's JSON object, and the calibrated study."""

import json
from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.fitting.noise import Noise
from scan2flex_jax.inference import METHODS, fit
from scan2flex_jax.posterior.estimate import Estimate
from scan2flex_jax.results.fit_result import PoseFit
from scan2flex_jax.study import EffectDeclaration, Unknown, load_study, save_study

from . import scenes


@pytest.fixture(scope="module")
def real():
    return fit(scenes.example("textile-strip"))


def test_real_studies_are_fitted_and_not_believed(real):
    """No plain rod predicts the pose that was never fitted: the verdict says so, beside estimates that are finite."""
    assert real.valid is False
    assert any("missing or misread" in s for s in real.sentences), real.sentences
    assert all(np.isfinite(e.value) and e.value > 0 for e in real.estimates.values())
    assert {p.role for p in real.poses.values()} == {"fit", "validate"}
    assert all(p.stable for p in real.poses.values())
    assert real.rms("validate") > 1.2 * real.rms()


def test_a_fit_that_has_not_settled_is_not_to_be_believed(real):
    near = replace(real, misfits=(), valid=None)
    assert near.believable
    assert not replace(near, converged=False).believable
    assert "has not converged within its iterations" in replace(near, converged=False).doubts[0]
    stalled = replace(near, converged=False, minimum=replace(near.minimum, stalled=True))
    assert "has stalled: no step lowers its cost as predicted" in stalled.doubts[0]
    name, pose = next(iter(near.poses.items()))
    assert not replace(near, poses=near.poses | {name: replace(pose, stable=False)}).believable


def test_a_pose_far_from_its_curve_is_not_to_be_believed(real):
    """The plain rod leaves a smooth residual of more than 1 % of the length, and the study states no noise."""
    assert not real.believable and real.answer.belief.startswith("no: ")
    told = real.to_json()
    assert told["believable"] is False
    for name, e in real.estimates.items():
        assert e.low is e.high is e.std is None and set(told["estimates"][name]) == {"value", "identifiable", "at_bound"}
    assert "(no interval: not reliable)" in real.summary()
    assert set(real.misfits) <= set(real.sentences)
    assert all("% of the length, too much for noise" in s for s in real.misfits)


def check_object(data):
    """Keys and types of the format's result object."""
    assert data["format"] == "scan2flex-result/1"
    assert data["method"] in METHODS
    for e in data["estimates"].values():
        assert {"value", "identifiable", "at_bound"} <= e.keys() <= {"value", "std", "low", "high", "identifiable", "at_bound"}
        assert type(e["identifiable"]) is bool and type(e["at_bound"]) is bool
        assert ("low" in e) == ("high" in e) == ("std" in e)
    for p in data["poses"].values():
        assert p["role"] in ("fit", "validate") and type(p["stable"]) is bool
        assert p.get("rms", 0.0) <= p.get("max", 0.0)
    assert data["noise"].keys() == {"white", "correlated", "correlation_length"}
    size = len(data["correlations"]["names"])
    assert np.shape(data["correlations"]["matrix"]) == (size, size)
    assert data["seconds"] > 0 and data["equilibria"] > 0


def test_json_of_real_studies(real):
    check_object(json.loads(json.dumps(real.to_json(), allow_nan=False)))
    assert real.study.title in real.summary()


def test_json_without_error_bars_has_no_nan():
    """A plane pose and both stiffnesses: GJ has no standard error, and nothing in the file is NaN or infinite."""
    study = scenes.study_of(poses=("plane",))
    f = fit(scenes.measured(study, scenes.exact_curves(study, scenes.TRUE), 3e-4), elements=scenes.ELEMENTS)
    data = json.loads(json.dumps(f.to_json(), allow_nan=False))
    check_object(data)
    assert data["estimates"]["torsional_stiffness"]["identifiable"] is False
    assert "valid" not in data  # no pose to tell


def test_unsolved_pose_has_no_distances():
    nothing = np.zeros((0, 3))
    pose = PoseFit("validate", np.nan, np.nan, False, nothing, nothing, np.zeros(0), nothing, "no equilibrium found")
    assert pose.to_json() == {"role": "validate", "stable": False}


def test_estimate_as_json():
    unsure = Estimate(np.array([1.0, 2.0]), None, None, None, False, True, "1/m")
    assert unsure.to_json() == {"value": [1.0, 2.0], "identifiable": False, "at_bound": True}
    assert Noise(3e-4, 4e-4, 0.1).total == pytest.approx(5e-4)


def test_calibrated_study_is_saved_and_read_again(real, tmp_path):
    calibrated = real.calibrated
    for name, e in real.estimates.items():
        assert calibrated.cable[name] == e.value and calibrated.start_value(name) == e.value
    save_study(calibrated, tmp_path)
    assert load_study(tmp_path) == calibrated
    assert real.study.title == calibrated.title and len(calibrated.poses) == len(real.study.poses)


@pytest.mark.parametrize(("low", "high"), [(0.003, 0.0123), (0.15, 1.0), (0.17, 0.7), (1e-3, 0.07)])
def test_calibrated_study_at_a_bound(real, low, high, tmp_path):
    """What comes back of a bound from its logarithm can be read."""
    study = scenes.study_of([Unknown("bending_stiffness", low=low, high=high)])
    for bound in np.exp(np.log([low, high])):
        e = Estimate(float(bound), None, None, None, True, True, "N m^2")
        save_study(replace(real, study=study, estimates={"bending_stiffness": e}).calibrated, tmp_path / str(bound))
        assert load_study(tmp_path / str(bound)).start_value("bending_stiffness") == pytest.approx(bound, rel=1e-12)


def test_calibrated_effect(real):
    """An estimate of an effect's parameter goes into that effect."""
    mass = EffectDeclaration("point_mass", {"position": 0.4})
    study = scenes.study_of([Unknown("point_mass.mass")], effects=[mass])
    e = Estimate(0.03, 0.001, 0.028, 0.032, True, False, "kg")
    f = replace(real, study=study, estimates={"point_mass.mass": e})
    assert f.calibrated.effects[0].parameters == {"position": 0.4, "mass": 0.03}
    assert f.calibrated.unknowns[0].guess == 0.03
