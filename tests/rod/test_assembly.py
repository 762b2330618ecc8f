"""The assembled gradient and Hessian are those of the energy itself, differentiated as one dense function."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax.rod.assembly import derivatives, free_motions, out_of_balance, strain_increment
from scan2flex_jax.rod.boundary import BALL, CLAMP, FREE
from scan2flex_jax.rod.energy import potential_energy, retract, strains
from scan2flex_jax.statics.scaled import dense

from .scenes import ELEMENTS, Hardening, Spring, random_rod

SIZE = 6 * (ELEMENTS + 1)
FIELDS = (Spring(jnp.array(0.7), jnp.array([0.3, -0.4, 0.9])), Hardening(jnp.array(0.2)))
NULL_FIELDS = jax.tree.map(jnp.zeros_like, FIELDS)  # a linear rod, without a second compilation


@eqx.filter_jit
def assembled(rod, c):
    d = derivatives(rod, c)
    return d.gradient.ravel(), dense(d.diagonal, d.upper), out_of_balance(rod, c).ravel(), d.elements


@jax.jit
def differentiated(rod, c):
    def gradient(z):
        return jax.grad(lambda z: potential_energy(retract(c, z.reshape(-1, 6)), rod))(z)

    return gradient(jnp.zeros(SIZE)), jax.jacfwd(gradient)(jnp.zeros(SIZE))


@pytest.mark.parametrize("effects", [(), FIELDS], ids=["linear", "fields and a nonlinear law"])
@pytest.mark.parametrize("seed", [0, 1])
def test_free_rod(effects, seed):
    rod, c = random_rod(seed, effects)
    gradient, hessian, balance, _ = assembled(rod, c)
    exact_gradient, exact_hessian = differentiated(random_rod(seed, effects or NULL_FIELDS)[0], c)
    np.testing.assert_allclose(gradient, exact_gradient, atol=1e-12 * np.abs(exact_gradient).max())
    np.testing.assert_allclose(balance, exact_gradient, atol=1e-12 * np.abs(exact_gradient).max())
    np.testing.assert_allclose(hessian, exact_hessian, atol=1e-12 * np.abs(exact_hessian).max())


@pytest.mark.parametrize("held", [(CLAMP, FREE), (BALL, BALL), (CLAMP, BALL), ((0.0, 1, 0, 0, 1, 0), CLAMP)])
def test_held_motions_are_taken_out(held):
    """`potential_energy` puts held ends on their supports, so only free motions can be compared."""
    rod, c = random_rod(3, held=held)
    free_rod, _ = random_rod(3, NULL_FIELDS)
    gradient, hessian, *_ = assembled(rod, c)
    exact_gradient, exact_hessian = differentiated(free_rod, c)
    free = np.asarray(free_motions(rod)).ravel()
    np.testing.assert_allclose(gradient, exact_gradient * free, atol=1e-12 * np.abs(exact_gradient).max())
    expected = exact_hessian * np.outer(free, free) + np.diag(1 - free)
    np.testing.assert_allclose(hessian, expected, atol=1e-12 * np.abs(exact_hessian).max())


def test_strain_increment_is_the_derivative_of_the_strains():
    rod, c = random_rod(4)
    elements = assembled(rod, c)[3]
    twist = jnp.array(np.random.default_rng(5).normal(size=(ELEMENTS + 1, 6)))
    moved = jax.jit(jax.jacfwd(lambda h: strains(rod, retract(c, h * twist))))(0.0)
    np.testing.assert_allclose(strain_increment(rod, elements, twist), moved, atol=1e-12 * np.abs(moved).max())
