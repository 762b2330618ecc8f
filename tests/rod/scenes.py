"""Small rods of random stiffness, loads and shape, for tests of identities that hold for every rod."""

import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Float

from scan2flex_jax.geometry import lie
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.effect import AbstractEffect, Section
from scan2flex_jax.rod.element_law import stiffness_within
from scan2flex_jax.rod.loads import DeadLoad
from scan2flex_jax.rod.model import Configuration, Rod

ELEMENTS = 4


class Spring(AbstractEffect):
    """A spring (N/m) from every node to a point, and a torque-like pull (N m) on a direction of its frame."""

    stiffness: Float[Array, ""]
    pull: Float[Array, "3"]

    def node_potential(self, node):
        away = node.r - jnp.array([0.2, -0.1, 0.3])
        return self.stiffness * node.weight * (away @ away) ** 2 + self.pull @ node.R[:, 0] * (1.0 + node.s)


class Hardening(AbstractEffect):
    """A bending law that stiffens: ``c |kappa|^4`` (J/m)."""

    c: Float[Array, ""]

    def strain_energy(self, strain, stiffness):
        return self.c * jnp.sum(strain[3:] ** 2) ** 2 + self.c * strain[0] * strain[4]


def random_rod(seed=0, effects=(), held=((0.0,) * 6, (0.0,) * 6)) -> tuple[Rod, Configuration]:
    """A rod with full random stiffness matrices, natural strains, loads and shape; both ends free unless ``held``."""
    rng = np.random.default_rng(seed)
    n = ELEMENTS
    root = rng.normal(size=(n, 6, 6))
    stiffness = jnp.array(root @ np.swapaxes(root, 1, 2) + np.eye(6))
    section = Section(
        s=jnp.array((np.arange(n) + 0.5) * 0.3),
        ds=jnp.array(0.3),
        stiffness=stiffness,
        natural=jnp.array(0.3 * rng.normal(size=(n, 6))),
        density=jnp.ones(n),
        within=stiffness_within(stiffness),
    )
    load = DeadLoad(jnp.array(rng.normal(size=(n + 1, 3))), jnp.array(rng.normal(size=(n + 1, 3))))
    twists = 0.5 * rng.normal(size=(n + 1, 6))
    pairs = [lie.se3_exp(jnp.array(x)) for x in twists]
    r = jnp.stack([p for p, _ in pairs]) * 0.2 + jnp.arange(n + 1.0)[:, None] * jnp.array([0.0, 0.0, 0.3])
    c = Configuration(r, jnp.stack([R for _, R in pairs]))
    boundary = Boundary(c.r[jnp.array([0, -1])], c.R[jnp.array([0, -1])], jnp.array(held))
    return Rod(section, load, boundary, effects), c
