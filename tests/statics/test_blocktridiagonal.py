"""Block-tridiagonal factors against dense linear algebra: solutions and the number of negative eigenvalues."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax.statics import blocktridiagonal as bt
from scan2flex_jax.statics.scaled import dense

N = 9
both = jax.jit(bt.factor_and_solve)
factored = jax.jit(lambda D, U, b: (bt.solve(bt.factor(D, U), b), bt.factor(D, U).negative))


def blocks(seed, lift):
    """Random symmetric blocks; ``lift`` moves the spectrum up from indefinite to positive."""
    rng = np.random.default_rng(seed)
    D = rng.normal(size=(N, 6, 6))
    return D + np.swapaxes(D, 1, 2) + lift * np.eye(6), rng.normal(size=(N - 1, 6, 6)), rng.normal(size=(N, 6, 2))


@pytest.mark.parametrize("lift", [-3.0, 0.0, 30.0])
def test_solution_and_inertia(lift):
    """Sylvester's law: as many negative pivots as negative eigenvalues. Pivots are not exchanged, so digits are lost
    when one happens to be small; the rods' own matrices are positive definite where accuracy counts."""
    D, U, b = blocks(0, lift)
    H = np.asarray(dense(jnp.array(D), jnp.array(U)))
    exact = np.linalg.solve(H, b.reshape(6 * N, 2)).reshape(N, 6, 2)
    count = np.sum(np.linalg.eigvalsh(H) < 0)
    for x, negative in (both(D, U, b), factored(D, U, b)):
        assert int(negative) == count
        np.testing.assert_allclose(x, exact, atol=(1e-12 if lift == 30.0 else 1e-7) * np.abs(exact).max())


def test_a_motion_without_stiffness_is_left_where_it_is():
    """One motion of the last node tied to nothing, or a chain of springs tied to nothing: no negative pivot, no NaN."""
    D, U, b = blocks(1, 30.0)
    D[-1, 5, :] = D[-1, :, 5] = U[-1, :, 5] = 0.0
    x, negative = both(D, U, b)
    assert int(negative) == 0
    np.testing.assert_allclose(x[-1, 5], 0.0)
    rest = np.delete(np.arange(6 * N), -1)
    H = np.asarray(dense(jnp.array(D), jnp.array(U)))[np.ix_(rest, rest)]
    np.testing.assert_allclose(x.reshape(-1, 2)[:-1], np.linalg.solve(H, b.reshape(-1, 2)[:-1]), rtol=1e-9)
    spring = np.tile(2.0 * np.eye(6), (N, 1, 1))
    spring[0] = spring[-1] = np.eye(6)
    x, negative = both(spring, np.tile(-np.eye(6), (N - 1, 1, 1)), b - b.mean(axis=0))
    assert int(negative) == 0
    assert np.all(np.isfinite(x))
