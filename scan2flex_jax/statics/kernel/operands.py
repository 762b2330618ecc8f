"""What the compiled solvers take, which rods they solve, and the check of what they make of one."""

import jax.numpy as jnp

from scan2flex_jax.compilation import compiled
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.effect import overriding
from scan2flex_jax.rod.model import CableModel, Configuration, Rod, discretise
from scan2flex_jax.statics.newton import MAX_STEPS, MixedNewton, lendable_stiffness
from scan2flex_jax.statics.solver import AbstractRodSolver, Steps
from scan2flex_jax.statics.starts import sagging_start

_ALIKE = 1.0e-9  # of the length: the two solvers' difference in the check; rounding leaves 1e-14


def operands(rod: Rod, start: Configuration, newton: MixedNewton, max_steps: Steps) -> list:
    """The arrays of `Operands` in `solver.h` and `settle.cu`, in their order."""
    s, b = rod.section, rod.boundary
    mode, lendable, atol = newton.begin(rod, start).mode, lendable_stiffness(rod)[-1, -1], jnp.asarray(newton.atol)
    most = jnp.asarray(MAX_STEPS if max_steps is None else max_steps, jnp.int64)
    return [s.ds, s.stiffness, s.natural, s.within, rod.load.force, rod.load.lever, b.position, b.rotation, b.held, *start,
            mode, lendable, atol, most]  # fmt: skip


def translated(rod: Rod, arrays: list) -> bool:
    """Whether a compiled solver solves this rod."""
    known = all(array is not None and array.dtype == jnp.float64 for array in arrays[:-1])
    known = known and rod.section.growth is None and not rod.load.arms
    energies = ("strain_energy", "node_potential", "element_potential")
    return known and not [effect for hook in energies for effect in overriding(rod.effects, hook)]


def check(solver: AbstractRodSolver, elements: int) -> None:
    """Raise `Scan2FlexError` unless a twisted cable ends where `MixedNewton` leaves it."""
    cable = Cable(length=1.0, length_density=0.2, bending_stiffness=[0.1, 0.12], torsional_stiffness=0.25)
    model = CableModel(cable, gravity=[0.0, 0.0, -9.81])
    clamps = Boundary.of(([0.0, 0.0, 0.0], [0.5, 0.5, 0.5, 0.5]), ([0.6, 0.2, 0.0], [0.0, 0.7, 0.0, 0.7]))
    rod = discretise(model, clamps, elements)
    start = sagging_start(clamps, cable.length, model.gravity, 0, elements)
    ours, theirs = (compiled(s.settle)(rod, start, None) for s in (solver, MixedNewton()))
    distance = float(jnp.max(jnp.linalg.norm(ours.configuration.r - theirs.configuration.r, axis=1)))
    if not (distance < _ALIKE and int(ours.steps) == int(theirs.steps)):
        raise Scan2FlexError(f"the compiled kernel's result differs by {distance:.1e} m of 1 m: it is not used.")
