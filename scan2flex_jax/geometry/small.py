"""Products of small matrices and vectors, written as sums over products; names and axes as in NumPy.

XLA's CPU runtime passes every ``dot`` to a library for large matrices. For six by six, the loop compiled from a sum is
several times faster. But XLA fuses a sum with the expressions of its factors, and recomputes a long elementwise one for
every entry: with such a factor a ``dot``, which ends the fusion, is faster. Leading axes are batches, and broadcast.

The other functions here are NumPy's in fewer traced operations: tracing and compiling a solve takes longer than running it.
"""

from functools import reduce

import jax.numpy as jnp
import numpy as np
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


def cross(a: Float[Array, "... 3"], b: Float[Array, "... 3"]) -> Float[Array, "... 3"]:
    """Cross product."""
    return _next(a * _next(b) - _next(a) * b)


def _next(x):
    """The next component in place of each."""
    return jnp.concatenate([x[..., 1:], x[..., :1]], axis=-1)


def diagonal(matrix: Float[Array, "... n n"]) -> Float[Array, "... n"]:
    """Diagonal of matrices."""
    return jnp.sum(matrix * np.eye(matrix.shape[-1], dtype=matrix.dtype), axis=-1)


def diagonal_matrix(vector: Float[Array, "... n"]) -> Float[Array, "... n n"]:
    """Matrices with this diagonal."""
    return vector[..., None] * np.eye(vector.shape[-1], dtype=vector.dtype)
