"""Recovery of EI and GJ from grids of guesses, by the default fit, least squares from the guess alone, BFGS and Nelder-Mead.

BFGS and Nelder-Mead take seconds from a guess, so 33 x 33 of them are hours: they are run in a random order, the same for all
methods, for as long as there is time, and the figures say from how many guesses.
"""

import matplotlib.pyplot as plt
import numpy as np

from benchmarks import paper
from benchmarks.sensitivity.bench import run as was_run
from benchmarks.sensitivity.bench import save
from scan2flex_jax import plot
from scan2flex_jax.fitting.least_squares import levenberg_marquardt
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.statics.verdict import SENTENCES
from scan2flex_jax.sweep import Axis, Calls, Outcome, Output, fits, grid

ALONE = "guess alone"  # least squares with no other start beside the guess
METHODS = ("least-squares", ALONE, "bfgs", "nelder-mead")
SIZES = (5, 33)
ORDER = 0  # seed of the order in which guesses are taken


def run(bench, wanted) -> None:
    study = paper.simulated()
    for n in SIZES:
        for method in METHODS:
            name = f"{n} x {n}, {method}"
            if wanted(name):
                task = alone(study) if method == ALONE else fits(study, method=method)
                order = np.random.default_rng(ORDER).permutation(n * n)
                found = bench.sweep(f"guesses {name}", task, lanes(n), chunk=5, cost=order)
                bench.keep("guesses", name, outcomes(found))
                picture(found, method, f"guesses-{method.replace(' ', '-')}-{n}")


def lanes(n):
    axis = Axis(paper.guesses(n), "N m^2")
    return grid(guess_bending_stiffness=axis, guess_torsional_stiffness=axis)


def alone(study) -> Calls:
    """Least squares from the guess only."""
    problem = Problem(study)
    goal = problem.goal(np.full(problem.poses.count, 1e-3))

    def descend(lane):
        before = problem.evaluator.equilibria
        found = levenberg_marquardt(goal, np.log([lane[f"guess_{name}"] for name in paper.STIFF]))
        solved = problem.evaluator.equilibria - before
        verdict = found.evaluation.verdict
        if not np.isfinite(found.cost):
            code = int(np.max(verdict.code))
            return Outcome({}, code, f"a pose at the guess: {SENTENCES[code]}", stable=False, steps=solved)
        values = dict(zip(paper.STIFF, np.exp(found.shared), strict=True)) | {"cost": found.cost}
        return Outcome(values, steps=solved, out_of_balance=float(np.max(verdict.out_of_balance)))

    outputs = {name: Output("N m^2") for name in paper.STIFF} | {"cost": Output()}
    return Calls(descend, outputs, {"study": study, "function": "levenberg_marquardt"})


def outcomes(found) -> dict:
    """Of the guesses that were run: how many led to the truth, and what it took."""
    done = was_run(found)
    steps, seconds = found["steps"].values[done], found["seconds"].values[done]
    return {
        "guesses": int(done.size), "run": int(done.sum()), "recovered": int(recovered(found)[done].sum()),
        "failed": int(np.sum(found["code"].values[done] != 0)), "equilibria": int(steps.sum()),
        "median equilibria": float(np.median(steps)), "seconds": float(seconds.sum()), "median_s": float(np.median(seconds)),
    }  # fmt: skip


def recovered(found) -> np.ndarray:
    return paper.recovered(*(found[name].values for name in paper.STIFF))


def picture(found, method, name) -> None:
    """Where each guess led; guesses that were not run are white."""
    figure, ax = plt.subplots(figsize=(6.2, 4.0), layout="constrained")
    done = was_run(found)
    ax.set_title(f"{method}: {recovered(found)[done].sum()} of {done.sum()} recovered", fontsize=10)
    plot.basins(found, ax)
    save(figure, name)
