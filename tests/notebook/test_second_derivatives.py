"""Second derivatives of an equilibrium and of a study's cost against differences of gradients: Laplace, Newton-CG and HMC rest
on them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax import load_study, residual_function
from scan2flex_jax.examples import example_path

from . import rods

pytestmark = pytest.mark.slow


def curvature(gradient, x, h):
    """Richardson-extrapolated central differences of a gradient."""

    def central(h):
        return np.array([(gradient(x + h * e) - gradient(x - h * e)) / (2 * h) for e in np.eye(len(x))])

    coarse, fine = central(2 * h), central(h)
    return fine + (fine - coarse) / 3


def test_hessian_of_an_equilibrium():
    """By stiffnesses, length, place and turn of a clamp, and an effect's parameter."""
    rods.start()
    x = jnp.zeros(6)
    H = np.asarray(jax.jit(jax.hessian(rods.loss))(x))
    expected = curvature(jax.jit(jax.grad(rods.loss)), x, 1e-3)
    scale = np.sqrt(np.abs(np.outer(np.diag(expected), np.diag(expected))))
    assert np.all(np.abs(H - expected) <= 1e-6 * scale.max(axis=1)[:, None])
    np.testing.assert_allclose(H, H.T, atol=1e-10 * np.abs(H).max())


def test_hessian_of_the_cost_of_a_study_away_from_its_minimum():
    """Where residuals are large: there a closest point that is held would make the Hessian wrong."""
    function, start = residual_function(load_study(example_path("simulated-cable")), elements=12)
    x = start + jnp.array([0.3, -0.2])

    def cost(x):
        return 0.5 * jnp.sum(function(x) ** 2)

    expected = curvature(jax.jit(jax.grad(cost)), x, 5e-4)
    np.testing.assert_allclose(jax.jit(jax.hessian(cost))(x), expected, atol=1e-5 * np.abs(expected).max())
