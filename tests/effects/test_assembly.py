"""With an effect in the model, the assembled gradient and Hessian are those of the potential energy."""

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax.rod.assembly import derivatives
from scan2flex_jax.rod.energy import potential_energy, retract
from scan2flex_jax.rod.model import CableModel, Configuration, discretise
from scan2flex_jax.statics.scaled import dense

from . import scene

ELEMENTS = 3
SIZE = 6 * (ELEMENTS + 1)


@partial(jax.jit, compiler_options=scene.UNOPTIMISED)
def both(effects, boundary, c):
    rod = discretise(CableModel(scene.CABLE, scene.DOWN, effects), boundary, ELEMENTS)

    def gradient(z):
        return jax.grad(lambda z: potential_energy(retract(c, z.reshape(-1, 6)), rod))(z)

    d = derivatives(rod, c)
    exact = gradient(jnp.zeros(SIZE)), jax.jacfwd(gradient)(jnp.zeros(SIZE))
    return (d.gradient.ravel(), dense(d.diagonal, d.upper)), exact


@pytest.mark.parametrize("kind", scene.KINDS)
def test_gradient_and_hessian(kind):
    rng = np.random.default_rng(len(kind))
    boundary = eqx.tree_at(lambda b: b.held, scene.straight(), jnp.zeros((2, 6)))
    t = np.linspace(0, 1, ELEMENTS + 1)[:, None]
    R = jnp.broadcast_to(boundary.rotation[0], (ELEMENTS + 1, 3, 3))
    c = retract(Configuration(jnp.array(t * [1.0, 0.0, 0.0]), R), jnp.array(0.15 * rng.normal(size=(ELEMENTS + 1, 6))))
    got, exact = both(scene.with_effects(scene.active(kind)), boundary, c)
    for a, b in zip(got, exact, strict=True):
        assert np.all(np.isfinite(b))
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-11 * np.abs(b).max())
