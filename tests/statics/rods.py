"""What solvers are compared by: random rods with their starts as one batch, derivatives, and the GPU's solver on a CPU."""

import ctypes
import shutil
import subprocess
from functools import cache, partial
from itertools import count
from pathlib import Path

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
from scan2flex_jax.statics import MixedNewton, equilibrium
from scan2flex_jax.statics.kernel import cuda, elements
from scan2flex_jax.statics.starts import sagging_start
from scan2flex_jax.statics.verdict import judge

from . import cases

LANES, ELEMENTS = 24, 11
SUPPORTS = ((CLAMP, CLAMP), (CLAMP, FREE), (CLAMP, BALL), (BALL, BALL))
COMPILER = next(filter(None, map(shutil.which, ("c++", "g++", "clang++"))), None)
IN_A_BLOCK = 3  # rods at a time; an odd number: the last warp eliminates one
orders = count()
judged = jax.jit(jax.vmap(judge))


@cache
def random_rods(n=ELEMENTS, straight=0):
    """Rods with unequal, coupled and varying sections on all kinds of supports, and their generic starts, as one batch.

    ``straight`` of them are straight and weightless between clamps, twisted by 0, 1, ... rad.
    """
    rng = np.random.default_rng(5)
    held = np.array([SUPPORTS[i % len(SUPPORTS)] for i in range(LANES)])
    stiffness, frames = 10.0 ** rng.uniform(-2, 0, (LANES, 3)), 0.7 * rng.normal(size=(LANES, 2, 3))
    density, natural = rng.uniform(0.0, 0.3, LANES), rng.normal(size=(LANES, 6)) * [1e-3, 1e-3, 1e-3, 1.0, 1.0, 1.0]
    ends = rng.uniform([0.3, -0.4, -0.4], [0.8, 0.4, 0.4], (LANES, 3))
    mixed = 0.1 * rng.uniform(-1.0, 1.0, (LANES, n, 6, 6)) + 0.3 * rng.uniform(size=(LANES, n, 1, 1)) * np.eye(6)
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


def middle(x, solver):
    cable = Cable(1.0, 0.2, jnp.exp(x[0]), jnp.exp(x[1]))
    model, clamps = CableModel(cable, cases.EARTH), cases.clamped(*cases.four_poses()[1])
    found = equilibrium(model, clamps, elements=ELEMENTS, solver=solver)
    return jnp.sum(found.points[ELEMENTS // 2] * jnp.array([1.0, 2.0, 3.0]))


def same_derivatives(solver):
    x = jnp.log(jnp.array([[0.1, 0.25], [0.12, 0.2]]))
    ours = jax.jit(jax.grad(lambda x: jnp.sum(jax.vmap(lambda row: middle(row, solver))(x))))(x)
    in_jax = jax.jit(jax.jacfwd(lambda row: middle(row, MixedNewton())))
    np.testing.assert_allclose(ours, [in_jax(row) for row in x], rtol=1e-7)


@cache
def solver_on_threads(folder):
    """The solver of a GPU with its own source on the CPU: threads are fibers, in another order in each call."""
    (folder / "elements.inc").write_text(elements.source())
    (folder / "constants.inc").write_text(elements.constants())
    include = [f"-I{path}" for path in (folder, Path(cuda.__file__).parent)]

    @cache
    def built(n):
        command = [COMPILER, "-std=c++17", "-O1", "-w", "-shared", "-fPIC", f"-DN={n}", f"-DRODS={IN_A_BLOCK}", *include]
        subprocess.run([*command, str(Path(__file__).with_name("fibers.cpp")), "-o", str(folder / f"{n}.so")], check=True)
        return ctypes.CDLL(str(folder / f"{n}.so"))

    def launch(operands, n, call):
        (ctypes.c_int * 4).from_address(operands.arrays[16])[3] = 0
        if built(n).launch(ctypes.byref(operands), next(orders)):
            raise RuntimeError("threads wait for each other")

    name = f"settle_on_threads_{folder.name}"
    cuda.register(launch, name, "cpu")
    return cuda.CudaNewton(name, "cpu", trusted=True)
