"""The noise of a pose is its own: rough markers beside a fine scan take nothing from what the scan tells."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.inference import fit
from scan2flex_jax.study import MeasuredCurve
from tests.fitting import scenes

FINE, ROUGH = 1e-4, 5e-3  # m
TRUE = {"bending_stiffness": scenes.EI, "torsional_stiffness": scenes.GJ}
NAMES = ("plane", "twist-90", "aside-45")


def fitted(noises, poses=NAMES):
    """The fit of poses with white noise of these sizes (m), stated."""
    study, rng = scenes.study_of(poses=poses), np.random.default_rng(5)
    curves = scenes.exact_curves(study, TRUE)
    noisy = [MeasuredCurve(c + size * rng.standard_normal(c.shape)) for c, size in zip(curves, noises, strict=True)]
    poses = tuple(replace(p, curve=c, noise=n) for p, c, n in zip(study.poses, noisy, noises, strict=True))
    return fit(replace(study, poses=poses), elements=scenes.ELEMENTS)


def precision(found):
    """Inverse covariance (2, 2) of the logarithms of EI and GJ."""
    spread = np.array([found.estimates[name].std / found.estimates[name].value for name in TRUE])
    return np.linalg.inv(found.correlation * np.outer(spread, spread))


@pytest.mark.slow
def test_poses_weigh_by_their_own_noise():
    """Information adds up: what two poses of 50 times the noise tell, and the fine one, each fitted alone."""
    whole, fine, rough = fitted((ROUGH, FINE, ROUGH)), fitted((FINE,), NAMES[1:2]), fitted((ROUGH, ROUGH), NAMES[::2])
    both = np.sqrt(np.diag(np.linalg.inv(precision(fine) + precision(rough))))
    for (name, value), std in zip(TRUE.items(), both, strict=True):
        e = whole.estimates[name]
        assert abs(e.value - value) < 3.0 * e.std
        assert e.std / e.value == pytest.approx(std, rel=0.25)


def test_equal_noises_are_those_of_before():
    """A noise that all poses state is that of the fit, whatever its size."""
    whole = fitted((FINE, FINE, FINE))
    assert whole.noise.total == pytest.approx(FINE, rel=0.3)
    assert whole.problem.poses.noise is None
