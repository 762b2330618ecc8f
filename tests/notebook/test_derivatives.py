"""Derivatives through an equilibrium as a person types them, and second ones, on which Laplace, Newton-CG and HMC rest, against
differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax import load_study, residual_function
from scan2flex_jax.examples import example_path

from . import rods

X = jnp.zeros(6)
LANES = jnp.stack([X, X + 0.05])
value = jax.jit(rods.loss)


def differences(function, x, h):
    """Richardson-extrapolated central differences."""

    def central(h):
        return np.array([(function(x + h * e) - function(x - h * e)) / (2 * h) for e in np.eye(len(x))])

    coarse, fine = central(2 * h), central(h)
    return fine + (fine - coarse) / 3


@pytest.fixture(scope="module")
def slope():
    """Good to 1e-7."""
    rods.start()
    return differences(value, X, 1e-3)


def test_an_eager_gradient_is_that_of_differences(slope):
    np.testing.assert_allclose(jax.grad(rods.loss)(X), slope, atol=1e-6 * np.abs(slope).max())


@pytest.mark.slow
def test_vmap_of_grad(slope):
    each = jax.jit(jax.vmap(jax.grad(rods.loss)))(LANES)
    np.testing.assert_allclose(each[0], slope, atol=1e-6 * np.abs(slope).max())
    assert np.abs(each[1] - each[0]).max() > 1e-3 * np.abs(slope).max()


@pytest.mark.slow
def test_hessian_of_an_equilibrium():
    """By stiffnesses, length, place and turn of a clamp, and an effect's parameter."""
    rods.start()
    H = np.asarray(jax.jit(jax.hessian(rods.loss))(X))
    expected = differences(jax.jit(jax.grad(rods.loss)), X, 1e-3)
    scale = np.sqrt(np.abs(np.outer(np.diag(expected), np.diag(expected))))
    assert np.all(np.abs(H - expected) <= 1e-6 * scale.max(axis=1)[:, None])
    np.testing.assert_allclose(H, H.T, atol=1e-10 * np.abs(H).max())


@pytest.mark.slow
def test_hessian_of_the_cost_of_a_study_away_from_its_minimum():
    """Where residuals are large: there a closest point that is held would make the Hessian wrong."""
    function, start = residual_function(load_study(example_path("simulated-cable")), elements=12)
    x = start + jnp.array([0.3, -0.2])

    def cost(x):
        return 0.5 * jnp.sum(function(x) ** 2)

    expected = differences(jax.jit(jax.grad(cost)), x, 5e-4)
    np.testing.assert_allclose(jax.jit(jax.hessian(cost))(x), expected, atol=1e-5 * np.abs(expected).max())
