"""The compiled solver as a rod solver."""

import jax
import jax.numpy as jnp

from scan2flex_jax.rod.assembly import Derivatives, Elements
from scan2flex_jax.rod.effect import overriding
from scan2flex_jax.rod.model import Configuration, Rod
from scan2flex_jax.statics.kernel import library
from scan2flex_jax.statics.newton import MAX_STEPS, MixedNewton, lendable_stiffness
from scan2flex_jax.statics.solver import AbstractRodSolver, Settled


class CompiledNewton(AbstractRodSolver):
    """`MixedNewton` as a compiled function: the same steps, and the same result to rounding.

    ``target`` is the name of the function in XLA (`library.target`). Rods that it cannot solve are left to `MixedNewton`: those
    whose effects add energies of their own, and any on other devices than one CPU.
    """

    target: str
    atol: float = MixedNewton.atol

    def settle(self, rod: Rod, start: Configuration, max_steps: int | None = None) -> Settled:
        """See `AbstractRodSolver.settle`."""
        newton = MixedNewton(self.atol)
        arrays = _operands(rod, start, newton)
        if not _translated(rod, arrays):
            return newton.settle(rod, start, max_steps)
        n = rod.elements
        real = [(n + 1, 3), (n + 1, 3, 3), (n + 1, 6), (n + 1, 6, 6), (n, 6, 6), (2, 2, 6, 6)]  # as in `Derivatives`
        real += [(n, 6), (n, 6), (n, 6, 6), (n, 6, 6), (n, 6, 6)]  # as in `Elements`
        shapes = [jax.ShapeDtypeStruct(shape, jnp.float64) for shape in real]
        shapes += [jax.ShapeDtypeStruct((), kind) for kind in (jnp.int64, jnp.int64, jnp.bool_)]
        call = jax.ffi.ffi_call(self.target, shapes, vmap_method="broadcast_all")
        most = jnp.asarray(MAX_STEPS if max_steps is None else max_steps, jnp.int64)
        r, R, gradient, diagonal, upper, ends, *elements, negative, steps, exhausted = call(*arrays, most)
        derivatives = Derivatives(gradient, diagonal, upper, ends, Elements(*elements))
        return Settled(Configuration(r, R), derivatives, negative, steps, exhausted)


def default_solver() -> AbstractRodSolver:
    """The solver of a caller who names none: the compiled one where it is installed."""
    target = library.target()
    return MixedNewton() if target is None else CompiledNewton(target)


def _operands(rod, start, newton):
    """The arrays of the function, in its order."""
    s, b = rod.section, rod.boundary
    mode, lendable, atol = newton.begin(rod, start).mode, lendable_stiffness(rod)[-1, -1], jnp.asarray(newton.atol)
    return [s.ds, s.stiffness, s.natural, s.within, rod.load.force, rod.load.lever, b.position, b.rotation, b.held, *start,
            mode, lendable, atol]  # fmt: skip


def _translated(rod, arrays):
    """Whether the function solves this rod."""
    known = all(array is not None and array.dtype == jnp.float64 for array in arrays)
    energies = [effect for hook in ("strain_energy", "node_potential") for effect in overriding(rod.effects, hook)]
    return known and not energies and [device.platform for device in jax.devices()] == ["cpu"]
