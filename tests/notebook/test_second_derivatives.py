"""Second derivatives of an equilibrium against differences of its gradient: Laplace, Newton-CG and HMC rest on them.

By stiffnesses, length, place and turn of a clamp, and an effect's parameter; forward over forward, forward over reverse,
reverse over reverse, and batches of these.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from . import rods

X = jnp.zeros(6)
gradient = jax.jit(jax.grad(rods.loss))
hessian = jax.jit(jax.hessian(rods.loss))


@pytest.fixture(scope="module")
def curvature():
    """Richardson-extrapolated central differences of the gradient."""

    def central(h):
        return np.array([(gradient(X + h * e) - gradient(X - h * e)) / (2 * h) for e in np.eye(6)])

    coarse, fine = central(2e-3), central(1e-3)
    found = fine + (fine - coarse) / 3
    assert np.abs(found - found.T).max() < 1e-6 * np.abs(found).max()
    return found


@pytest.mark.slow
@pytest.mark.parametrize("k", range(6), ids=rods.NAMES)
def test_hessian_is_the_difference_of_gradients(curvature, k):
    scale = np.sqrt(np.abs(np.outer(np.diag(curvature), np.diag(curvature))))[k]
    np.testing.assert_allclose(hessian(X)[k], curvature[k], atol=1e-6 * scale.max())


def test_the_hessian_is_symmetric():
    H = np.asarray(hessian(X))
    np.testing.assert_allclose(H, H.T, atol=1e-10 * np.abs(H).max())


NESTED = {
    "forward over forward": lambda f: jax.jacfwd(jax.jacfwd(f)),
    "reverse over reverse": lambda f: jax.jacrev(jax.jacrev(f)),
    "reverse over forward": lambda f: jax.jacrev(jax.jacfwd(f)),
}


@pytest.mark.slow
@pytest.mark.parametrize("order", NESTED)
def test_every_nesting_gives_the_hessian(order):
    H = np.asarray(hessian(X))
    np.testing.assert_allclose(jax.jit(NESTED[order](rods.loss))(X), H, atol=1e-9 * np.abs(H).max())


@pytest.mark.slow
def test_hessian_vector_products_eagerly():
    """As Newton-CG asks for them."""
    v = jnp.array([1.0, -2.0, 0.5, 1.0, 0.3, -1.0])
    _, product = jax.jvp(jax.grad(rods.loss), (X,), (v,))
    expected = np.asarray(hessian(X)) @ v
    np.testing.assert_allclose(product, expected, atol=1e-9 * np.abs(expected).max())


@pytest.mark.slow
def test_a_batch_of_hessians():
    lanes = jnp.stack([X, X + 0.05])
    batch = jax.jit(jax.vmap(jax.hessian(rods.loss)))(lanes)
    for H, x in zip(batch, lanes, strict=True):
        np.testing.assert_allclose(H, hessian(x), atol=1e-8 * np.abs(H).max())


@pytest.mark.slow
def test_the_curvature_of_a_quadratic_free_problem_has_a_closed_form():
    """A cable so light that its deflection is linear in load over stiffness: z = -c / EI, so d2z/dEI2 = 2 z / EI^2."""
    from scan2flex_jax import Boundary, Cable, CableModel, equilibrium

    def tip(EI):
        model = CableModel(Cable(1.0, 1e-5, EI, EI, 1e9, 1e9), [0.0, 0.0, -9.81])
        return equilibrium(model, Boundary.of((np.zeros(3), rods.ALONG_X)), elements=rods.ELEMENTS).points[-1, 2]

    EI = 1.0
    z, slope, second = tip(EI), jax.grad(tip)(EI), jax.grad(jax.grad(tip))(EI)
    np.testing.assert_allclose(z, -1e-5 * 9.81 / 8, rtol=1e-4)
    np.testing.assert_allclose(slope, -z / EI, rtol=1e-4)
    np.testing.assert_allclose(second, 2 * z / EI**2, rtol=1e-4)
