"""A stated noise stays the noise: what is left far beyond it is not noise, whatever its correlation."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.inference import explain
from scan2flex_jax.study import MeasuredCurve

from . import scenes

pytestmark = pytest.mark.slow


OPEN = pytest.mark.xfail(reason="open: a smooth misfit of thrice the stated noise passes as noise, not yet looked into")


@pytest.mark.parametrize("stated", [pytest.param(scenes.NOISE, marks=OPEN), None])
def test_a_smooth_misfit_of_thrice_the_stated_noise_is_no_good_answer(stated):
    """A wave of 1 mm in each pose, another one in each; unstated it may be an error of the scan, and is called one."""
    study, poses = scenes.study(seed=3), []
    for i, pose in enumerate(study.poses):
        wave = 1e-3 * np.outer(np.sin(np.linspace(0, (5 + i) * np.pi, scenes.POINTS)), np.roll([0, 1.0, 0.5], i))
        poses.append(replace(pose, noise=stated, curve=MeasuredCurve(pose.curve.points + wave)))
    found = explain(replace(study, poses=tuple(poses)), elements=40, mesh=False)
    assert found.verdict != "explained"
    assert found.answer.tone != "good" or (stated is None and found.noise.total > 2.0 * scenes.NOISE), found.answer.belief
