"""Products of small matrices against NumPy, with batches that broadcast."""

import numpy as np

from scan2flex_jax.geometry import small

RNG = np.random.default_rng(0)
A, B, C = RNG.standard_normal((5, 3, 6)), RNG.standard_normal((6, 2)), RNG.standard_normal((5, 2, 4))
U, V = RNG.standard_normal((5, 3)), RNG.standard_normal(6)


def test_products_are_those_of_numpy():
    np.testing.assert_allclose(small.matmul(A, B, C), A @ B @ C, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(small.matvec(A, V), A @ V, rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(small.vecmat(U, A), np.einsum("ni,nij->nj", U, A), rtol=1e-13, atol=1e-13)
    np.testing.assert_allclose(small.vecdot(U, U[0]), U @ U[0], rtol=1e-13, atol=1e-13)
