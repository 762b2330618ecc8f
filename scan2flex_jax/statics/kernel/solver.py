"""The compiled solver as a rod solver."""

import jax
import jax.numpy as jnp

from scan2flex_jax import programs
from scan2flex_jax.rod.assembly import Derivatives, Elements
from scan2flex_jax.rod.model import Configuration, Rod
from scan2flex_jax.statics.kernel import library
from scan2flex_jax.statics.kernel.operands import operands, translated
from scan2flex_jax.statics.newton import MixedNewton
from scan2flex_jax.statics.solver import AbstractRodSolver, Settled, Steps


class CompiledNewton(AbstractRodSolver):
    """`MixedNewton` as a compiled function: the same steps, and the same result to rounding.

    ``target`` is the name of the function in XLA (`library.target`). Rods that it cannot solve are left to `MixedNewton`: those
    whose effects add energies of their own, and any on other devices than one CPU.
    """

    target: str
    atol: float = MixedNewton.atol

    def settle(self, rod: Rod, start: Configuration, max_steps: Steps = None) -> Settled:
        """See `AbstractRodSolver.settle`."""
        newton = MixedNewton(self.atol)
        arrays = operands(rod, start, newton, max_steps)
        if not translated(rod, arrays) or [device.platform for device in jax.devices()] != ["cpu"]:
            return newton.settle(rod, start, max_steps)
        n = rod.elements
        real = [(n + 1, 3), (n + 1, 3, 3), (n + 1, 6), (n + 1, 6, 6), (n, 6, 6), (2, 2, 6, 6)]  # as in `Derivatives`
        real += [(n, 6), (n, 6), (n, 6, 6), (n, 6, 6), (n, 6, 6)]  # as in `Elements`
        shapes = [jax.ShapeDtypeStruct(shape, jnp.float64) for shape in real]
        shapes += [jax.ShapeDtypeStruct((), kind) for kind in (jnp.int64, jnp.int64, jnp.bool_)]
        call = jax.ffi.ffi_call(self.target, shapes, vmap_method="broadcast_all")
        r, R, gradient, diagonal, upper, ends, *elements, negative, steps, exhausted = call(*arrays)
        derivatives = Derivatives(gradient, diagonal, upper, ends, Elements(*elements))
        return Settled(Configuration(r, R), derivatives, negative, steps, exhausted)


def default_solver() -> AbstractRodSolver:
    """The solver of a caller who names none: on a GPU that of `cuda`, on a CPU the compiled one where it is installed."""
    if jax.default_backend() == "gpu":
        from scan2flex_jax.statics.kernel import cuda  # noqa: PLC0415 - where there is no GPU, nothing is loaded

        return cuda.solver()
    target = library.target()
    return MixedNewton() if target is None else CompiledNewton(target)


programs.CUSTOM_CALLS.append(library.target)  # a kept program solves by it, or by JAX, as it was traced
