"""Random rods with their starts as one batch, for the comparison of solvers."""

from functools import cache, partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from reference import clamped_cases

from scan2flex_jax.compilation import compiled
from scan2flex_jax.geometry import lie
from scan2flex_jax.rod.boundary import BALL, CLAMP, FREE, Boundary
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.element_law import stiffness_within
from scan2flex_jax.rod.model import CableModel, discretise
from scan2flex_jax.statics.starts import sagging_start
from scan2flex_jax.statics.verdict import judge

LANES, ELEMENTS = 24, 11
SUPPORTS = ((CLAMP, CLAMP), (CLAMP, FREE), (CLAMP, BALL), (BALL, BALL))
judged = jax.jit(jax.vmap(judge))


@cache
def random_rods(elements=ELEMENTS, straight=0):
    """Rods with unequal, coupled and varying sections on all kinds of supports, and their generic starts, as one batch.

    ``straight`` of them are straight and weightless between clamps, twisted by 0, 1, ... rad.
    """
    rng = np.random.default_rng(5)
    held = np.array([SUPPORTS[i % len(SUPPORTS)] for i in range(LANES)])
    stiffness, frames = 10.0 ** rng.uniform(-2, 0, (LANES, 3)), 0.7 * rng.normal(size=(LANES, 2, 3))
    density, natural = rng.uniform(0.0, 0.3, LANES), rng.normal(size=(LANES, 6)) * [1e-3, 1e-3, 1e-3, 1.0, 1.0, 1.0]
    ends = rng.uniform([0.3, -0.4, -0.4], [0.8, 0.4, 0.4], (LANES, 3))
    mixed = 0.1 * rng.uniform(-1.0, 1.0, (LANES, elements, 6, 6)) + 0.3 * rng.uniform(size=(LANES, elements, 1, 1)) * np.eye(6)
    for twist, lane in enumerate(range(0, 4 * straight, 4)):
        density[lane], natural[lane], frames[lane], mixed[lane], ends[lane] = 0.0, 0.0, 0.0, 0.0, (1.0, 0.0, 0.0)
        frames[lane, 1, 2] = twist
    return compiled(jax.vmap(rod_of))(*map(jnp.asarray, (stiffness, density, natural, held, frames, ends, mixed)))


def rod_of(stiffness, density, natural, held, frames, end, mixed):
    """A rod with ``mixed`` added to its sections, as parts of their size, and its generic start."""
    rotation = jnp.array(clamped_cases.START_FRAME) @ jax.vmap(lie.so3_exp)(frames)
    clamps = Boundary(jnp.stack([jnp.zeros(3), end]), rotation, held)
    cable = Cable(1.0, density, stiffness[:2], stiffness[2], 3e2, 4e3, natural[3:], natural[:3])
    model = CableModel(cable, jnp.array([0.5, -0.3, -9.81]))
    rod = discretise(model, clamps, len(mixed))
    size = jnp.sqrt(jnp.diagonal(rod.section.stiffness, axis1=1, axis2=2))
    mixed = 0.5 * (mixed + mixed.swapaxes(1, 2)) * size[:, :, None] * size[:, None, :]
    rod = eqx.tree_at(lambda r: r.section.stiffness, rod, rod.section.stiffness + mixed)
    rod = eqx.tree_at(lambda r: r.section.within, rod, stiffness_within(rod.section.stiffness))
    return rod, sagging_start(clamps, cable.length, model.gravity, 0, len(mixed))


@cache
def settle_of(solver):
    return compiled(jax.vmap(partial(solver.settle, max_steps=None)))
