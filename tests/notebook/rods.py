"""The rod of the notebook tests: a twisted cable with a weight, as a function of numbers that a user would differentiate by."""

from functools import cache

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from scan2flex_jax import Boundary, Cable, CableModel, equilibrium
from scan2flex_jax.effects import PointMass
from scan2flex_jax.geometry import lie

ELEMENTS = 12
ALONG_X = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
TURNED = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]) @ ALONG_X
NAMES = ("bending stiffness", "torsional stiffness", "length", "clamp's height", "clamp's turn", "mass")
SIZES = np.array([0.1, 0.25, 1.0, 0.1, 0.2, 0.05])  # of a noticeable change
HERE = np.array([0.1, 0.25, 1.0, 0.05, 0.1, 0.05])


def scene(x):
    """Model and supports at stiffnesses (N m^2), length (m), height (m) and turn (rad) of the far clamp, and a mass (kg)."""
    EI, GJ, length, height, turn, mass = x
    model = CableModel(Cable(length, 0.2, EI, GJ, 1e5, 1e5), [0.0, 0.0, -9.81], PointMass(position=0.4, mass=mass))
    place = jnp.stack([jnp.asarray(0.6), jnp.asarray(0.2), jnp.asarray(height)])
    axis = turn * jnp.array([0.0, 0.6, 0.8])
    return model, Boundary.of((jnp.zeros(3), jnp.array(ALONG_X)), (place, jnp.array(TURNED) @ lie.so3_exp(axis)))


def found(x, **options):
    """The equilibrium at ``HERE + SIZES x``."""
    model, boundary = scene(HERE + SIZES * x)
    return equilibrium(model, boundary, elements=ELEMENTS, **options)


def height(x):
    """Height of the cable's middle (m)."""
    return found(x).points[ELEMENTS // 2, 2]


@cache
def start():
    """Where every solve of `loss` begins; to be asked for before `loss` is traced."""
    return eqx.filter_jit(found)(np.zeros(6)).configuration


def loss(x):
    """A squared distance (m^2) of the nodes to a shape that is not the cable's, and its clamp's reaction beside it."""
    e = found(x, start=start())
    force, _ = e.reactions()
    return jnp.sum((e.points - 1.05 * start().r) ** 2) + 1e-3 * jnp.sum(force**2)
