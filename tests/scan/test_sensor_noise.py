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


def test_a_shift_of_all_points_is_not_taken_for_flight():
    """A curve that lies half a sigma before its surface is still told to move back; a share of the shift looks like flight."""
    e, side = made(flying=0.0, strays=0.02, shift=0.5 * SIGMA)
    _, j = settled(e, side)
    assert np.sum(j.weight * j.noise) / np.sum(j.weight) > 0.1 * SIGMA


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


def test_information_is_lost_where_points_may_fly():
    _, clean = settled(*made(flying=0.0, strays=0.0))
    _, mixed = settled(*made(flying=0.3, strays=0.05))
    assert clean.known > 0.9
    assert 0.3 <= mixed.known < clean.known


def test_a_second_viewpoint_takes_the_points_that_it_explains():
    rng = np.random.default_rng(1)
    own = SIGMA * rng.normal(size=(2, 1000))
    e = np.array([np.r_[own[0], own[1] + 0.02], np.r_[own[0] + 0.02, own[1]]])
    side, real = np.full(e.shape, 0.3), np.ones(e.shape, bool)
    m = sensor_noise.first_guess(SIGMA, WINDOW, 2)
    for _ in range(20):
        m = sensor_noise.update(m, sensor_noise.judge(e, np.ones(e.shape), side, real, m), e, real[0], 1e-6)
    j = sensor_noise.judge(e, np.ones(e.shape), side, real, m)
    assert np.mean(j.weight[0, :1000]) > 0.9 and np.mean(j.weight[1, 1000:]) > 0.9
    np.testing.assert_allclose(m.views, 0.5, atol=0.03)
