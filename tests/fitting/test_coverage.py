"""95 % intervals hold the truth 95 times in 100, for white noise of a scanner (0.3 mm) that nobody states."""

import numpy as np
import pytest
from scipy import stats

from scan2flex_jax.inference import fit
from scan2flex_jax.study import Unknown

from . import scenes

DRAWS, NOISE = 40, 3e-4


@pytest.fixture(scope="module")
def fits():
    study = scenes.study_of()
    curves = scenes.exact_curves(study, scenes.TRUE)
    return [fit(scenes.measured(study, curves, NOISE, seed), elements=scenes.ELEMENTS) for seed in range(DRAWS)]


@pytest.mark.slow
@pytest.mark.parametrize("name", list(scenes.TRUE))
def test_intervals_cover(fits, name):
    estimates = [f.estimates[name] for f in fits]
    covered = sum(e.low <= scenes.TRUE[name] <= e.high for e in estimates)
    assert covered >= stats.binom.ppf(1e-3, DRAWS, 0.95), covered
    z = np.array([(e.value - scenes.TRUE[name]) / e.std for e in estimates])
    low, high = np.sqrt(stats.chi2.ppf([1e-3, 1 - 1e-3], DRAWS) / DRAWS)
    assert low < np.sqrt(np.mean(z**2)) < high, z  # neither too narrow nor too wide
    assert abs(np.mean(z)) < 3.3 / np.sqrt(DRAWS), z


@pytest.mark.slow
def test_noise_is_found(fits):
    """Total per normal 0.3 mm, most of it white; the RMS distance is that of two normals."""
    np.testing.assert_allclose(np.mean([f.noise.total for f in fits]), NOISE, rtol=0.03)
    assert np.median([f.noise.correlated for f in fits]) < 0.5 * NOISE
    np.testing.assert_allclose(np.mean([f.rms() for f in fits]), np.sqrt(2) * NOISE, rtol=0.03)


@pytest.mark.slow
def test_correlation_is_that_of_the_draws(fits):
    """The correlation of EI and GJ that a fit quotes, against the scatter of the draws (Fisher's z, 3.5 sigma)."""
    values = np.array([[f.estimates[n].value for n in scenes.TRUE] for f in fits])
    quoted = np.mean([f.correlation[0, 1] for f in fits])
    assert abs(np.arctanh(np.corrcoef(values.T)[0, 1]) - np.arctanh(quoted)) < 3.5 / np.sqrt(DRAWS - 3)


@pytest.mark.slow
def test_noise_of_the_integrated_distance():
    """A pose in the plane x-z, noise in all directions: the noise is found at equal arc length too."""
    study = scenes.study_of([Unknown("bending_stiffness")], poses=("plane",))
    curves = scenes.exact_curves(study, {"bending_stiffness": scenes.EI})
    inner = [scenes.measured(study, curves, NOISE, seed) for seed in range(16)]
    fits = [fit(s, distance="integrated", elements=scenes.ELEMENTS) for s in inner]
    np.testing.assert_allclose(np.mean([f.noise.total for f in fits]), NOISE, rtol=0.1)
    z = [(f.estimates["bending_stiffness"].value - scenes.EI) / f.estimates["bending_stiffness"].std for f in fits]
    assert np.all(np.abs(z) < 4.0), z


def test_noise_within_the_plane_of_a_pose_counts():
    """Noise along the one normal that lies in the plane x-z, and none along y: that normal alone was measured."""
    study = scenes.study_of([Unknown("bending_stiffness")], poses=("plane",))
    (curve,) = scenes.exact_curves(study, {"bending_stiffness": scenes.EI})
    slope = np.gradient(curve, axis=0)
    normal = np.cross(slope, [0.0, 1.0, 0.0]) / np.linalg.norm(slope, axis=1)[:, None]
    noisy = curve + NOISE * np.random.default_rng(0).standard_normal((len(curve), 1)) * normal
    f = fit(scenes.measured(study, [noisy]), distance="integrated", elements=scenes.ELEMENTS)
    np.testing.assert_allclose(f.noise.total, NOISE, rtol=0.2)
