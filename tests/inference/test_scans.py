"""Axes of scans err alike along a pose: that is noise of theirs, and of no measured curve."""

from dataclasses import replace

import numpy as np
import pytest

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
    scanned, measured = (scenes.variant_of(moved, scanned=of_scans) for of_scans in (True, False))
    assert scanned.likelihood.alike == pytest.approx(0.01 * RADIUS)
    assert measured.likelihood.alike == 0.0
    noise = [v.likelihood.noise(v.empty.u).total for v in (scanned, measured)]
    assert noise[0] == pytest.approx(scenes.NOISE, rel=0.2)
    assert noise[1] > max(1.1 * noise[0], 1.2 * scenes.NOISE) or measured.empty.discrepant
    assert not scanned.empty.discrepant
