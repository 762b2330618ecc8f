"""Seconds for an equilibrium, its Jacobian, and its compilation.

`python -m benchmarks.equilibrium [PART ...]` from the repository's root writes `benchmarks/results/equilibrium.json`; other
parts keep their figures. The cable: 1 m, EI 0.1, GJ 0.25 N m^2, 0.2 kg/m, the end clamp at (0.6, 0.2, 0) m turned by 90
degrees about the tangent. Targets: 1 ms from the solution, 5 ms from a generic start, Jacobian at most half a forward solve,
first call 8 s, and 2 s from the persistent cache.
"""

import json
import os
import subprocess
import sys
import tempfile
from time import perf_counter

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx

from benchmarks.record import RESULTS, conclude, machine, one_processor, record, timed, timed_in_turn
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.model import CableModel
from scan2flex_jax.statics.solve import equilibrium

POSES = {  # end position (m), quaternion of the end clamp (scalar first); the start clamp points along +x
    "level": ((0.6, 0.0, 0.0), 0.0),
    "twisted +90": ((0.6, 0.2, 0.0), np.pi / 2),
    "twisted -90": ((0.6, 0.2, 0.0), -np.pi / 2),
}
FRAME = np.array([[0.0, 0, 1], [0.0, -1, 0], [1.0, 0, 0]]).T


def model(EI=0.1, GJ=0.25) -> CableModel:
    return CableModel(Cable(1.0, 0.2, EI, GJ), jnp.array([0.0, 0.0, -9.81]))


def boundary(name="twisted +90") -> Boundary:
    end, angle = POSES[name]
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[1.0, 0, 0], [0, c, -s], [0, s, c]])
    return Boundary.of((jnp.zeros(3), jnp.array(FRAME)), (jnp.array(end), jnp.array(turn @ FRAME)))


def waited(function, *args, **options):
    """A call of no arguments that waits for the result."""
    return lambda: jax.block_until_ready(eqx.filter(function(*args, **options), eqx.is_array))


def solves() -> dict:
    """Per pose: generic start and start at the solution, Newton and BFGS, with their steps and verdicts."""
    table = {}
    for name in POSES:
        m, b = model(), boundary(name)
        found = equilibrium(m, b)
        bfgs = equilibrium(m, b, solver=optx.BFGS(1e-8, 1e-8))
        warm = equilibrium(m, b, start=found.configuration)
        calls = {"generic": waited(equilibrium, m, b), "warm": waited(equilibrium, m, b, start=found.configuration)}
        times = timed_in_turn(calls, 100)
        table[name] = {
            "generic": times["generic"] | told(found),
            "warm": times["warm"] | told(warm),
            "bfgs generic": timed(waited(equilibrium, m, b, solver=optx.BFGS(1e-8, 1e-8)), 3) | told(bfgs),
            "bfgs apart (parts of L)": float(jnp.max(jnp.linalg.norm(bfgs.points - found.points, axis=1))),
        }
    return table


def told(answer) -> dict:
    """The status of a solution."""
    v = answer.verdict
    return {"verdict": v.sentence(), "steps": int(v.steps), "out_of_balance": float(v.out_of_balance)}


def jacobians() -> dict:
    """Observed points and their Jacobian for 2 and 12 parameters, against the points alone; generic and warm starts."""
    b = boundary()
    start = equilibrium(model(), b).configuration

    def cable(x):
        return Cable(1.0, x[2], x[:2], x[3], 1e5, 1e5, x[4:7], x[7:10])

    def points(x, first):
        m = CableModel(cable(x), jnp.array([x[10], x[11], -9.81]))
        return equilibrium(m, b, start=first).observed

    def two(y, first):
        return points(full.at[:2].set(y[0]).at[3].set(y[1]), first)

    full = jnp.array([0.1, 0.1, 0.2, 0.25] + [0.0] * 8)
    table = {}
    for name, first in (("generic", None), ("warm", start)):
        calls = {"points": waited(jax.jit(lambda x, f=first: points(x, f)), full)}
        for label, f, x in (("2", two, full[jnp.array([0, 3])]), ("12", points, full)):

            def with_jacobian(x, f=f, first=first):
                y, push = jax.linearize(lambda x: f(x, first), x)
                return y, jax.vmap(push)(jnp.eye(x.size))

            calls[f"points and jacobian, {label} parameters"] = waited(jax.jit(with_jacobian), x)
        times = timed_in_turn(calls, 100)
        for t in list(times.values())[1:]:
            t["jacobian over forward"] = t["min_s"] / times["points"]["min_s"] - 1.0
        table[name] = times
    return table


def first_call() -> dict:
    """Seconds of the first solve in this process, imports left out, and of the second."""
    m, b = model(), boundary()
    seconds = []
    for _ in range(2):
        begin = perf_counter()
        waited(equilibrium, m, b)()
        seconds.append(perf_counter() - begin)
    return {"first_s": seconds[0], "second_s": seconds[1]}


def fresh_processes() -> dict:
    """`first_call` in new processes: the first compiles, the second finds the result in the cache."""
    with tempfile.TemporaryDirectory() as folder:
        settings = {"JAX_COMPILATION_CACHE_DIR": folder, "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
        command, table = [sys.executable, "-m", "benchmarks.equilibrium", "first-call"], {}
        for name in ("compiling", "from the cache"):
            done = subprocess.run(command, env=os.environ | settings, capture_output=True, text=True, check=True)
            table[name] = json.loads(done.stdout)
        return table


def watched(r) -> dict[str, float]:
    """Ratios of times that were taken in turn, or of one process to the next; smaller is better."""
    table = {}
    for name, t in r["solves"].items():
        table[f"{name}: warm over generic"] = t["warm"]["min_s"] / t["generic"]["min_s"]
        table[f"{name}: Newton over BFGS"] = t["generic"]["min_s"] / t["bfgs generic"]["min_s"]
    for start, t in r["jacobian"].items():
        for count in (2, 12):
            excess = t[f"points and jacobian, {count} parameters"]["jacobian over forward"]
            table[f"{start}: shape and Jacobian of {count} over the shape"] = 1.0 + excess
    cached, compiling = (r["first call"][way]["first_s"] for way in ("from the cache", "compiling"))
    return table | {"first call: from the cache over compiling": cached / compiling}


PARTS = {"first call": fresh_processes, "solves": solves, "jacobian": jacobians}


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    asked = sys.argv[1:]
    if asked == ["first-call"]:
        sys.stdout.write(json.dumps(first_call()))
        return
    file = RESULTS / "equilibrium.json"
    results = json.loads(file.read_text())["results"] if asked and file.exists() else {}
    for name in [part for part in PARTS if not asked or part in asked]:
        if name != "first call":  # a user has all processors, and compiling uses them
            one_processor()
        results[name] = PARTS[name]()
        results.setdefault("load average", {})[name] = machine()["load_average"]
        sys.stderr.write(f"{name}: {json.dumps(results[name])}\n")
        record("equilibrium", results)  # after each part, so that an interrupted run leaves what it has
    conclude("equilibrium", results, watched(results))


if __name__ == "__main__":
    main()
