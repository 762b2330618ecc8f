"""Three ways to fit the paper's simulated cable with the same equilibrium solver, from the same guesses.

Least squares with the implicit Jacobian (the package's default method, from the guess alone), the same least squares with
forward differences in place of that Jacobian, and Nelder-Mead, the paper's method. Counted are the equilibria solved, also
those that differences need; recovered means both stiffnesses within 0.1 %.
"""

from time import process_time

import jax
import numpy as np

from benchmarks import paper
from scan2flex_jax.fitting.evaluate import Evaluator
from scan2flex_jax.fitting.least_squares import levenberg_marquardt, nelder_mead
from scan2flex_jax.fitting.problem import Problem

GUESSES = [(1.0, 1.0), (0.01, 0.01), (100.0, 100.0), (0.01, 100.0), (100.0, 0.01)]  # N m^2: middle and corners of the paper's
_STEP = 1e-6  # of a logarithm, for the differences: about the root of what rounding leaves of a shape


class Differences(Evaluator):
    """Residuals whose Jacobian comes from one more solve of every pose for each parameter."""

    def __call__(self, shared, local=None, *, start=None, derivative=True):
        """As `Evaluator`; perturbed solves start from the solution."""
        e = super().__call__(shared, local, start=start, derivative=False)
        if not derivative or not e.solved:
            return e
        columns = []
        for k in range(len(shared)):
            moved = np.array(shared, float)
            moved[k] += _STEP
            other = super().__call__(moved, local, start=e.configuration, derivative=False)
            columns.append((other.residual - e.residual) / _STEP)
        return e._replace(jacobian=np.stack(columns, axis=-1))


def ways(study) -> dict:
    """Name -> function of a guess that gives the estimates, the equilibria and whether the method says it converged."""

    def run(minimise, evaluator=None):
        def fit(guess):
            problem = Problem(study)
            if evaluator:
                e = problem.evaluator
                problem.evaluator = evaluator(e.layout, e.poses, e.elements, e.distance)
            found = minimise(problem.goal(np.full(problem.poses.count, 1e-3)), np.log(guess))
            return np.exp(found.shared), problem.evaluator.equilibria, bool(found.converged)

        return fit

    return {
        "least squares, implicit Jacobian": run(levenberg_marquardt),
        "least squares, finite differences": run(levenberg_marquardt, Differences),
        "Nelder-Mead": run(nelder_mead),
    }


def compared() -> dict:
    """Per way: every guess with its estimates, equilibria and seconds, and their sums; compilation is left out."""
    jax.config.update("jax_enable_x64", True)
    table = {}
    for name, fit in ways(paper.simulated()).items():
        fit((0.2, 0.2))
        runs = []
        for guess in GUESSES:
            begin = process_time()
            values, equilibria, converged = fit(guess)
            seconds = process_time() - begin
            told = {"guess": guess, "found": [float(v) for v in values], "converged": converged}
            told["recovered"] = bool(paper.recovered(*values))
            runs.append(told | {"equilibria": equilibria, "seconds": seconds})
        table[name] = {
            "guesses": len(runs),
            "recovered": sum(r["recovered"] for r in runs),
            "median equilibria": float(np.median([r["equilibria"] for r in runs])),
            "median_s": float(np.median([r["seconds"] for r in runs])),
            "runs": runs,
        }
    first = table["least squares, implicit Jacobian"]
    for row in table.values():
        row["equilibria over the first"] = row["median equilibria"] / first["median equilibria"]
        row["seconds over the first"] = row["median_s"] / first["median_s"]
    return table
