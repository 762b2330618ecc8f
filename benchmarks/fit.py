"""The fit's methods from the paper's 25 guesses, and the seconds of a fit as a user calls it.

`python -m benchmarks.fit` from the repository's root writes `benchmarks/results/fit.json`. The cable is the paper's
simulated one (EI 0.1, GJ 0.25 N m^2; its shapes are those of the continuous equations); a guess is recovered when both are
within 0.1 %. "least-squares, guess alone" descends from the guess only; the default fit also tries the package's own start.
A method that runs out of its time (an hour) is run from every other guess, then no more: the result says from how many.
Nelder-Mead ends after 400 iterations at the latest, as it does for every user (`fit.least_squares`).
Targets against Nelder-Mead: 10 times fewer equilibria, 10 times less time. The paper's Nelder-Mead: 19 of 25.
"""

import json
import sys
from dataclasses import replace
from time import perf_counter

import jax
import numpy as np

from benchmarks.record import record, timed
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.examples import example_path
from scan2flex_jax.fit import METHODS, fit
from scan2flex_jax.fit.least_squares import levenberg_marquardt
from scan2flex_jax.fit.run import Problem
from scan2flex_jax.study import load_study

TRUTH = {"bending_stiffness": 0.1, "torsional_stiffness": 0.25}  # N m^2
DECADES = (0.01, 0.1, 1.0, 10.0, 100.0)
GUESSES = [(EI, GJ) for EI in DECADES for GJ in DECADES]
WITHIN = 1e-3
LONGEST = 3600.0  # seconds for the guesses of one method


def guessed(study, guess):
    """The study with guesses of EI and GJ (N m^2)."""
    values = dict(zip(TRUTH, guess, strict=True))
    return replace(study, unknowns=tuple(replace(u, guess=values[u.name]) for u in study.unknowns))


def from_guess(study, method, guess) -> dict:
    """One fit: whether it recovered both stiffnesses, how many equilibria it solved, and its seconds."""
    begin = perf_counter()
    try:
        f = fit(guessed(study, guess), method)
    except Scan2FlexError:
        return {"guess": guess, "recovered": False, "equilibria": None, "seconds": perf_counter() - begin}
    found = [f.estimates[name].value for name in TRUTH]
    return outcome(guess, found, f.equilibria, perf_counter() - begin)


def alone(study, guess) -> dict:
    """Least squares from the guess only, with no other start beside it."""
    begin = perf_counter()
    problem = Problem(study)
    found = levenberg_marquardt(problem.goal(np.full(problem.poses.count, 1e-3)), np.log(guess))
    return outcome(guess, np.exp(found.shared), problem.evaluator.equilibria, perf_counter() - begin)


def outcome(guess, found, equilibria, seconds) -> dict:
    recovered = bool(np.allclose(found, list(TRUTH.values()), rtol=WITHIN, atol=0.0))
    return {"guess": guess, "recovered": recovered, "equilibria": equilibria, "seconds": seconds}


def all_guesses(one) -> dict:
    """Every other guess first, then the others while there is time."""
    begin, runs = perf_counter(), []
    for guess in GUESSES[::2] + GUESSES[1::2]:
        if perf_counter() - begin < LONGEST:
            runs.append(one(guess))
    solved = [r["equilibria"] for r in runs if r["equilibria"] is not None]
    return {
        "guesses": len(runs),
        "recovered": sum(r["recovered"] for r in runs),
        "median equilibria": float(np.median(solved)),
        "equilibria": int(np.sum(solved)),
        "median_s": float(np.median([r["seconds"] for r in runs])),
        "seconds": float(np.sum([r["seconds"] for r in runs])),
        "runs": runs,
    }


def first_calls(study) -> dict:
    """Seconds of the first fit by each method in this process, what it compiles included."""
    return {m: from_guess(study, m, (0.2, 0.2))["seconds"] for m in METHODS}


def ratios(results) -> dict:
    """Nelder-Mead over least squares, from the guesses that both were run from."""
    table = {}
    for key in ("equilibria", "seconds"):
        ours, theirs = ({tuple(r["guess"]): r[key] for r in results[m]["runs"]} for m in ("least-squares", "nelder-mead"))
        both = [g for g in ours if ours[g] is not None and theirs.get(g) is not None]
        table[key] = sum(theirs[g] for g in both) / sum(ours[g] for g in both)
    return table


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    study = load_study(example_path("simulated-cable"))
    results = {"first calls (s)": first_calls(study), "default fit, no guess": timed(lambda: fit(study), 10)}
    results["default fit, no guess"]["equilibria"] = fit(study).equilibria
    parts = {m: lambda guess, m=m: from_guess(study, m, guess) for m in METHODS}
    parts["least-squares, guess alone"] = lambda guess: alone(study, guess)
    for name, one in parts.items():
        results[name] = all_guesses(one)
        told = {k: v for k, v in results[name].items() if k != "runs"}
        sys.stderr.write(f"{name}: {json.dumps(told)}\n")
        record("fit", results)  # after each part, so that an interrupted run leaves what it has
    results["nelder-mead over least-squares"] = ratios(results)
    record("fit", results)


if __name__ == "__main__":
    main()
