"""What the compiled solvers take, and which rods they solve."""

import jax.numpy as jnp

from scan2flex_jax.rod.effect import overriding
from scan2flex_jax.rod.model import Configuration, Rod
from scan2flex_jax.statics.newton import MAX_STEPS, MixedNewton, lendable_stiffness


def operands(rod: Rod, start: Configuration, newton: MixedNewton, max_steps: int | None) -> list:
    """The arrays of `Operands` in `solver.h` and `settle.cu`, in their order."""
    s, b = rod.section, rod.boundary
    mode, lendable, atol = newton.begin(rod, start).mode, lendable_stiffness(rod)[-1, -1], jnp.asarray(newton.atol)
    most = jnp.asarray(MAX_STEPS if max_steps is None else max_steps, jnp.int64)
    return [s.ds, s.stiffness, s.natural, s.within, rod.load.force, rod.load.lever, b.position, b.rotation, b.held, *start,
            mode, lendable, atol, most]  # fmt: skip


def translated(rod: Rod, arrays: list) -> bool:
    """Whether a compiled solver solves this rod."""
    known = all(array is not None and array.dtype == jnp.float64 for array in arrays[:-1])
    return known and not [effect for hook in ("strain_energy", "node_potential") for effect in overriding(rod.effects, hook)]
