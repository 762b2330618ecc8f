"""Products of small matrices and vectors, written as sums over products; names and axes as in NumPy.

XLA's CPU runtime passes every ``dot`` to a library for large matrices. For six by six, the loop compiled from a sum is
several times faster. But XLA fuses a sum with the expressions of its factors, and recomputes a long elementwise one for
every entry: with such a factor a ``dot``, which ends the fusion, is faster. Leading axes are batches, and broadcast.
"""

from functools import reduce

import jax.numpy as jnp
from jax import Array
from jaxtyping import Float


def matmul(*factors: Float[Array, "... _ _"]) -> Float[Array, "... _ _"]:
    """Product of matrices, from the left."""
    return reduce(lambda a, b: jnp.sum(a[..., :, :, None] * b[..., None, :, :], axis=-2), factors)


def matvec(matrix: Float[Array, "... n m"], vector: Float[Array, "... m"]) -> Float[Array, "... n"]:
    """Matrix times vector."""
    return jnp.sum(matrix * vector[..., None, :], axis=-1)


def vecmat(vector: Float[Array, "... n"], matrix: Float[Array, "... n m"]) -> Float[Array, "... m"]:
    """Transposed matrix times vector."""
    return jnp.sum(vector[..., :, None] * matrix, axis=-2)


def vecdot(a: Float[Array, "... n"], b: Float[Array, "... n"]) -> Float[Array, "..."]:
    """Inner product."""
    return jnp.sum(a * b, axis=-1)
