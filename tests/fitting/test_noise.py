"""The noise of measured curves as their points show it, each pose with its own, and the likely discrepancy of a residual."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

from scan2flex_jax.fitting.discrepancy import Discrepancy, most_likely_part
from scan2flex_jax.fitting.noise import Noise, white_noise
from scan2flex_jax.inference import fit
from scan2flex_jax.study import MeasuredCurve

from . import scenes

LENGTH, POINTS = 1.0, 64
S = LENGTH * np.linspace(0.01, 0.99, POINTS)
FINE, ROUGH = 1e-4, 5e-3  # m


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


def fitted(noises, *poses):
    """The fit of poses with white noise of these sizes (m), stated."""
    study, rng = scenes.study_of(poses=poses or scenes.NAMES[:3]), np.random.default_rng(5)
    curves = scenes.exact_curves(study, scenes.TRUE)
    noisy = [MeasuredCurve(c + size * rng.standard_normal(c.shape)) for c, size in zip(curves, noises, strict=True)]
    poses = tuple(replace(p, curve=c, noise=n) for p, c, n in zip(study.poses, noisy, noises, strict=True))
    return fit(replace(study, poses=poses), elements=scenes.ELEMENTS)


def precision(found):
    """Inverse covariance (2, 2) of the logarithms of EI and GJ."""
    spread = np.array([found.estimates[name].std / found.estimates[name].value for name in scenes.TRUE])
    return np.linalg.inv(found.correlation * np.outer(spread, spread))


@pytest.mark.slow
def test_poses_weigh_by_their_own_noise():
    """Information adds up: what two poses of 50 times the noise tell, and the fine one, each fitted alone."""
    whole, fine, rough = fitted((ROUGH, FINE, ROUGH)), fitted((FINE,), "twist-90"), fitted((ROUGH, ROUGH), "plane", "aside-45")
    both = np.sqrt(np.diag(np.linalg.inv(precision(fine) + precision(rough))))
    for (name, value), std in zip(scenes.TRUE.items(), both, strict=True):
        e = whole.estimates[name]
        assert abs(e.value - value) < 3.0 * e.std
        assert e.std / e.value == pytest.approx(std, rel=0.25)


def test_equal_noises_are_those_of_before():
    """A noise that all poses state is that of the fit, whatever its size."""
    whole = fitted((FINE, FINE, FINE))
    assert whole.noise.total == pytest.approx(FINE, rel=0.3)
    assert whole.problem.poses.noise is None
