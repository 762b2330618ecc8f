"""The noise estimate: the restricted likelihood against its dense form, and known noise found again.

Known scatter: the inverse of the Fisher information ``1/2 tr(C^-1 C_i C^-1 C_j)`` per normal, in logarithms.
"""

import numpy as np
import pytest

from scan2flex_jax.fitting.noise import Noise, estimate_noise, matern, restricted_likelihood

LENGTH, POINTS, POSES, DRAWS = 1.0, 64, 3, 12
S = LENGTH * np.linspace(0.01, 0.99, POINTS)
TRUE = np.array([2.0e-4, 4.0e-4, 0.07])  # white, correlated (m), correlation length (m)


def kernel(s, length):
    """Matern-3/2, written by itself."""
    d = np.abs(np.subtract.outer(s, s)) * 3**0.5 / length
    return np.exp(-d) * (1 + d)


def covariance(log):
    white, correlated, length = np.exp(log)
    return white**2 * np.eye(POINTS) + correlated**2 * kernel(S, length)


def known_scatter():
    """Standard deviations of the three logarithms, from all normals of all poses."""
    h, C = 1e-5, covariance(np.log(TRUE))
    sides = [[covariance(np.log(TRUE) + side * e) for side in (h, -h)] for e in np.eye(3)]
    slopes = [np.linalg.solve(C, up - down) / (2 * h) for up, down in sides]
    fisher = np.array([[0.5 * np.trace(a @ b) for a in slopes] for b in slopes]) * 2 * POSES
    return np.sqrt(np.diag(np.linalg.inv(fisher)))


def sensitivities(columns):
    """Smooth columns (POINTS, 2, columns), as those of a rod's parameters."""
    if columns == 0:
        return np.zeros((POINTS, 2, 0))
    waves = np.stack([np.sin(np.pi * (k + 1) * S / LENGTH) for k in range(columns)], axis=1).reshape(POINTS, 1, columns)
    return np.concatenate([waves, -0.5 * waves], axis=1)


def draw(rng, columns, explained):
    root = np.linalg.cholesky(covariance(np.log(TRUE)))
    X = sensitivities(columns)
    return [(S, root @ rng.standard_normal((POINTS, 2)) + X @ explained, X) for _ in range(POSES)]


def test_kernel():
    np.testing.assert_allclose(matern(S, 0.07), kernel(S, 0.07), rtol=1e-12)
    np.testing.assert_allclose(Noise(*TRUE).covariance(S), covariance(np.log(TRUE)), rtol=1e-12)
    assert Noise(3.0, 4.0, 1.0).total == 5.0


def test_restricted_likelihood_is_the_dense_one():
    rng = np.random.default_rng(1)
    curves = draw(rng, 2, np.zeros(2))
    r = np.concatenate([c[1][:, k] for c in curves for k in (0, 1)])
    X = np.concatenate([c[2][:, k] for c in curves for k in (0, 1)])
    noises, values = [Noise(*TRUE), Noise(5e-4, 1e-4, 0.2)], []
    for noise in noises:
        C = np.kron(np.eye(2 * POSES), noise.covariance(S))
        A = X.T @ np.linalg.solve(C, X)
        rest = r - X @ np.linalg.solve(A, X.T @ np.linalg.solve(C, r))
        values.append(0.5 * (np.linalg.slogdet(C)[1] + np.linalg.slogdet(A)[1] + r @ np.linalg.solve(C, rest)))
    ours = [restricted_likelihood(curves, n) for n in noises]
    np.testing.assert_allclose(ours[1] - ours[0], values[1] - values[0], rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("columns", [0, 3])
def test_known_noise_is_found_again(columns):
    """The mean over draws is unbiased within its scatter (and a tenth for the weak priors), the scatter is the known one;
    what the sensitivities explain, here ten times the noise, changes nothing."""
    found = []
    for seed in range(DRAWS):
        curves = draw(np.random.default_rng(seed), columns, 5e-3 * np.ones(columns))
        noise = estimate_noise(curves, LENGTH)
        found.append(np.log([noise.white, noise.correlated, noise.correlation_length]))
    scatter, error = known_scatter(), np.mean(found, axis=0) - np.log(TRUE)
    assert np.all(np.abs(error) < 3.5 * scatter / np.sqrt(DRAWS) + 0.1), error
    ratio = np.std(found, axis=0, ddof=1) / scatter
    assert np.all((ratio > 0.4) & (ratio < 1.8)), ratio


def test_white_noise_is_called_white():
    rng = np.random.default_rng(3)
    curves = [(S, 3e-4 * rng.standard_normal((POINTS, 2)), np.zeros((POINTS, 2, 0))) for _ in range(POSES)]
    noise = estimate_noise(curves, LENGTH)
    assert noise.correlated < 0.4 * noise.white
    np.testing.assert_allclose(noise.total, 3e-4, rtol=0.1)


def test_stated_noise_is_held():
    """Residuals three times as large as stated: the total stays near what the user says."""
    rng = np.random.default_rng(4)
    curves = [(S[:6], 6e-4 * rng.standard_normal((6, 2)), np.zeros((6, 2, 0)))]
    free, held = estimate_noise(curves, LENGTH), estimate_noise(curves, LENGTH, stated=2e-4)
    assert held.total < 0.75 * free.total
    assert held.total > 2e-4
