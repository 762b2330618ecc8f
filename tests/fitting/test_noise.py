"""The noise of measured curves as their points show it, the most likely discrepancy of a residual, and points in a plane."""

from typing import NamedTuple

import numpy as np
import pytest

from scan2flex_jax.fitting.discrepancy import Discrepancy, most_likely_part
from scan2flex_jax.fitting.noise import Noise, white_noise

LENGTH, POINTS = 1.0, 64
S = LENGTH * np.linspace(0.01, 0.99, POINTS)
TRUE = np.array([2.0e-4, 4.0e-4, 0.07])  # white, correlated (m), correlation length (m)


def smooth_columns(count=6):
    """What a random curvature does to a clamped cable: waves that vanish at both ends, (POINTS, 2, 2 count) in m per 1/m."""
    waves = np.stack([np.sin(np.pi * (k + 1) * S / LENGTH) * 0.05 / (k + 1) ** 2 for k in range(count)], axis=1)
    return np.einsum("mk,ab->mabk", waves, np.eye(2)).reshape(POINTS, 2, 2 * count)


def test_most_likely_part_of_a_residual_is_the_discrepancy():
    """Against the dense formula ``K (K + C)^-1 r``; far above the noise it is the discrepancy itself."""
    rng, Z, noise = np.random.default_rng(6), smooth_columns(), Noise(3e-4, 1e-4, 0.1)
    true = 0.2 * Z @ rng.standard_normal(Z.shape[-1])
    r = true + 3e-4 * rng.standard_normal((POINTS, 2))
    flat = np.concatenate(list(0.2 * Z.transpose(1, 0, 2)))
    K, C = flat @ flat.T, np.kron(np.eye(2), noise.covariance(S))
    dense = (K @ np.linalg.solve(K + C, np.concatenate(list(r.T)))).reshape(2, POINTS).T
    found = most_likely_part(0.2, np.concatenate([Z, Z[:, :1]], axis=1), r, noise.covariance(S))
    np.testing.assert_allclose(found, dense, atol=1e-12)
    moved = Discrepancy(0.2, LENGTH, (), (found,))
    np.testing.assert_allclose(moved.rms, np.sqrt(np.mean(np.sum(true**2, axis=1))), rtol=0.05)
    assert Discrepancy().rms == 0.0


class Curve(NamedTuple):
    """What a pose tells of its noise."""

    points: np.ndarray
    noise: float | None = None

    @property
    def curve(self):
        return self


@pytest.mark.parametrize("uneven", [0.0, 0.8])
@pytest.mark.parametrize(("sigma", "within"), [(0.0, 0.0), (1e-5, 0.03), (5e-3, 0.2)])
def test_uneven_points_are_no_noise(uneven, sigma, within):
    """A helix at points some 5 mm apart, at distances that vary: its noise is found again, also where it is far smaller."""
    rng = np.random.default_rng(5)
    found = []
    for _ in range(10):
        s = (np.arange(200) + uneven * rng.uniform(-0.5, 0.5, 200)) / 200
        helix = np.stack([0.25 * np.cos(3 * s), 0.25 * np.sin(3 * s), 0.4 * s], axis=1)
        found.append(white_noise(Curve(helix + sigma * rng.standard_normal(helix.shape))))
    assert np.mean(found) == pytest.approx(sigma, rel=within, abs=1e-7)


def test_white_noise_of_few_or_repeated_points():
    line = np.linspace([0.0, 0.0, 0.0], [1.0, 0.5, 0.2], 30)
    repeated = np.repeat(line, 2, axis=0)
    assert white_noise(Curve(repeated)) < 1e-12
    assert white_noise(Curve(line[:4])) == np.inf
    assert white_noise(Curve(np.repeat(line[:2], 10, axis=0))) == np.inf
    assert white_noise(Curve(line[:4], noise=2e-4)) == 2e-4
