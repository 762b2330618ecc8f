"""The fit's methods from the paper's 25 guesses, and the seconds of a fit as a user calls it.

`python -m benchmarks.fit` from the repository's root writes `benchmarks/results/fit.json`. The cable is the paper's
simulated one (EI 0.1, GJ 0.25 N m^2; its shapes are those of the continuous equations); a guess is recovered when both are
within 0.1 %. "least-squares, guess alone" descends from the guess only; the default fit also tries the package's own start.
Seconds are processor seconds. A method that has used up an hour is run from no more guesses: the result says from how many.
Nelder-Mead ends after 400 iterations at the latest, as it does for every user (`fitting.least_squares`).
Targets against Nelder-Mead: 10 times fewer equilibria, 10 times less time. The paper's Nelder-Mead: 19 of 25.
"""

import json
import sys
from time import process_time

import jax
import numpy as np

from benchmarks import paper
from benchmarks.record import conclude, record, timed
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting import METHODS, fit
from scan2flex_jax.fitting.least_squares import levenberg_marquardt
from scan2flex_jax.fitting.problem import Problem

GUESSES = [(EI, GJ) for EI in paper.guesses(5) for GJ in paper.guesses(5)]
LONGEST = 3600.0  # seconds for the guesses of one method


def from_guess(study, method, guess) -> dict:
    """One fit: whether it recovered both stiffnesses, how many equilibria it solved, and its seconds."""
    begin = process_time()
    try:
        f = fit(paper.guessed(study, guess), method)
    except Scan2FlexError:
        return {"guess": guess, "recovered": False, "equilibria": None, "seconds": process_time() - begin}
    found = [f.estimates[name].value for name in paper.TRUTH]
    return outcome(guess, found, f.equilibria, process_time() - begin)


def alone(study, guess) -> dict:
    """Least squares from the guess only, with no other start beside it."""
    begin = process_time()
    problem = Problem(study)
    found = levenberg_marquardt(problem.goal(np.full(problem.poses.count, 1e-3)), np.log(guess))
    return outcome(guess, np.exp(found.shared), problem.evaluator.equilibria, process_time() - begin)


def outcome(guess, found, equilibria, seconds) -> dict:
    return {"guess": guess, "recovered": bool(paper.recovered(*found)), "equilibria": equilibria, "seconds": seconds}


def all_guesses(parts, keep) -> None:
    """Every method from one guess after the other, so that a slow spell of the machine meets all of them; ``keep`` records."""
    runs = {name: [] for name in parts}
    for guess in GUESSES[::2] + GUESSES[1::2]:
        for name, one in parts.items():
            if sum(r["seconds"] for r in runs[name]) < LONGEST:
                runs[name].append(one(guess))
                keep(name, summary(runs[name]))
                told = {key: value for key, value in summary(runs[name]).items() if key != "runs"}
                sys.stderr.write(f"{name}: {json.dumps(told)}\n")


def summary(runs) -> dict:
    """Of the guesses that a method was run from."""
    solved = [r["equilibria"] for r in runs if r["equilibria"] is not None]
    return {
        "guesses": len(runs),
        "recovered": sum(r["recovered"] for r in runs),
        "median equilibria": float(np.median(solved)) if solved else None,
        "equilibria": int(np.sum(solved)),
        "median_s": float(np.median([r["seconds"] for r in runs])),
        "seconds": float(np.sum([r["seconds"] for r in runs])),
        "runs": runs,
    }


def first_calls(study) -> dict:
    """Seconds of the first fit by each method in this process, what it compiles included."""
    return {m: from_guess(study, m, (0.2, 0.2))["seconds"] for m in METHODS}


def over(results, method, reference="least-squares") -> dict:
    """Equilibria and seconds of a method over those of the default, from the guesses that both were run from."""
    table = {}
    for key in ("equilibria", "seconds"):
        ours, theirs = ({tuple(r["guess"]): r[key] for r in results[m]["runs"]} for m in (reference, method))
        both = [g for g in ours if ours[g] is not None and theirs.get(g) is not None]
        table[key] = sum(theirs[g] for g in both) / sum(ours[g] for g in both)
    return table


def watched(results) -> dict[str, float]:
    """The default over each other method, in equilibria and in seconds: smaller is better."""
    return {
        f"{key}, least-squares over {method}": 1.0 / ratio
        for method in ("bfgs", "nelder-mead")
        for key, ratio in results[f"{method} over least-squares"].items()
    }


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    study = paper.simulated(validate=True)
    results = {"first calls (s)": first_calls(study), "default fit, no guess": timed(lambda: fit(study), 10)}
    results["default fit, no guess"]["equilibria"] = fit(study).equilibria
    parts = {m: lambda guess, m=m: from_guess(study, m, guess) for m in METHODS}
    parts["least-squares, guess alone"] = lambda guess: alone(study, guess)

    def keep(name, figures):  # after each fit, so that an interrupted run leaves what it has
        results[name] = figures
        record("fit", results)

    all_guesses(parts, keep)
    for method in ("bfgs", "nelder-mead"):
        results[f"{method} over least-squares"] = over(results, method)
    conclude("fit", results, watched(results))


if __name__ == "__main__":
    main()
