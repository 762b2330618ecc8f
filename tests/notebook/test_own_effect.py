"""An effect of one's own, a class in a notebook that nobody registered, acts like those of the package."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import Array
from jaxtyping import Float

from scan2flex_jax import Boundary, Cable, CableModel, equilibrium
from scan2flex_jax.rod.effect import AbstractEffect
from scan2flex_jax.rod.loads import point_load

from . import rods

pytestmark = pytest.mark.slow

TRACED = []  # once for each time that the effect is traced


class Balloon(AbstractEffect):
    """Lifts the cable at arc length ``position`` (m) with a force (N) along +z."""

    position: Float[Array, ""]
    lift: Float[Array, ""]

    def dead_load(self, section, gravity):
        TRACED.append(None)
        return point_load(section, self.position, self.lift * jnp.array([0.0, 0.0, 1.0]))


def tip(lift):
    model = CableModel(Cable(1.0, 0.05, 0.2, 0.2, 1e7, 1e7), [0.0, 0.0, -9.81], [Balloon(1.0, lift)])
    return equilibrium(model, Boundary.of((np.zeros(3), rods.ALONG_X)), elements=rods.ELEMENTS).points[-1, 2]


def test_it_lifts_without_being_registered_and_plain_numbers_are_parameters():
    """A float in a constructor must not be compiled in: another value is no new function."""
    before = len(TRACED)
    heights = [float(tip(lift)) for lift in (0.0, 0.1, 0.2)]
    assert heights == sorted(heights) and heights[2] > heights[0]
    assert len(TRACED) == before + 1


def test_its_parameters_have_derivatives_eagerly():
    h = 1e-4
    np.testing.assert_allclose(jax.grad(tip)(0.1), (tip(0.1 + h) - tip(0.1 - h)) / (2 * h), rtol=1e-6)
