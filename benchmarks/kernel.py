"""The compiled solver (`statics.kernel`) beside that in JAX, in one run: single solves, a batch, fits, the processor's limit.

`python -m benchmarks.kernel` from the repository's root builds the kernel in a temporary folder and writes
`benchmarks/results/kernel.json`. Times are the least of repeats that were taken in turn, on one core. Aims: 0.2 ms for each of
256 cables of one call, 0.3 ms for a solve that starts at the solution.
"""

import json
import os
import re
import subprocess
import sys
import tempfile
from time import perf_counter, process_time

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks.equilibrium import BATCH, GROUP, POSES, boundary, model, waited
from benchmarks.peers import arithmetic
from benchmarks.record import conclude, machine, one_processor, record, timed, timed_in_turn
from scan2flex_jax.compilation import compiled
from scan2flex_jax.examples import example_path
from scan2flex_jax.fitting import fit
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.model import discretise
from scan2flex_jax.statics import MixedNewton, equilibrium
from scan2flex_jax.statics.kernel import elements, library
from scan2flex_jax.statics.kernel.build import build
from scan2flex_jax.statics.kernel.solver import CompiledNewton, default_solver
from scan2flex_jax.study import load_study

ELEMENTS = 40
_OPERATION = re.compile(r"^const \w+ v\d+ = (?:\S+ [-+*/] \S+|-\S+|lanes_sqrt\(.*\));$", re.MULTILINE)


def single(kernel) -> dict:
    """One cable at a time, from the generic start and from the solution."""
    table = {}
    for name in POSES:
        m, b = model(), boundary(name)
        found = equilibrium(m, b, solver=MixedNewton())
        starts = {"generic": None, "warm": found.configuration}
        solvers = {"JAX": MixedNewton(), "kernel": kernel}
        calls = {
            f"{start}, {solver}": waited(equilibrium, m, b, start=starts[start], solver=solvers[solver])
            for start in starts
            for solver in solvers
        }
        apart = jnp.max(jnp.abs(equilibrium(m, b, solver=kernel).points - found.points))
        table[name] = timed_in_turn(calls, 200) | {"apart (parts of L)": float(apart), "steps": int(found.verdict.steps)}
    return table


def batch(kernel) -> dict:
    """256 cables, EI and GJ each over two decades: between the same clamps, and each between its own."""
    rng = np.random.default_rng(0)
    EI, GJ = (jnp.array(10.0 ** rng.uniform(-2, 0, BATCH)) for _ in range(2))
    place = jnp.array(rng.uniform(-0.05, 0.05, (BATCH, 3)))
    alike = jnp.argsort(GJ / EI)
    b = boundary()

    def of(solver, x):
        clamps = Boundary(b.position.at[1].add(x[2]), b.rotation, b.held)
        e = equilibrium(model(*x[:2]), clamps, solver=solver)
        return e.configuration, e.verdict

    def call(solver, mapping):
        return compiled(lambda *x: mapping(lambda x: of(solver, x), x))

    def grouped(f, x):
        return jax.lax.map(f, x, batch_size=GROUP)

    ways = {
        "JAX, loop in one call": call(MixedNewton(), jax.lax.map),
        f"JAX, groups of {GROUP}": call(MixedNewton(), grouped),
        "kernel, loop in one call": call(kernel, jax.lax.map),
        "kernel, vmap": call(kernel, lambda f, x: jax.vmap(f)(x)),
    }
    table = {}
    for name, moved in (("the same clamps", 0.0), ("each its own", 1.0)):
        x = EI[alike], GJ[alike], moved * place[alike]
        times = timed_in_turn({way: waited(f, *x) for way, f in ways.items()}, 7, process_time)
        (one, verdict), (other, of_kernel) = (f(*x) for f in (ways["JAX, loop in one call"], ways["kernel, vmap"]))
        table[name] = {way: t | {"s per cable": t["min_s"] / BATCH} for way, t in times.items()} | {
            "solved": int(jnp.sum(of_kernel.solved)),
            "steps": float(jnp.mean(verdict.steps)),
            "lanes with other steps": int(jnp.sum(verdict.steps != of_kernel.steps)),
            "apart (parts of L)": float(jnp.max(jnp.abs(one.r - other.r))),
        }
    return {"cables": BATCH} | table


