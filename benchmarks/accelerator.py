"""A GPU: equilibria a second by its kernel and by XLA, alone, each with eight derivatives, and through `sweep`.

`python -m benchmarks.accelerator` takes three minutes at most: 1 to 1,048,576 cables, EI and GJ each over two decades, 40
elements, generic start, without compilation. The record, `accelerator`, has the name of the card, and not what there was no
time for; `benchmarks.batches` times the processor. Goals on an H100 or H200: 2,500,000 a second alone, 1,000,000 with
derivatives or by a sweep.
"""

import sys
from functools import partial
from time import perf_counter

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.batches import boundary, cable_model, stiffnesses, waited
from benchmarks.record import record, timed
from scan2flex_jax.compilation import compiled
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.model import CableModel
from scan2flex_jax.statics import MixedNewton, equilibrium
from scan2flex_jax.statics.kernel.solver import default_solver
from scan2flex_jax.sweep import Output, draws, equilibria, sweep

LIMIT = 150.0  # s, after which nothing more is begun
REPEATS = 3
MIDDLE = {"middle": (lambda e: e.points[len(e.points) // 2], Output("m", ("axis",)))}  # little to carry home
REST = (1.0, 0.2, 0.6, 0.2, 0.0)
PLAN = (  # way, cables: the most important first
    ("kernel", 65_536), ("kernel, sweep", 65_536), ("kernel, derivatives", 65_536), ("XLA", 65_536), ("kernel", 1_048_576),
    ("kernel, sweep", 1_048_576), ("XLA, derivatives", 16_384), ("kernel", 4096), ("kernel, sweep", 4096), ("kernel", 1),
    ("XLA", 4096), ("kernel, derivatives", 262_144), ("kernel, derivatives", 4096), ("kernel, sweep", 1), ("XLA", 1),
)  # fmt: skip


def middle(x, solver):
    """Node in the middle (m) and verdict; ``x``: EI twice, GJ (N m^2), length (m), density (kg/m), position of the end (m)."""
    model = CableModel(Cable(x[3], x[4], x[:2], x[2]), jnp.array([0.0, 0.0, -9.81]))
    e = equilibrium(model, boundary(x[5:]), solver=solver)
    return e.points[len(e.points) // 2], e.verdict


def parameters(count: int) -> jax.Array:
    """The argument of `middle` for so many cables."""
    EI, GJ = stiffnesses(count)
    return jnp.concatenate([jnp.stack([EI, EI, GJ], axis=1), jnp.tile(jnp.array(REST), (count, 1))], axis=1)


def on_the_gpu(way: str, count: int) -> dict:
    """Seconds, equilibria a second, steps and the share that is solved."""
    name, _, what = way.partition(", ")
    if what == "sweep":
        task = equilibria(lambda sample: (cable_model(sample["EI"], sample["GJ"]), boundary()), MIDDLE)
        samples = draws(**{key: (x, "N m^2") for key, x in zip(("EI", "GJ"), stiffnesses(count), strict=True)})
        call = partial(sweep, task, samples, chunk=count)
        answer = call()
        code, steps = answer["code"].values, answer["steps"].values
    else:
        one = partial(middle, solver=default_solver() if name == "kernel" else MixedNewton())
        many, x = compiled(jax.vmap(jax.jacfwd(one, has_aux=True) if what else one)), parameters(count)
        verdict = many(x)[1]
        call, code, steps = waited(many, x), np.asarray(verdict.code), np.asarray(verdict.steps)
    t, steps = timed({way: call}, REPEATS)[way], {"steps: mean, most": [float(steps.mean()), int(steps.max())]}
    return t | {"equilibria per second": count / t["min_s"], "solved": float(np.mean(code == 0))} | steps


def main() -> None:
    begin = perf_counter()
    jax.config.update("jax_enable_x64", True)
    if jax.default_backend() != "gpu":
        raise SystemExit("JAX has no GPU here: this benchmark needs one (pip install 'jax[cuda13]').")
    results = {"device": jax.devices()[0].device_kind, "solver": type(default_solver()).__name__, "gpu": {}}
    for way, count in PLAN:
        if perf_counter() - begin < LIMIT:
            try:
                row = on_the_gpu(way, count)
            except jax.errors.JaxRuntimeError as error:  # too little memory
                row = {"equilibria per second": 0.0, "failed": str(error).splitlines()[0]}
            results["gpu"].setdefault(way, {})[str(count)] = row
            sys.stderr.write(f"{way}, {count} cables: {row['equilibria per second']:.0f} equilibria a second\n")
            record("accelerator", results)


if __name__ == "__main__":
    main()
