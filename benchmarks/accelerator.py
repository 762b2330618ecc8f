"""A GPU: equilibria a second by its kernel and by XLA, alone, each with eight derivatives, and through `sweep`.

`python -m benchmarks.accelerator` takes four minutes at most: 1 to 1,048,576 cables, EI and GJ each over two decades, 40
elements, generic start, without compilation; then the default solver on one core of the host and on all together (the compiled
one, where `python -m scan2flex_jax.statics.kernel` has installed it). The record, `accelerator`, has the name of the card, and
not what there was no time for. Goals on an H100 or H200: 2,500,000 a second alone, 1,000,000 with derivatives or by a sweep.
"""

import argparse
import os
import subprocess
import sys
from functools import partial
from time import perf_counter

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.batches import stiffnesses
from benchmarks.equilibrium import boundary, model, waited
from benchmarks.record import conclude, record, timed
from scan2flex_jax.compilation import compiled
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.model import CableModel
from scan2flex_jax.statics import MixedNewton, equilibrium
from scan2flex_jax.statics.kernel.solver import default_solver
from scan2flex_jax.sweep import Output, draws, equilibria, sweep

LIMIT = 150.0  # s, after which nothing more is begun on the GPU
REPEATS, ON_A_CORE, LONG = 3, 256, 5.0  # of a call; cables of a call on a core, and s for which it is repeated
MIDDLE = {"middle": (lambda e: e.points[len(e.points) // 2], Output("m", ("axis",)))}  # little to carry home
REST = (1.0, 0.2, 0.6, 0.2, 0.0)
PLAN = (  # way, cables: the most important first
    ("kernel", 65_536), ("kernel, sweep", 65_536), ("kernel, derivatives", 65_536), ("XLA", 65_536), ("kernel", 1_048_576),
    ("kernel, sweep", 1_048_576), ("XLA, derivatives", 16_384), ("kernel", 4096), ("kernel, sweep", 4096), ("kernel", 1),
    ("XLA", 4096), ("kernel, derivatives", 262_144), ("kernel, derivatives", 4096), ("kernel, sweep", 1), ("XLA", 1),
)  # fmt: skip


def middle(x, solver):
    """Node in the middle (m) and verdict; ``x``: EI twice, GJ (N m^2), length (m), density (kg/m), position of the end (m)."""
    clamps = boundary()
    held = Boundary(clamps.position.at[1].set(x[5:]), clamps.rotation, clamps.held)
    e = equilibrium(CableModel(Cable(x[3], x[4], x[:2], x[2]), jnp.array([0.0, 0.0, -9.81])), held, solver=solver)
    return e.points[len(e.points) // 2], e.verdict


def numbers(count: int) -> jax.Array:
    EI, GJ = stiffnesses(count)
    return jnp.concatenate([jnp.stack([EI, EI, GJ], axis=1), jnp.tile(jnp.array(REST), (count, 1))], axis=1)


def on_the_gpu(way: str, count: int) -> dict:
    """Seconds, equilibria a second, steps and the share that is solved."""
    name, _, what = way.partition(", ")
    if what == "sweep":
        clamps = boundary()
        task = equilibria(lambda sample: (model(sample["EI"], sample["GJ"]), clamps), MIDDLE)
        samples = draws(**{key: (x, "N m^2") for key, x in zip(("EI", "GJ"), stiffnesses(count), strict=True)})
        call = partial(sweep, task, samples, chunk=count)
        found = call()
        code, steps = found["code"].values, found["steps"].values
    else:
        one = partial(middle, solver=default_solver() if name == "kernel" else MixedNewton())
        many, x = compiled(jax.vmap(jax.jacfwd(one, has_aux=True) if what else one)), numbers(count)
        verdict = many(x)[1]
        call, code, steps = waited(many, x), np.asarray(verdict.code), np.asarray(verdict.steps)
    t, steps = timed(call, REPEATS), {"steps: mean, most": [float(steps.mean()), int(steps.max())]}
    return t | {"equilibria per second": count / t["min_s"], "solved": float(np.mean(code == 0))} | steps


def on_a_core(core: int) -> float:
    """Equilibria a second of the default solver on one core."""
    os.sched_setaffinity(0, {core})
    mapped = compiled(lambda x: jax.lax.map(partial(middle, solver=default_solver()), x))
    call, calls = waited(mapped, numbers(ON_A_CORE)), 0
    call()
    begin = perf_counter()
    while perf_counter() - begin < LONG:
        call()
        calls += 1
    return calls * ON_A_CORE / (perf_counter() - begin)


def on_the_host(cores: list[int]) -> float:
    """Equilibria a second of these cores together, a process each."""
    command, environment = [sys.executable, "-m", "benchmarks.accelerator", "--core"], os.environ | {"JAX_PLATFORMS": "cpu"}
    processes = [subprocess.Popen([*command, str(c)], env=environment, stdout=subprocess.PIPE, text=True) for c in cores]
    return sum(float(p.communicate()[0]) for p in processes)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.accelerator", description=__doc__.splitlines()[0])
    parser.add_argument("--core", type=int, help="time this core of the host instead, and print equilibria a second")
    core, begin = parser.parse_args().core, perf_counter()
    jax.config.update("jax_enable_x64", True)
    if core is not None:
        print(on_a_core(core))
        return
    if jax.default_backend() != "gpu":
        raise SystemExit("JAX has no GPU here: this benchmark needs one (pip install 'jax[cuda13]').")
    results = {"device": jax.devices()[0].device_kind, "solver": type(default_solver()).__name__, "gpu": {}}
    for way, count in PLAN:
        if perf_counter() - begin < LIMIT:
            try:
                found = on_the_gpu(way, count)
            except jax.errors.JaxRuntimeError as error:  # too little memory
                found = {"equilibria per second": 0.0, "failed": str(error).splitlines()[0]}
            results["gpu"].setdefault(way, {})[str(count)] = found
            sys.stderr.write(f"{way}, {count} cables: {found['equilibria per second']:.0f} equilibria a second\n")
            record("accelerator", results)
    cores = sorted(os.sched_getaffinity(0))
    results["host: equilibria per second"] = {str(len(some)): on_the_host(some) for some in (cores[:1], cores)}
    rates = {way: max(row["equilibria per second"] for row in rows.values()) for way, rows in results["gpu"].items()}
    slower = {f"time by {way}": rates["kernel"] / rate for way, rate in rates.items() if way.startswith("kernel, ") and rate}
    conclude("accelerator", results, slower)


if __name__ == "__main__":
    main()