def fits() -> dict:
    """A fit of the simulated cable, compiled before, in processes with and without the kernel."""
    table = {}
    for _ in range(2):
        for name, value in (("JAX", "off"), ("kernel", "on")):
            command = [sys.executable, "-m", "benchmarks.kernel", "fit"]
            environment = os.environ | {library.SWITCH: value}
            done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
            found = json.loads(done.stdout)
            table[name] = {key: min(x, table.get(name, found)[key]) for key, x in found.items()}
    return table


def one_fit() -> dict:
    """Seconds of the first fit in this process, which compiles, and of later ones."""
    study = load_study(example_path("simulated-cable"))
    begin = perf_counter()
    fit(study)
    first = perf_counter() - begin
    later = timed(lambda: fit(study), 5, process_time)["min_s"]
    return {"first_s": first, "later_s": later, "with the kernel": float(isinstance(default_solver(), CompiledNewton))}


def limits(kernel) -> dict:
    """Operations of a Newton step in both solvers, the time of a step, and the share of the processor's rate on 6x6 blocks."""
    best = arithmetic.peak()
    m, b = model(), boundary("twisted -90")  # many steps
    rod, newton = discretise(m, b, ELEMENTS), MixedNewton()
    start = equilibrium(m, boundary("level"), solver=newton).configuration
    call = {name: compiled(s.settle) for name, s in (("JAX", newton), ("kernel", kernel))}
    times = timed_in_turn({name: waited(f, rod, start) for name, f in call.items()}, 100)
    steps = int(call["JAX"](rod, start).steps)
    counts = {
        "JAX": arithmetic.counted(newton.step, rod, start, newton.begin(rod, start))["arithmetic"],
        "kernel": operations(ELEMENTS),
    }
    table = {"steps": steps, "peak (1/s)": best}
    for name, count in counts.items():
        seconds = times[name]["min_s"] / steps
        table[name] = {"operations of a step": count, "s": seconds, "operations per second": count / seconds}
        if "missing" not in best:
            table[name]["share of eight at once"] = count / seconds / best["multiply_wide"]
    return table


def operations(n) -> int:
    """Additions, multiplications, divisions and square roots of one step of the kernel."""
    parts = elements.source().split("namespace in {")[1:]
    stiffened, strain, element, predicted, moved = (len(_OPERATION.findall(part)) for part in parts)
    sums = 2 * (12 + 12 + 72)  # of an element's share in those of the nodes
    block = 2 * 6 * 6 * 8 + 6 * (1 + 14 + 5 * 2 * 14) + 2 * 2 * 36  # update, Gauss-Jordan, back-substitution
    return n * (stiffened + strain + element + predicted + sums) + (n + 1) * (moved + block)


PARTS = {"single": single, "batch": batch, "limits": limits}


def watched(r) -> dict[str, float]:
    """Ratios of times taken in turn; smaller is better."""
    table = {f"{pose}, {start}: kernel over JAX": t[f"{start}, kernel"]["min_s"] / t[f"{start}, JAX"]["min_s"]
             for pose, t in r["single"].items() for start in ("generic", "warm")}  # fmt: skip
    for name in ("the same clamps", "each its own"):
        t = r["batch"][name]
        table[f"batch, {name}: kernel over JAX"] = t["kernel, vmap"]["min_s"] / t["JAX, loop in one call"]["min_s"]
    table["later fits: kernel over JAX"] = r["fits"]["kernel"]["later_s"] / r["fits"]["JAX"]["later_s"]
    return table


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    one_processor()
    if sys.argv[1:] == ["fit"]:
        sys.stdout.write(json.dumps(one_fit()))
        return
    with tempfile.TemporaryDirectory() as folder:
        os.environ.setdefault(library.FOLDER, folder)
        if not library.path().exists():
            build()
        results = {"load average": {}}
        kernel = CompiledNewton(library.register(library.path()))
        for name, part in PARTS.items():
            results[name] = part(kernel)
            results["load average"][name] = machine()["load_average"]
            record("kernel", results)
        results["fits"] = fits()
    conclude("kernel", results, watched(results))


if __name__ == "__main__":
    main()
