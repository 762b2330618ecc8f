"""`python -m benchmarks.peers `: every program on every problem; the record is kept after each of them.

Processor seconds of this process, on one processor and one thread, are
compared: other jobs on the machine change them less than the wall clock. After each run of another program ours solves the same
problem on all meshes (``beside``), so that a slow period of the machine affects both. Two ratios are formed of each program:

* at equal accuracy, its seconds over those of our fastest run beside it that is at least as accurate;
* at equal mesh, its error over ours with as many elements.
"""

import os
from collections.abc import Callable
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from time import process_time
from typing import NamedTuple

os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")

import jax
import jax.numpy as jnp
import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import optimistix as optx
from matplotlib.ticker import NullFormatter

from benchmarks.peers import continuum
from benchmarks.peers.problems import PROBLEMS, Solution
from benchmarks.record import one_processor, record
from scan2flex_jax import Boundary, Cable, CableModel, equilibrium

PICTURE = Path(__file__).parents[2] / "docs" / "peers.png"
OURS = "scan2flex_jax"
MESHES = (10, 20, 40, 80, 160)
TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
ENOUGH, MOST = 1.0, 25  # processor seconds spent on repeats, and their number
EQUAL = 1.0 + 1e-6  # the same minimum of the same energy, found by two programs, is as accurate
AT_REST = 1e-4  # of the length: relaxations that came closer to rest than this are compared by their mesh


def ours(problem, elements, solver=None):
    """This package as a user calls it: generic start, the answer with its status."""
    stiff = problem.stretching
    cable = Cable(problem.length, problem.density, problem.bending, problem.torsion, stiff, stiff)
    model = CableModel(cable, jnp.array([0.0, 0.0, -problem.weight / problem.density]))
    end = None if problem.free else (jnp.array(problem.end), jnp.array(problem.end_frame))
    boundary = Boundary.of((jnp.zeros(3), jnp.array(problem.start_frame)), end)

    def solve():
        answer = equilibrium(model, boundary, elements=elements, solver=solver)
        points, v = np.asarray(answer.points), answer.verdict
        if not bool(v.solved):
            raise FloatingPointError(v.sentence())
        return [Solution(np.asarray(answer.s), points, {"steps": int(v.steps)})]

    return solve


def collocation(problem, tolerance):
    """scipy's `solve_bvp`: the size is its tolerance, the mesh its own."""
    start = continuum.guess(problem)

    def solve():
        curve = continuum.solve(problem, tolerance, start)
        return [Solution(curve.nodes, curve.at(curve.nodes), {"nodes": len(curve.nodes)})]

    return solve


def relaxation(module, problem, elements):
    """A program that is imported when it is run."""
    return import_module(f"benchmarks.peers.{module}").prepare(problem, elements)


class Program(NamedTuple):
    """How a program is used: its library, ``sizes`` (elements, or tolerances), ``prepare(problem, size)`` which returns the
    solve, a function of no arguments, and its style in the picture."""

    what: str
    library: str
    sizes: tuple
    prepare: Callable
    style: tuple[str, str]


BFGS = optx.BFGS(1e-8, 1e-8)
PROGRAMS = {
    OURS: Program("mixed Newton from its own generic start", "jax", MESHES, ours, ("#c1272d", "o")),
    "scan2flex_jax, BFGS": Program(
        "optimistix BFGS, its reference", "optimistix", MESHES[:3], partial(ours, solver=BFGS), ("#e8939a", "o")
    ),
    "solve_bvp": Program(
        "scipy's collocation of the continuous equations, own mesh", "scipy", TOLERANCES, collocation, ("#222222", "s")
    ),
    "PyElastica": Program(
        "end elements centred on clamps", "elastica", MESHES[:3], partial(relaxation, "elastica_rod"), ("#2a6fbb", "^")
    ),
    "MuJoCo flex": Program(
        "end edges centred on clamps", "mujoco", MESHES[:4], partial(relaxation, "mujoco_flex"), ("#d08c00", "<")
    ),
}


def measured(solve) -> list[Solution]:
    """Solutions with their least processor seconds; the first solve compiles, and a long relaxation is not repeated."""
    runs: list[list[Solution]] = []
    spent = first = 0.0
    while len(runs) < MOST and (spent - first < ENOUGH or len(runs) < 4):
        begin = process_time()
        answers = solve()
        seconds = process_time() - begin
        runs.append([a if a.seconds else a._replace(seconds=seconds) for a in answers])
        spent += seconds
        first = first or seconds
        if first > ENOUGH and answers[0].seconds:
            return runs[0]
    repeats = runs[1:]
    return [a._replace(seconds=min(r[i].seconds for r in repeats if i < len(r))) for i, a in enumerate(repeats[0])]


