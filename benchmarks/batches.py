"""Many equilibria on a processor: one call after the other, in one compiled call, and vectorised.

`python -m benchmarks.batches` times 256 cables, EI and GJ each over two decades, 40 elements, generic start: one call after the
other, the same loop inside one compiled call (what a sweep does on a CPU), one vectorised call, which takes as many steps as
its slowest cable, vectorised groups of cables with similar GJ/EI, and the compiled solver where it is installed
(`python -m scan2flex_jax.statics.kernel`). Processor seconds; the record is `batches`. `benchmarks.accelerator` times a GPU.
"""

from time import process_time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.record import one_processor, record, timed
from scan2flex_jax.compilation import compiled
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.model import CableModel
from scan2flex_jax.statics import MixedNewton, equilibrium
from scan2flex_jax.statics.kernel import library
from scan2flex_jax.statics.kernel.solver import CompiledNewton

BATCH, GROUP = 256, 8
START = np.array([[0.0, 0, 1], [0.0, -1, 0], [1.0, 0, 0]]).T  # d3 = +x
END = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]) @ START  # turned by 90 degrees about the tangent


def cable_model(EI, GJ) -> CableModel:
    """A cable of 1 m and 0.2 kg/m, stiffnesses in N m^2."""
    return CableModel(Cable(1.0, 0.2, EI, GJ), jnp.array([0.0, 0.0, -9.81]))


def boundary(end=(0.6, 0.2, 0.0)) -> Boundary:
    """Its clamps: at the origin, and at ``end`` (m)."""
    return Boundary.of((jnp.zeros(3), jnp.array(START)), (jnp.asarray(end), jnp.array(END)))


def waited(function, *args, **options):
    """A call of no arguments that waits for the result."""
    return lambda: jax.block_until_ready(eqx.filter(function(*args, **options), eqx.is_array))


def stiffnesses(count: int) -> np.ndarray:
    """EI and GJ (2, count), N m^2, each over two decades."""
    return 10.0 ** np.random.default_rng(0).uniform(-2, 0, (2, count))


def on_a_processor() -> dict:
    """Seconds of a cable in each way, by the solver in JAX unless stated."""
    EI, GJ = map(jnp.array, stiffnesses(BATCH))
    b, by_ratio = boundary(), jnp.argsort(GJ / EI)
    models = [cable_model(float(x), float(y)) for x, y in zip(EI, GJ, strict=True)]

    def one(x):
        e = equilibrium(cable_model(*x), b, solver=MixedNewton())
        return e.configuration, e.verdict

    mapped = compiled(lambda *x: jax.lax.map(one, x))
    calls = {
        "loop": lambda: [waited(equilibrium, m, b, solver=MixedNewton())() for m in models],
        "loop in one call": waited(mapped, EI, GJ),
        "vmap": waited(compiled(lambda *x: jax.vmap(one)(x)), EI, GJ),
        f"vmap, groups of {GROUP}": waited(
            compiled(lambda *x: jax.lax.map(one, x, batch_size=GROUP)), EI[by_ratio], GJ[by_ratio]
        ),
    }  # fmt: skip
    if library.path().exists():
        fast = CompiledNewton(library.register(library.path()))
        solved = compiled(lambda *x: jax.vmap(lambda y: equilibrium(cable_model(*y), b, solver=fast).configuration)(x))
        calls["compiled solver"] = waited(solved, EI, GJ)
    times = {name: t | {"s per cable": t["min_s"] / BATCH} for name, t in timed(calls, 5, process_time).items()}
    verdict = mapped(EI[by_ratio], GJ[by_ratio])[1]
    steps = [float(f(verdict.steps)) for f in (jnp.mean, jnp.max)] + [float(verdict.steps.reshape(-1, GROUP).max(1).mean())]
    return {"cables": BATCH, "solved": int(jnp.sum(verdict.solved)), "steps: mean, most, of a group": steps} | times


if __name__ == "__main__":
    jax.config.update("jax_enable_x64", True)
    one_processor()
    record("batches", on_a_processor())
