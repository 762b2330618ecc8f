"""Derivatives through an equilibrium as a person types them, against central differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from . import rods

X = jnp.zeros(6)
LANES = jnp.stack([X, X + 0.05])
value = jax.jit(rods.loss)


@pytest.fixture(scope="module")
def slope():
    """Richardson-extrapolated central differences, good to 1e-7."""
    rods.start()

    def central(h):
        return np.array([(value(X + h * e) - value(X - h * e)) / (2 * h) for e in np.eye(6)])

    coarse, fine = central(2e-3), central(1e-3)
    return fine + (fine - coarse) / 3


def test_an_eager_gradient_is_that_of_differences(slope):
    np.testing.assert_allclose(jax.grad(rods.loss)(X), slope, atol=1e-6 * np.abs(slope).max())


@pytest.mark.slow
def test_vmap_of_grad(slope):
    each = jax.jit(jax.vmap(jax.grad(rods.loss)))(LANES)
    np.testing.assert_allclose(each[0], slope, atol=1e-6 * np.abs(slope).max())
    assert np.abs(each[1] - each[0]).max() > 1e-3 * np.abs(slope).max()
