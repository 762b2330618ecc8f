"""1,089 guesses (33 x 33 of EI and GJ) as one batched program, beside the loop over the same minimisations and over whole fits.

Processor time, so that a slow spell of the machine does not count. The loops, and the program from the guess alone, are timed
on a random share of the guesses; from both starts the program runs all of them. Its compilation stands apart.
The record is its own, `benchmarks/results/minima.json`.
"""

from time import process_time

import jax
import numpy as np

from benchmarks import paper
from benchmarks.record import conclude
from benchmarks.sensitivity.guesses import lanes, recovered
from scan2flex_jax import fit
from scan2flex_jax.compilation import compiled
from scan2flex_jax.fitting.least_squares import levenberg_marquardt
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.sweep import Axis, draws, minima, sweep

SIZE, SHARE = 33, 64
WIDTH = 16  # samples of the vectorised program


def run(bench, wanted) -> None:
    if not wanted("minima"):
        return
    study, every = paper.simulated(), lanes(SIZE)
    some = np.random.default_rng(0).permutation(every.count)[:SHARE]
    guesses = np.stack([axis.values for axis in every.inputs.values()], axis=1)
    found = {"guesses": every.count, "guesses of the loops": SHARE, "loop": loops(study, guesses[some])}
    share = draws(**{name: Axis(x, "N m^2") for name, x in zip(every.inputs, guesses[some].T, strict=True)})
    for starts, guessed in (("both", every), ("guess", share)):
        found[f"batched, from {starts}"] = batched(study, guessed, starts)
    found["vectorised, from both"] = vectorised(study, every, some)
    loop, program = found["loop"], "a batched program over the loop"
    ratios = {
        f"{program}, both starts": found["batched, from both"]["ms"] / loop["minimise: ms"],
        f"{program}, guess alone": found["batched, from guess"]["ms"] / loop["guess alone: ms"],
    }
    conclude("minima", found, ratios)


def loops(study, guesses) -> dict:
    """Milliseconds of a guess: of the minimisation from both starts, of the descent from the guess alone, of a whole fit."""
    problem = Problem(study)
    goal = problem.goal(problem.first_scale())
    calls = {
        "minimise": lambda guess: Problem(paper.guessed(study, guess)).minimise("least-squares"),
        "guess alone": lambda guess: levenberg_marquardt(goal, np.log(guess)),
        "fit": lambda guess: fit(paper.guessed(study, guess)),
    }
    out = {}
    for name, call in calls.items():
        call(guesses[0])
        begin = process_time()
        for guess in guesses:
            call(guess)
        out[f"{name}: ms"] = 1e3 * (process_time() - begin) / len(guesses)
    return out


def batched(study, guessed, starts) -> dict:
    """The sweep over these guesses, with how many converged and how many are right, and the seconds of the first call."""
    task = minima(study, starts=starts)
    begin = process_time()
    sweep(task, lanes(2), chunk=WIDTH, at_once=WIDTH)
    first = process_time() - begin
    begin = process_time()
    found = sweep(task, guessed, at_once=WIDTH)
    seconds = process_time() - begin
    converged, right = found["code"].values == 0, recovered(found)
    return {
        "guesses": guessed.count, "ms": 1e3 * seconds / guessed.count, "seconds": seconds, "compilation_s": first,
        "converged": int(converged.sum()), "recovered": int(right.sum()),
        "converged elsewhere": int(np.sum(converged & ~right)),
    }  # fmt: skip


def vectorised(study, every, some) -> dict:
    """Milliseconds of a guess where samples of a call are vectorised, as on accelerators."""
    task = minima(study)
    rows = [task.prepare({name: x[i] for name, x in every.take(slice(None)).items()}) for i in some]
    call = compiled(jax.vmap(task.function))
    calls = [jax.tree.map(lambda *x: np.stack(x), *rows[i : i + WIDTH]) for i in range(0, len(rows), WIDTH)]
    jax.block_until_ready(call(calls[0]))
    begin = process_time()
    for each in calls:
        jax.block_until_ready(call(each))
    return {"ms": 1e3 * (process_time() - begin) / len(rows), "width": WIDTH}
