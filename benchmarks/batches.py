"""Many equilibria on a processor: one call after the other, in one compiled call, and vectorised.

`python -m benchmarks.batches` times 256 cables, EI and GJ each over two decades, 40 elements, generic start: one call after the
other, the same loop inside one compiled call (what a sweep does on a CPU), one vectorised call, which takes as many steps as
its slowest cable, vectorised groups of cables with similar GJ/EI, and the compiled solver where it is installed
(`python -m scan2flex_jax.statics.kernel`). Processor seconds; the record is `batches`. `benchmarks.accelerator` times a GPU.
"""

from time import process_time

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.equilibrium import boundary, model, waited
from benchmarks.record import conclude, one_processor, timed_in_turn
from scan2flex_jax.compilation import compiled
from scan2flex_jax.statics import MixedNewton, equilibrium
from scan2flex_jax.statics.kernel import library
from scan2flex_jax.statics.kernel.solver import CompiledNewton

BATCH, GROUP = 256, 8


def stiffnesses(count: int) -> np.ndarray:
    """EI and GJ (2, count), N m^2, each over two decades."""
    return 10.0 ** np.random.default_rng(0).uniform(-2, 0, (2, count))


def on_a_processor() -> dict:
    """Seconds of a cable in each way, by the solver in JAX unless stated."""
    EI, GJ = map(jnp.array, stiffnesses(BATCH))
    b, alike = boundary(), jnp.argsort(GJ / EI)
    models = [model(float(x), float(y)) for x, y in zip(EI, GJ, strict=True)]

    def one(x):
        e = equilibrium(model(*x), b, solver=MixedNewton())
        return e.configuration, e.verdict

    mapped = compiled(lambda *x: jax.lax.map(one, x))
    calls = {
        "loop": lambda: [waited(equilibrium, m, b, solver=MixedNewton())() for m in models],
        "loop in one call": waited(mapped, EI, GJ),
        "vmap": waited(compiled(lambda *x: jax.vmap(one)(x)), EI, GJ),
        f"vmap, groups of {GROUP}": waited(
            compiled(lambda *x: jax.lax.map(one, x, batch_size=GROUP)), EI[alike], GJ[alike]
        ),
    }  # fmt: skip
    if library.path().exists():
        fast = CompiledNewton(library.register(library.path()))
        solved = compiled(lambda *x: jax.vmap(lambda y: equilibrium(model(*y), b, solver=fast).configuration)(x))
        calls["compiled solver"] = waited(solved, EI, GJ)
    times = {name: t | {"s per cable": t["min_s"] / BATCH} for name, t in timed_in_turn(calls, 5, process_time).items()}
    verdict = mapped(EI[alike], GJ[alike])[1]
    steps = [float(f(verdict.steps)) for f in (jnp.mean, jnp.max)] + [float(verdict.steps.reshape(-1, GROUP).max(1).mean())]
    return {"cables": BATCH, "solved": int(jnp.sum(verdict.solved)), "steps: mean, most, of a group": steps} | times


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    one_processor()
    results = on_a_processor()
    conclude("batches", results, {f"{way} over loop": results[way]["min_s"] / results["loop"]["min_s"]
                                  for way in ("loop in one call", f"vmap, groups of {GROUP}")})  # fmt: skip


if __name__ == "__main__":
    main()
