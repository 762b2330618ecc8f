"""The mixture of honest, flying and stray points: what made the residuals is found in them."""

import numpy as np
import pytest
from scipy.integrate import quad

from scan2flex_jax.scan import sensor_noise

SIGMA, REACH, WINDOW = 4e-3, 0.025, 0.03


def made(count=6000, flying=0.15, strays=0.05, shift=0.0, key=0):
    """Residuals (1, n) in m of one viewpoint, and their rays' distance from the axis (1, n) in radii."""
    rng = np.random.default_rng(key)
    e = SIGMA * rng.normal(size=count) + shift
    fly = rng.uniform(size=count) < flying
    e = np.where(fly, e + rng.uniform(0.0, REACH, count), e)
    e = np.where(rng.uniform(size=count) < strays, rng.uniform(-WINDOW, WINDOW, count), e)
    return e[None], rng.uniform(0.0, 1.0, (1, count))


def settled(e, side, rounds=150):
    real, one = np.ones(e.shape, bool), np.ones(e.shape)
    m = sensor_noise.first_guess(0.5 * SIGMA, WINDOW, 1)
    for _ in range(rounds):
        m = sensor_noise.update(m, sensor_noise.judge(e, one, side, real, m), e, real[0], 1e-6)
    return m, sensor_noise.judge(e, one, side, real, m)


def test_the_shares_and_sizes_are_found():
    m, _ = settled(*made())
    assert abs(m.sigma / SIGMA - 1.0) < 0.08
    assert abs(m.reach / REACH - 1.0) < 0.25
    np.testing.assert_allclose(m.flying, 0.15, atol=0.05)
    assert abs(m.strays - 0.05) < 0.03


def test_flying_points_do_not_move_the_surface():
    """What is left of the mean residual: a tenth of what the flying points add to it."""
    e, side = made(strays=0.0)
    _, j = settled(e, side)
    assert np.mean(e) > 0.4 * SIGMA
    assert abs(np.sum(j.weight * j.noise) / np.sum(j.weight)) < 0.1 * np.mean(e)


@pytest.mark.parametrize("e", [-0.006, 0.0, 0.004, 0.015, 0.028])
def test_the_noise_of_a_point_is_its_conditional_mean(e):
    """Against quadrature over the flight, for a mixture without strays."""
    m = sensor_noise.first_guess(SIGMA, WINDOW, 1)
    share = m.flying[0]

    def normal(x):
        return np.exp(-0.5 * (x / SIGMA) ** 2) / (SIGMA * np.sqrt(2.0 * np.pi))

    def over_flights(power):
        return quad(lambda d: (e - d) ** power * normal(e - d) / m.reach, 0.0, m.reach, epsrel=1e-10)[0]

    honest = (1.0 - share) * normal(e)
    expected = (honest * e + share * over_flights(1)) / (honest + share * over_flights(0))
    j = sensor_noise.judge(np.array([[e]]), np.ones((1, 1)), np.zeros((1, 1)), np.ones((1, 1), bool), m)
    np.testing.assert_allclose(j.noise[0, 0], expected, rtol=1e-6, atol=1e-9)
