"""The mixture of honest, flying and stray points: what made the residuals is found in them."""

import numpy as np
import pytest
from scipy.integrate import quad

from scan2flex_jax.scan import refine, sensor_noise

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


def test_noise_like_the_radius_seen_from_two_sides():
    """Nobody says which viewpoint saw a point. Strays lie all around the cable, honest points on rays that meet it: where that
    is not known, what lies far off is taken for strays, and the noise for less than it is."""
    radius, breadth, rng = 4e-3, 15e-3, np.random.default_rng(5)
    eyes = np.array([[0.0, -9.0, 0.0], [0.0, 4.0, -8.0]])
    look = np.repeat(-eyes / np.linalg.norm(eyes, axis=1, keepdims=True), 2000, axis=0)
    across = np.cross(look, [1.0, 0.0, 0.0])
    side = rng.uniform(-0.98, 0.98, (4000, 1)) * radius
    points = side * across + (SIGMA * rng.normal(size=(4000, 1)) - np.sqrt(radius**2 - side**2)) * look
    points = points[np.linalg.norm(points, axis=1) < breadth]
    axis = np.tile([1.0, 0.0, 0.0], (len(points), 1))
    e, _, blur, beside = refine.along_ray(points, np.zeros(points.shape), axis, eyes, radius)
    told, real = beside < 1.3, np.ones(len(points), bool)
    found = []
    for band in (radius / breadth, 1.0):
        m = sensor_noise.first_guess(0.7 * SIGMA, 6.0 * SIGMA, 2, band)
        for _ in range(100):
            m = sensor_noise.update(m, sensor_noise.judge(e, blur, beside, told, m), e, real, 1e-6)
        found.append(m)
    assert abs(found[0].sigma / SIGMA - 1.0) < 0.15
    assert found[1].sigma < 0.95 * found[0].sigma
    assert found[0].strays < 0.6 * found[1].strays
