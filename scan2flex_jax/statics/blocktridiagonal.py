"""Symmetric block-tridiagonal systems: factor once, count negative pivots, solve for any number of right-hand sides.

``H`` has 6x6 diagonal blocks ``D_i`` and upper blocks ``U_i``. Block elimination from the first node to the last is an
L D L^T factorisation, each block by scalar pivots without exchange; by Sylvester's law of inertia the number of negative
pivots is the number of negative eigenvalues of ``H``. A pivot that is zero to rounding belongs to a zero-energy mode (a cable
between ball joints spinning about its own axis); that motion stays zero.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float, Int

from scan2flex_jax.geometry.small import diagonal, matmul, matvec

_NEUTRAL = 1.0e-13  # pivot over its original diagonal: a smaller one is rounding noise after cancellation


class Factors(NamedTuple):
    """``inverse[i]`` of the eliminated diagonal block, ``carry[i] = inverse[i] U_i``, and the number of negative pivots."""

    inverse: Float[Array, "n 6 6"]
    carry: Float[Array, "n 6 6"]
    upper: Float[Array, "n 6 6"]
    negative: Int[Array, ""]


def factor(diagonal: Float[Array, "n 6 6"], upper: Float[Array, "n-1 6 6"]) -> Factors:
    """Factors of the matrix, in O(n)."""
    below, above = _beside(upper)

    def eliminate(carry, blocks):
        D, U, U_before = blocks
        work, negative = _reduce(D - matmul(U_before.T, carry), D, U, np.eye(6, dtype=D.dtype))
        return work[:, 6:12], (work[:, 12:], work[:, 6:12], negative)

    _, (inverse, carry, negative) = jax.lax.scan(eliminate, jnp.zeros_like(diagonal[0]), (diagonal, below, above))
    return Factors(inverse, carry, above, jnp.sum(negative))


def solve(factors: Factors, rhs: Float[Array, "n 6 *k"]) -> Float[Array, "n 6 *k"]:
    """Solution of ``H x = rhs``; linear in ``rhs`` and transposable, so it serves forward and reverse derivatives."""

    def forward(y, block):
        inverse, U_before, b = block
        y = _times(inverse, b - _times(U_before.T, y))
        return y, y

    _, y = jax.lax.scan(forward, jnp.zeros_like(rhs[0]), (factors.inverse, factors.upper, rhs))
    return _substitute(factors.carry, y)


def factor_and_solve(diagonal, upper, rhs: Float[Array, "n 6 k"]):
    """``(H^-1 rhs, number of negative pivots)`` in one sweep, when the factors are not needed again."""
    below, above = _beside(upper)

    def eliminate(before, blocks):
        D, U, U_before, b = blocks
        carry, y = before
        work, negative = _reduce(D - matmul(U_before.T, carry), D, U, b - matmul(U_before.T, y))
        after = work[:, 6:12], work[:, 12:]
        return after, (*after, negative)

    start = (jnp.zeros_like(diagonal[0]), jnp.zeros_like(rhs[0]))
    _, (carry, y, negative) = jax.lax.scan(eliminate, start, (diagonal, below, above, rhs))
    return _substitute(carry, y), jnp.sum(negative)


def _reduce(block, original, *columns):
    """Gauss-Jordan on ``[block | columns]`` without exchanges, and the number of negative pivots met."""
    scale = _NEUTRAL * jnp.abs(diagonal(original))
    work = jnp.concatenate([block, *columns], axis=1)
    negative = jnp.zeros((), int)
    for j in range(6):
        pivot = work[j, j]
        neutral = jnp.abs(pivot) <= scale[j]
        negative = negative + ((pivot < 0) & ~neutral)
        row = jnp.where(neutral, 0.0, work[j] / jnp.where(neutral, 1.0, pivot))
        work = (work - jnp.outer(work[:, j], row)).at[j].set(row)
    return work, negative


def _times(matrix, x):
    return matvec(matrix, x) if x.ndim == 1 else matmul(matrix, x)


def _beside(upper):
    zero = jnp.zeros_like(upper[:1])
    return jnp.concatenate([upper, zero]), jnp.concatenate([zero, upper])


def _substitute(carry, y):
    def backward(x, block):
        carry, y = block
        x = y - _times(carry, x)
        return x, x

    return jax.lax.scan(backward, jnp.zeros_like(y[0]), (carry, y), reverse=True)[1]
