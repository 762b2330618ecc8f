"""An effect of one's own, a class in a notebook that nobody registered, acts like those of the package."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax import Boundary, Cable, CableModel, equilibrium
from scan2flex_jax.effects import PointMass
from scan2flex_jax.rod.effect import AbstractEffect
from scan2flex_jax.rod.loads import point_load

from . import rods


class Balloon(AbstractEffect):
    """Lifts the cable at arc length ``position`` (m) with a force (N) along +z."""

    position: Float[Array, ""]
    lift: Float[Array, ""]

    def dead_load(self, section, gravity):
        return point_load(section, self.position, self.lift * jnp.array([0.0, 0.0, 1.0]))


def tip(lift, effect=Balloon):
    model = CableModel(Cable(1.0, 0.05, 0.2, 0.2, 1e7, 1e7), [0.0, 0.0, -9.81], [effect(1.0, lift)])
    return equilibrium(model, Boundary.of((np.zeros(3), rods.ALONG_X)), elements=rods.ELEMENTS).points[-1, 2]


def test_it_acts_without_being_registered():
    assert tip(0.1) > tip(0.0)


def test_its_parameters_have_derivatives_eagerly():
    h = 1e-4
    np.testing.assert_allclose(jax.grad(tip)(0.1), jax.grad(jax.jit(tip))(0.1), rtol=1e-9)
    np.testing.assert_allclose(jax.grad(tip)(0.1), (tip(0.1 + h) - tip(0.1 - h)) / (2 * h), rtol=1e-6)


def test_its_parameters_can_be_swept():
    lifts = jnp.array([0.0, 0.1, 0.2])
    batch = jax.vmap(tip)(lifts)
    np.testing.assert_allclose(batch, [tip(x) for x in lifts], atol=1e-9)


def test_it_is_the_weight_that_it_lifts():
    """A balloon that carries a mass leaves the bare cable."""
    weight = PointMass(position=0.6, mass=0.05)
    bare = CableModel(Cable(1.0, 0.05, 0.2, 0.2), [0.0, 0.0, -9.81])
    lifted = CableModel(bare.cable, bare.gravity, [weight, Balloon(0.6, 0.05 * 9.81)])
    boundary = Boundary.of((np.zeros(3), rods.ALONG_X))
    a, b = (equilibrium(m, boundary, elements=rods.ELEMENTS).points for m in (bare, lifted))
    np.testing.assert_allclose(a, b, atol=1e-9)


def test_plain_numbers_of_an_effect_are_parameters_like_arrays():
    """A float in a constructor must not be compiled in: another value is no new function."""
    traced = []

    class Counted(Balloon):
        def dead_load(self, section, gravity):
            traced.append(None)
            return super().dead_load(section, gravity)

    heights = [float(tip(lift, Counted)) for lift in (0.1, 0.2, 0.3)]
    assert heights == sorted(heights)
    assert len(traced) == 1
