"""The spline, the snakes energy, its gradient, and its minimisers."""

import jax
import jax.numpy as jnp
import numpy as np
from scipy.interpolate import CubicSpline

from scan2flex_jax.scan import shapes, snakes, spline

RADIUS = 0.02


def circle_points(count=40, radius=0.3):
    a = np.linspace(0.0, 1.5 * np.pi, count)
    return radius * np.stack([np.cos(a), np.sin(a), 0.0 * a], axis=1)


def problem(points=600, weights=None):
    curve = shapes.helix(1.0, RADIUS)
    rng = np.random.default_rng(3)
    t = np.gradient(curve, axis=0)
    t /= np.linalg.norm(t, axis=1, keepdims=True)
    which = rng.integers(0, len(curve), points)
    off = np.cross(t[which], rng.normal(size=(points, 3)))
    cloud = curve[which] + RADIUS * off / np.linalg.norm(off, axis=1, keepdims=True)
    x0 = spline.evenly(curve, 12) + 0.2 * RADIUS * rng.normal(size=(12, 3))
    flags = jnp.zeros(len(snakes.gap_samples(12)), bool)
    return jnp.asarray(x0), snakes.SnakesProblem(
        jnp.asarray(cloud),
        jnp.full(points, RADIUS),
        jnp.ones(points, bool),
        flags,
        jnp.asarray(RADIUS),
        weights or snakes.SnakesWeights(),
    )


def test_the_spline_is_the_interpolating_cubic_of_scipy():
    x = circle_points(9)
    t = np.linspace(0.0, 8.0, 57)
    c = spline.coefficients(jnp.asarray(x))
    for order in (0, 1, 2):
        exact = CubicSpline(np.arange(9), x, bc_type="not-a-knot")(t, order)
        np.testing.assert_allclose(spline.evaluate(c, jnp.asarray(t), order), exact, atol=1e-12)
    np.testing.assert_allclose(spline.weights(9, jnp.asarray(t)) @ x, spline.evaluate(c, jnp.asarray(t)), atol=1e-12)
    middle = spline.evaluate(c, jnp.arange(8) + 0.5, 1)
    np.testing.assert_allclose(spline.half_knot_tangents(c), middle, atol=1e-12)


def test_the_terms_are_the_published_ones():
    """For points on a straight, evenly spaced curve nothing is left but the data term; a turn by 90 degrees costs 1."""
    x = jnp.stack([jnp.linspace(0.0, 1.0, 11), jnp.zeros(11), jnp.zeros(11)], axis=1)
    _, base = problem()
    cloud = jnp.stack([jnp.linspace(0.05, 0.95, 600), jnp.full(600, 1.1 * RADIUS), jnp.zeros(600)], axis=1)
    flags = jnp.zeros(len(snakes.gap_samples(11)), bool)
    weights = snakes.SnakesWeights(1.0, 1.0, 1.0, 1e6)
    straight = snakes.SnakesProblem(cloud, base.radii, base.real, flags, base.radius, weights)
    terms = snakes.snakes_terms(x, straight)
    np.testing.assert_allclose(terms["data"], 0.01, rtol=1e-6)  # ((1.1 r - r)/r)^2
    assert max(abs(float(terms[k])) for k in ("smooth", "uneven")) < 1e-20
    v = spline.half_knot_tangents(spline.coefficients(jnp.asarray(circle_points(11))))
    v = v / jnp.linalg.norm(v, axis=1, keepdims=True)
    mean_cosine = jnp.mean(jnp.sum(v[1:] * v[:-1], axis=1))
    terms = snakes.snakes_terms(jnp.asarray(circle_points(11)), straight)
    np.testing.assert_allclose(terms["smooth"], 1.0 - mean_cosine, rtol=1e-9)


def test_the_gradient_is_that_of_finite_differences():
    x0, base = problem()
    rng = np.random.default_rng(1)
    direction = jnp.asarray(rng.normal(size=x0.shape)) * RADIUS
    step = 1e-5
    ahead, behind = (snakes.snakes_energy(x0 + way * step * direction, base) for way in (1, -1))
    expected = (ahead - behind) / (2 * step)
    slope = jnp.sum(jax.grad(snakes.snakes_energy)(x0, base) * direction)
    np.testing.assert_allclose(slope, expected, rtol=1e-5)


def test_the_minimum_is_stationary():
    x0, base = problem()
    x = jnp.asarray(snakes.minimise_snakes(np.asarray(x0), base))
    slope = [RADIUS * np.linalg.norm(jax.grad(snakes.snakes_energy)(at, base)) for at in (x0, x)]
    assert snakes.snakes_energy(x, base) < snakes.snakes_energy(x0, base)
    assert slope[1] < 1e-3 * slope[0]
