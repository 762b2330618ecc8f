"""Axes of scans err alike along a pose: that is noise of theirs, and of no measured curve."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.diagnosis import run, stage
from scan2flex_jax.fitting.least_squares import silent
from scan2flex_jax.study import MeasuredCurve

from . import scenes

pytestmark = pytest.mark.slow
RADIUS = 0.02  # m: its hundredth is the noise of the scenes


def test_an_offset_of_each_pose_is_known_of_scans_and_smooth_noise_of_curves():
    """Each pose moved aside by one and a half hundredths of the radius, another way: a scanner that misjudges the radius."""
    rng, study = np.random.default_rng(4), scenes.study(seed=5)
    away = rng.standard_normal((len(study.poses), 3))
    away *= 1.5e-2 * RADIUS / np.linalg.norm(away, axis=1, keepdims=True)
    poses = [replace(p, curve=MeasuredCurve(p.curve.points + d)) for p, d in zip(study.poses, away, strict=True)]
    moved = replace(study, poses=tuple(poses), cable=study.cable | {"radius": RADIUS})
    given = {"elements": 40, "say": silent, "seed": 0, "mesh": False}
    scanned, measured = (run._base(moved, scanned=of_scans, **given).stage for of_scans in (True, False))
    assert scanned.noise.alike == pytest.approx(0.01 * RADIUS)
    assert measured.noise.alike == 0.0
    assert scanned.noise.total == pytest.approx(scenes.NOISE, rel=0.1)
    assert measured.noise.total > 1.2 * scenes.NOISE
    assert stage.test(scanned).p_value > 0.05


def test_a_pose_seen_from_one_side_has_a_noise_of_its_own_size():
    """Four times the noise in one pose of four: known to the fit's law of it, and no alarm; its neighbours keep theirs."""
    rng, study = np.random.default_rng(6), scenes.study(seed=7)
    rough = study.poses[1]
    rough = replace(rough, curve=MeasuredCurve(rough.curve.points + 15**0.5 * scenes.NOISE * rng.standard_normal((60, 3))))
    poses = (study.poses[0], rough, *study.poses[2:])
    base = run._base(
        replace(study, poses=poses, cable=study.cable | {"radius": RADIUS}),
        elements=40, say=silent, seed=0, mesh=False, scanned=True,
    )
    others = np.delete(base.signatures.scales, 1)
    assert base.signatures.scales[1] / np.mean(others) == pytest.approx(4.0, rel=0.2)
    assert np.ptp(others) < 0.3 * np.mean(others)
    own = base.stage.noise.total * np.array(base.stage.law.scales)
    assert np.mean(np.delete(own, 1)) == pytest.approx(scenes.NOISE, rel=0.15)
    assert stage.test(base.stage).p_value > 0.05
