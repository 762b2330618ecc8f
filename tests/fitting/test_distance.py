"""Distances between curves: closed forms, indifference to the parametrisation, and gradients."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax.fitting.distance import closest_arc_length, integrated_residuals, normal_residuals

L, N = 1.3, 40
DS = L / N
NODES = jnp.linspace(0.0, L, N + 1)


def same(x):
    return x


def arc(curvature, s=NODES, offset=0.0):
    """Points of the arc from the origin along x in the plane x-y, or of the one ``offset`` further out; its tangents."""
    turn = curvature * s
    tangent = jnp.stack([jnp.cos(turn), jnp.sin(turn), 0 * s], axis=1)
    outward = jnp.stack([jnp.sin(turn), -jnp.cos(turn), 0 * s], axis=1)
    points = jnp.stack([jnp.sin(turn), 1 - jnp.cos(turn), 0 * s], axis=1) / curvature
    return points + offset * outward, tangent


def straight():
    return jnp.stack([NODES, 0 * NODES, 0 * NODES], axis=1), jnp.tile(jnp.array([1.0, 0, 0]), (N + 1, 1))


nearest = jax.jit(normal_residuals, static_argnums=5)
equal_length = jax.jit(integrated_residuals, static_argnums=5)


def test_shifted_straight_line():
    s = L * jnp.linspace(0.1, 0.9, 23) ** 1.5  # uneven, and short of both ends
    points = jnp.stack([s, 0 * s + 3e-3, 0 * s - 4e-3], axis=1)
    residual, at = nearest(*straight(), DS, points, s, same)
    np.testing.assert_allclose(np.linalg.norm(residual, axis=1), 5e-3, rtol=1e-12)
    np.testing.assert_allclose(residual[:, 2], 0.0, atol=1e-15)
    np.testing.assert_allclose(at, s, atol=1e-12)


def test_circle_of_another_radius():
    """Concentric arcs are their difference in radius apart; the Hermite curve is short of that by (ds k)^4 / 384 / k."""
    curvature, apart = 2.5, 7e-3
    r, d3 = arc(curvature)
    points, _ = arc(curvature, L * jnp.linspace(0.05, 0.95, 31), apart)
    residual, at = nearest(r, d3, DS, points, L * jnp.linspace(0.05, 0.95, 31), same)
    np.testing.assert_allclose(np.linalg.norm(residual, axis=1), apart, atol=(DS * curvature) ** 4 / 384 / curvature)
    np.testing.assert_allclose(at, L * np.linspace(0.05, 0.95, 31), atol=1e-6)
    assert np.ptp(np.asarray(residual), axis=0).max() < 1e-6  # normals do not turn about the tangent


def test_fourth_order_in_the_mesh():
    errors = []
    for n in (10, 20):
        s = jnp.linspace(0.0, L, n + 1)
        points, _ = arc(2.5, L * jnp.linspace(0.03, 0.97, 77))
        residual, _ = nearest(*arc(2.5, s), L / n, points, L * jnp.linspace(0.03, 0.97, 77), same)
        errors.append(np.linalg.norm(residual, axis=1).max())
    assert np.log2(errors[0] / errors[1]) > 3.9


def test_window_keeps_the_branch():
    """Where a loop crosses itself, the point is sought where its arc length puts it."""
    r, d3 = arc(2 * jnp.pi / L)  # a closed circle: both ends lie at the origin
    for expected, found in ((0.02 * L, 0.0), (0.98 * L, L)):
        at = closest_arc_length(r, d3, DS, jnp.zeros(3), jnp.array(expected))
        np.testing.assert_allclose(at, found, atol=1e-9)


def test_beyond_an_end_the_tangential_part_counts():
    points = jnp.array([[-2e-3, 1e-3, 0.0], [L + 3e-3, 0.0, 0.0], [0.5 * L, 0.0, 2e-3]])
    residual, at = nearest(*straight(), DS, points, jnp.array([0.0, L, 0.5 * L]), same)
    np.testing.assert_allclose(np.linalg.norm(residual, axis=1), [np.hypot(2e-3, 1e-3), 3e-3, 2e-3], rtol=1e-12)
    np.testing.assert_allclose(residual[:, 2], [-2e-3, 3e-3, 0.0], atol=1e-15)
    np.testing.assert_allclose(at, [0.0, L, 0.5 * L], atol=1e-12)


@pytest.mark.parametrize("distance", [nearest, equal_length])
def test_first_two_components_are_normals(distance):
    """In whatever plane the curve lies: an arc of the plane x-z that is missed within this plane only."""
    swap = jnp.array([0, 2, 1])
    r, d3 = (x[:, swap] for x in arc(2.5))
    s = L * jnp.linspace(0.05, 0.95, 31)
    points, _ = arc(2.5, s, 7e-3)
    residual, _ = distance(r, d3, DS, points[:, swap], s, same)
    inner = np.asarray(residual)[1:-1]  # the integrated one halves the share of the ends
    np.testing.assert_allclose(np.linalg.norm(inner[:, :2], axis=1), 7e-3, rtol=0.05)
    np.testing.assert_allclose(inner[:, 2], 0.0, atol=1e-6)


def test_integrated_residuals_are_pi():
    """Two straight lines that part by the angle phi: Pi = 4 L^2 sin(phi/2)^2 / 3, for any spacing of the points."""
    phi, count = 0.1, 37
    s = L * jnp.linspace(0.0, 1.0, count) ** 1.4
    points = jnp.stack([jnp.cos(phi) * s, jnp.sin(phi) * s, 0 * s], axis=1)
    residual, _ = equal_length(*straight(), DS, points, s, same)
    pi = np.mean(np.sum(np.asarray(residual) ** 2, axis=1))
    np.testing.assert_allclose(pi, 4 * L**2 * np.sin(phi / 2) ** 2 / 3, rtol=2.0 / count**2)


@pytest.mark.parametrize("distance", [normal_residuals, integrated_residuals])
def test_gradient_of_the_squared_distance(distance):
    """By central differences of the arc's curvature and length; 1e-7 is their noise."""
    rng = np.random.default_rng(0)
    s = L * jnp.linspace(0.0, 1.0, 25)
    points = arc(2.3, s, 5e-3)[0] + 2e-3 * jnp.array(rng.standard_normal((25, 3)))

    def value(p):
        """Sum of squares of the distance from an arc of curvature and length ``p``."""
        nodes = p[1] * jnp.linspace(0.0, 1.0, N + 1)
        residual, _ = distance(*arc(p[0], nodes), p[1] / N, points, s, same)
        return jnp.sum(residual**2)

    p, h = jnp.array([2.5, L]), 1e-5
    value = jax.jit(value)
    differences = [(value(p + h * e) - value(p - h * e)) / (2 * h) for e in jnp.eye(2)]
    np.testing.assert_allclose(jax.grad(value)(p), differences, rtol=2e-6, atol=1e-9)
