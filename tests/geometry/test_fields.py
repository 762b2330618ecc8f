"""Hat functions are the piecewise linear interpolation, traced or not; smooth random fields have the covariance they say."""

import jax
import jax.numpy as jnp
import numpy as np

from scan2flex_jax.geometry.fields import SMOOTH, hats, smooth_root

PLACES = np.linspace(0.0, 1.0, 37)
VALUES = np.random.default_rng(0).normal(size=9)


def test_hats_interpolate_linearly():
    wanted = np.interp(PLACES, np.linspace(0.0, 1.0, 9), VALUES)
    np.testing.assert_allclose(hats(PLACES, 9) @ VALUES, wanted, atol=1e-15)


def test_traced_places_give_the_same_and_a_slope():
    """The slope between two points is their difference over their distance."""
    traced = jax.jit(lambda t: hats(t, 9) @ jnp.asarray(VALUES))
    np.testing.assert_allclose(traced(jnp.asarray(PLACES)), hats(PLACES, 9) @ VALUES, atol=1e-15)
    slope = jax.grad(lambda t: hats(t[None], 9)[0] @ jnp.asarray(VALUES))(jnp.array(0.3))
    np.testing.assert_allclose(slope, 8 * (VALUES[3] - VALUES[2]), rtol=1e-12)


def test_a_smooth_field_has_unit_size_and_is_alike_over_its_distance():
    root = smooth_root(6, 2)
    K = (root @ root.T).reshape(6, 2, 6, 2)
    np.testing.assert_allclose(np.diag(K[:, 0, :, 0]), 1.0, atol=2e-6)
    np.testing.assert_allclose(K[0, 1, 1, 1], np.exp(-0.5 * (0.2 / SMOOTH) ** 2), rtol=1e-12)
    assert not K[:, 0, :, 1].any()
