"""Products of small matrices against NumPy, with batches that broadcast."""

import jax.numpy as jnp
import numpy as np

from scan2flex_jax.geometry import small

RNG = np.random.default_rng(0)
A, B, C, U, V = (jnp.array(RNG.standard_normal(shape)) for shape in ((5, 3, 6), (6, 2), (5, 2, 4), (5, 3), (6,)))


def test_products_are_those_of_numpy():
    np.testing.assert_allclose(small.matmul(A, B, C), A @ B @ C, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(small.matvec(A, V), A @ V, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(small.vecmat(U, A), np.einsum("ni,nij->nj", U, A), rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(small.vecdot(U, U[0]), U @ U[0], rtol=1e-13, atol=1e-13)
