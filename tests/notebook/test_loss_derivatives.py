"""Derivatives of the cost of a study as a traced function, and fits that are mapped over guesses."""

import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest

from scan2flex_jax import load_study, residual_function
from scan2flex_jax.examples import example_path

ELEMENTS = 12


@pytest.fixture(scope="module")
def ready():
    return residual_function(load_study(example_path("simulated-cable")), elements=ELEMENTS)


def cost(function):
    return lambda x: 0.5 * jnp.sum(function(x) ** 2)


@pytest.mark.slow
def test_gradient_and_hessian_of_the_cost_away_from_its_minimum(ready):
    """Where residuals are large: there a closest point that is held would make the Hessian wrong."""
    function, start = ready
    x = start + jnp.array([0.3, -0.2])
    f = jax.jit(cost(function))
    gradient, hessian = jax.jit(jax.grad(f)), jax.jit(jax.hessian(f))
    h = 1e-3
    slope = [(f(x + h * e) - f(x - h * e)) / (2 * h) for e in np.eye(2)]
    curvature = np.array([(gradient(x + h * e) - gradient(x - h * e)) / (2 * h) for e in np.eye(2)])
    np.testing.assert_allclose(gradient(x), slope, atol=1e-5 * np.abs(slope).max())
    np.testing.assert_allclose(hessian(x), curvature, atol=1e-5 * np.abs(curvature).max())


@pytest.mark.slow
def test_fits_can_be_vmapped_over_guesses(ready):
    function, start = ready
    guesses = start + jnp.array([[0.0, 0.0], [0.5, -0.5], [-0.5, 0.3]])

    def run(x):
        solver = optx.LevenbergMarquardt(1e-8, 1e-8)
        return optx.least_squares(lambda x, _: function(x), solver, x, max_steps=30, throw=False).value

    found = jax.jit(jax.vmap(run))(guesses)
    np.testing.assert_allclose(found, np.broadcast_to(found[0], found.shape), atol=1e-5)
