"""Traced functions as straight-line arithmetic, evaluated with numpy against the functions themselves."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.geometry import lie
from scan2flex_jax.geometry.small import matmul
from scan2flex_jax.statics.kernel import symbolic


def translated(function, *shapes):
    """The graph of a function of arrays, and the nodes of its outputs."""
    graph, inputs, first = symbolic.Graph(), [], 0
    for shape in shapes:
        count = int(np.prod(shape))
        inputs.append(np.array([graph.input(first + i) for i in range(count)], int).reshape(shape))
        first += count
    return graph, symbolic.traced(graph, function, tuple(inputs))


def evaluated(graph, numbers):
    """The value of every node."""
    values = []
    with np.errstate(all="ignore"):
        for operation, arguments in graph.nodes:
            if operation == "const":
                values.append(arguments[1])
            elif operation == "input":
                values.append(numbers[arguments[0]])
            elif operation == "select":
                which, when_false, when_true = (values[i] for i in arguments)
                values.append(when_true if which else when_false)
            else:
                values.append(symbolic._NUMPY[operation](*(values[i] for i in arguments)))
    return np.array(values, float)


def weighted(x):
    """A loop, a masked sum and an indexed addition."""
    total, steps = jax.lax.scan(lambda c, row: (2.0 * c + row, c), x[0], x[1:], reverse=True)
    return total, steps.at[1:, 0].add(x[1:3, 1]), jnp.max(x), jnp.sum(jnp.where(x > 0.3, x, 0.0)), x**-2, (x > 0).astype(float)


FUNCTIONS = {
    "logarithm": (lambda x: lie.se3_log(*lie.se3_exp(x)), (6,)),
    "Jacobian": (lie.right_jacobian_inverse, (6,)),
    "slope of the Jacobian": (lie.right_jacobian_inverse_slope, (6,), (6,)),
    "derivative": (jax.jacfwd(lie.se3_log), (3,), (3, 3)),
    "products": (lambda a, b: (a @ b, jnp.einsum("ij,jk->ki", a, b), matmul(a, b)), (2, 3), (3, 4)),
    "batch of products": (lambda a, b: jnp.einsum("nij,njk->nik", a, b), (2, 2, 3), (2, 3, 2)),
    "loops and indices": (weighted, (4, 2)),
}


@pytest.mark.parametrize("size", [1e-3, 0.4, 1.3])
@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_arithmetic_is_that_of_the_function(name, size):
    function, *shapes = FUNCTIONS[name]
    graph, outputs = translated(function, *shapes)
    rng = np.random.default_rng(1)
    arrays = [size * rng.normal(size=shape) for shape in shapes]
    if name == "derivative":
        arrays[1] = np.array(lie.so3_exp(jnp.array(arrays[0])))
    found = evaluated(graph, np.concatenate([x.ravel() for x in arrays]))
    for nodes, expected in zip(outputs, jax.tree.leaves(function(*map(jnp.asarray, arrays))), strict=True):
        np.testing.assert_allclose(found[nodes], expected, rtol=1e-12, atol=1e-12 * (1.0 + np.max(np.abs(expected))))


def test_constant_entries_cost_nothing():
    graph, (product,) = translated(lambda w: matmul(lie.hat(w), lie.hat(w)), (3,))
    assert product.shape == (3, 3)
    arithmetic = [node for node in graph.nodes if node.operation not in ("const", "input")]
    assert len(arithmetic) <= 18  # six products of two components, three sums, and signs; 45 for full matrices
    assert len(set(product.ravel().tolist())) == 6  # it is symmetric


def test_an_operation_without_translation_is_named():
    with pytest.raises(Scan2FlexError, match="'exp'"):
        translated(jnp.exp, (2,))
    with pytest.raises(Scan2FlexError, match="'cond'"):
        translated(lambda x: jax.lax.cond(x[0] > 0, lambda: x, lambda: -x), (2,))
