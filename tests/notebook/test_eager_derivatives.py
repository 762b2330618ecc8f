"""Derivatives through an equilibrium as a person types them: eagerly, jitted, vmapped and nested.

Known is the gradient by central differences of the loss itself; every way of asking for it must give that.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from . import rods

X = jnp.zeros(6)
LANES = jnp.stack([X, X + 0.05])
value = jax.jit(rods.loss)


@pytest.fixture(scope="module")
def slope():
    """Richardson-extrapolated central differences, good to 1e-7."""

    def central(h):
        return np.array([(value(X + h * e) - value(X - h * e)) / (2 * h) for e in np.eye(6)])

    coarse, fine = central(2e-3), central(1e-3)
    return fine + (fine - coarse) / 3


def close(found, slope):
    np.testing.assert_allclose(found, slope, atol=1e-6 * np.abs(slope).max())


WAYS = {
    "grad": lambda f: jax.grad(f)(X),
    "value_and_grad": lambda f: jax.value_and_grad(f)(X)[1],
    "vjp": lambda f: jax.vjp(f, X)[1](jnp.ones(()))[0],
    "jacrev": lambda f: jax.jacrev(f)(X),
    "jacfwd": lambda f: jax.jacfwd(f)(X),
    "jvp": lambda f: jnp.stack([jax.jvp(f, (X,), (e,))[1] for e in jnp.eye(6)]),
    "linearize": lambda f: jax.vmap(jax.linearize(f, X)[1])(jnp.eye(6)),
    "filter_grad": lambda f: eqx.filter_grad(f)(X),
    "filter_value_and_grad": lambda f: eqx.filter_value_and_grad(f)(X)[1],
    "grad of a jitted function": lambda f: jax.grad(jax.jit(f))(X),
    "jitted grad": lambda f: jax.jit(jax.grad(f))(X),
    "checkpoint": lambda f: jax.grad(jax.checkpoint(f))(X),
}
COMPILE_ALL_AGAIN = ("grad of a jitted function", "checkpoint")


@pytest.mark.parametrize("way", [pytest.param(w, marks=[pytest.mark.slow] * (w in COMPILE_ALL_AGAIN)) for w in WAYS])
def test_every_way_gives_the_differences(way, slope):
    close(WAYS[way](rods.loss), slope)


def test_vmap_of_grad(slope):
    each = jax.vmap(jax.grad(rods.loss))(LANES)
    close(each[0], slope)
    assert np.abs(each[1] - each[0]).max() > 1e-3 * np.abs(slope).max()


@pytest.mark.slow
def test_grad_of_vmap(slope):
    each = jax.jit(jax.vmap(jax.grad(rods.loss)))(LANES)
    together = jax.grad(lambda lanes: jnp.sum(jax.vmap(rods.loss)(lanes)))(LANES)
    np.testing.assert_allclose(together, each, rtol=1e-9, atol=1e-9 * np.abs(slope).max())


def test_a_vmapped_equilibrium_is_the_single_one():
    batch = jax.vmap(rods.height)(LANES)
    single = [rods.height(x) for x in LANES]
    np.testing.assert_allclose(batch, single, rtol=1e-9)


def test_a_failed_solve_is_told_in_eager_derivatives_too():
    """Gradients of a rod that has no equilibrium are numbers of no meaning; the verdict beside them says so."""

    def stopped(x):
        e = rods.found(x, max_steps=1)
        return e.points[3, 2], e.verdict

    _, verdict = jax.grad(stopped, has_aux=True)(X)
    assert not verdict.solved
    assert "allowed steps" in verdict.sentence()
