"""95 % intervals hold the truth 95 times in 100, for white noise of a scanner (0.3 mm) that nobody states."""

import numpy as np
import pytest
from scipy import stats

from scan2flex_jax.inference import fit

from . import scenes

DRAWS, NOISE = 40, 3e-4
TRUE = {"bending_stiffness": scenes.EI, "torsional_stiffness": scenes.GJ}


@pytest.fixture(scope="module")
def fits():
    study = scenes.study_of()
    curves = scenes.exact_curves(study, TRUE)
    return [fit(scenes.measured(study, curves, NOISE, seed), elements=scenes.ELEMENTS) for seed in range(DRAWS)]


@pytest.mark.slow
@pytest.mark.parametrize("name", list(TRUE))
def test_intervals_cover(fits, name):
    estimates = [f.estimates[name] for f in fits]
    covered = sum(e.low <= TRUE[name] <= e.high for e in estimates)
    assert covered >= stats.binom.ppf(1e-3, DRAWS, 0.95), covered
    z = np.array([(e.value - TRUE[name]) / e.std for e in estimates])
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
    values = np.array([[f.estimates[n].value for n in TRUE] for f in fits])
    quoted = np.mean([f.correlation[0, 1] for f in fits])
    assert abs(np.arctanh(np.corrcoef(values.T)[0, 1]) - np.arctanh(quoted)) < 3.5 / np.sqrt(DRAWS - 3)