def rows_of(name, curves, own) -> list[dict]:
    """One row for each solution of a program, with our seconds ``beside`` it by mesh; ``own`` are our solves."""
    rows, program = [], PROGRAMS[name]
    for problem, curve in curves.items():
        for size in program.sizes:
            row = {"peer": name, "problem": problem, "size": size}
            try:
                answers = measured(program.prepare(PROBLEMS[problem], size))
            except (FloatingPointError, RuntimeError, ValueError) as error:
                rows.append(row | {"failed": str(error)})
                continue
            beside = {str(n): measured(own[problem, n])[0].seconds for n in MESHES}
            for a in answers:
                error = np.linalg.norm(a.points - curve.at(a.s), axis=1).max() / curve.problem.length
                rows.append(row | {"error": float(error), "seconds": a.seconds} | a.facts | {"beside": beside})
    return rows


def usable(rows) -> list[dict]:
    """Rows that came to an end, and those relaxations that came to rest."""
    return [r for r in rows if "failed" not in r and r.get("rest to", 0.0) is not None]


def ratios(rows) -> dict:
    """Per program: seconds over ours at equal accuracy and errors over ours at equal mesh (least, median)."""
    good, table = usable(rows), {}
    own = {(r["problem"], str(r["size"])): r["error"] for r in good if r["peer"] == OURS}
    for name in dict.fromkeys(r["peer"] for r in good if r["peer"] != OURS):
        theirs = [r for r in good if r["peer"] == name]
        as_good = [[t for n, t in r["beside"].items() if own[r["problem"], n] <= r["error"] * EQUAL] for r in theirs]
        time = [r["seconds"] / min(seconds) for r, seconds in zip(theirs, as_good, strict=True) if seconds]
        rest = [r for r in theirs if str(r["size"]) in r["beside"] and r.get("rest to", 0.0) <= AT_REST]
        table[name] = {
            "seconds over ours at equal accuracy": _spread(time),
            "runs more accurate than any of ours": len(theirs) - len(time),
            "error over ours at equal mesh": _spread([r["error"] / own[r["problem"], str(r["size"])] for r in rest]),
        }
    return table


def _spread(values):
    return {"least": min(values), "median": float(np.median(values)), "of": len(values)} if values else None


def draw(rows) -> None:
    """Error over processor seconds, one panel for each problem: a line joins the runs of a program from coarse to fine."""
    good = usable(rows)
    figure, axes = plt.subplots(1, len(PROBLEMS), figsize=(13.8, 4.4), sharex=True, sharey=True, layout="constrained")
    for ax, problem in zip(axes, PROBLEMS, strict=True):
        for name, program in PROGRAMS.items():
            own = [r for r in good if r["peer"] == name and r["problem"] == problem]
            best = [min((r for r in own if r["size"] == n), key=_worth) for n in dict.fromkeys(r["size"] for r in own)]
            colour, marker = program.style
            x, y = [r["seconds"] for r in best], [r["error"] for r in best]
            ax.plot(x, y, color=colour, marker=marker, ms=5, lw=1.3 if name != OURS else 2.2, label=name)
        ax.set(xscale="log", yscale="log", title=problem, xlabel="processor time (s)")
        ax.xaxis.set_minor_formatter(NullFormatter())
        ax.grid(True, which="major", color="#dddddd", lw=0.6)
    axes[0].set_ylabel("largest node error / length")
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=5, frameon=False, fontsize=9)
    figure.savefig(PICTURE, dpi=140)
    plt.close(figure)


def _worth(row):
    """Of the tolerances of rest, the first whose error is within a tenth of the last one's would do: error, then time."""
    return round(row["error"], 4 if row["error"] > 1e-3 else 12), row["seconds"]


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    mpl.use("Agg")
    one_processor()
    results = {"problems": {}, "peers": {}, "runs": []}
    curves = {}
    for name, problem in PROBLEMS.items():
        curves[name], results["problems"][name] = continuum.reference(problem)
    own = {(name, n): ours(problem, n) for name, problem in PROBLEMS.items() for n in MESHES}
    for name, program in PROGRAMS.items():
        rows = []
        results["peers"][name] = {"what": program.what}
        if find_spec(program.library):
            rows = rows_of(name, curves, own)
        else:
            results["peers"][name]["missing"] = f"{program.library} is not installed: pip install -e '.[peers]'"
        results["runs"] += rows
        results["ratios"] = ratios(results["runs"])
        record("peers", results)
        draw(results["runs"])
        print(f"{name}: {results['peers'][name].get('missing') or f'{len(rows)} results'}", flush=True)


if __name__ == "__main__":
    main()
