"""The paper's Section 6.2: the influence of guesses, of turned clamps and of stiffness on the estimates.

`python -m benchmarks.sensitivity [PART ...]` from the repository's root writes `benchmarks/results/sensitivity.json` and
pictures to `docs/sensitivity`. The cable is the paper's simulated one: EI 0.1, GJ 0.25 N m^2, three poses fitted, of shapes
that solve the continuous equations, without noise. A guess is *recovered* when both estimates are within 0.1 %. Parts:

    guesses      recovery of EI and GJ from 5 x 5 and 33 x 33 guesses: least squares (also from the guess alone, with no other
                 start), BFGS, Nelder-Mead; guesses are taken in a random order for as long as there is time
    clamps       six clamps of three poses turned at random, by up to 3 degrees, unknown to the study (the paper's Fig. 5):
                 errors, the share of their variance that is linear in the turns, and the effect of a prior on the orientations
    cantilever   relative error of EI over EI/(g rhoA) of a cantilever whose tip is measured to 1 mm (Section 2.4): the error of
                 the sinking u over its slope by log EI, and its limit for stiff cables, dEI/EI = 8 EI du/(w L^4), w = g rhoA

Every sweep is kept on disk (`build/sensitivity`): a run that is killed, or whose time is up, goes on from there. Remove
that folder after a change of the package.
"""

import argparse
import json
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

from benchmarks.record import record, recorded
from scan2flex_jax import Boundary, Cable, CableModel, equilibrium, load_study, plot
from scan2flex_jax.examples import example_path
from scan2flex_jax.fitting.least_squares import levenberg_marquardt
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.study import Tolerance
from scan2flex_jax.sweep import Outcome, Output, Task, draws, fits, grid, noisy, random_turns, sweep, turned
from scan2flex_jax.sweep.task import NOT_RUN

ROOT = Path(__file__).parents[1]
TRUTH = {"bending_stiffness": 0.1, "torsional_stiffness": 0.25}  # N m^2
STIFF = tuple(TRUTH)
WITHIN = 1e-3
LENGTH, WEIGHT = 1.0, 0.2 * 9.81  # m, N/m
GUESSES = ("guess_bending_stiffness", "guess_torsional_stiffness")
METHODS = ("least-squares", "guess alone", "bfgs", "nelder-mead")
TILT = np.deg2rad(3.0)  # the paper's largest turn of a clamp
NOISE = 3.0e-4  # m, white, of the curves in the study with a prior: no curve is exact, and the prior is weighed against it
PRIOR = TILT / 3.0  # rad about each axis: an angle even in +-3 degrees about an axis anywhere has this standard deviation
DRAWS = 1000
TIP_ERROR = 1.0e-3  # m, standard deviation of the measured sinking of the tip
VALUES = np.logspace(-3, 1, 33)  # EI, N m^2
ALONG_X = np.array([0.5, 0.5, 0.5, 0.5])  # quaternion: d3 = +x


def simulated():
    """The study of the cable with the poses that are fitted."""
    study = load_study(example_path("simulated-cable"))
    return replace(study, poses=study.fit_poses)


class Store:
    """Results of all parts (those of the last run where a part is not run again), and the time that a sweep may take."""

    def __init__(self, longest: float):
        self.results, self.longest = recorded("sensitivity"), longest

    def sweep(self, name: str, task, samples, **options):
        """The samples that there was time for."""
        folder = ROOT / "build" / "sensitivity" / "".join(c if c.isalnum() else "-" for c in name)
        folder.parent.mkdir(parents=True, exist_ok=True)
        return sweep(task, samples, store=folder, longest=self.longest, **options)

    def keep(self, part: str, name: str, figures: dict) -> None:
        """Record the figures of one sweep."""
        self.results.setdefault(part, {})[name] = figures
        print(f"{part}, {name}: {json.dumps(figures)}", flush=True)
        record("sensitivity", self.results)


def done(found) -> np.ndarray:
    """The samples that were run, as a mask."""
    return found["code"].values != NOT_RUN


def save(figure, name: str) -> None:
    plot.save(figure, ROOT / "docs" / "sensitivity" / f"{name}.png", dpi=80)
    plt.close(figure)


def guesses(store: Store) -> None:
    study = simulated()
    for n in (5, 33):
        axes = np.meshgrid(*2 * [np.logspace(-2, 2, n)])
        order = np.random.default_rng(0).permutation(n * n)
        samples = draws(**{name: (x.ravel()[order], "N m^2") for name, x in zip(GUESSES, axes, strict=True)})
        for method in METHODS if n == 5 else ("least-squares", "bfgs", "nelder-mead"):
            task = alone(study) if method == "guess alone" else fits(study, method=method)
            found = store.sweep(f"guesses {n} x {n}, {method}", task, samples, chunk=5)
            ran, right = done(found), recovered(found)
            steps, seconds = found["steps"].values[ran], found["seconds"].values[ran]
            store.keep("guesses", f"{n} x {n}, {method}", {
                "guesses": int(ran.size), "run": int(ran.sum()), "recovered": int(right[ran].sum()),
                "failed": int(np.sum(found["code"].values[ran] != 0)), "equilibria": int(steps.sum()),
                "median equilibria": float(np.median(steps)), "seconds": float(seconds.sum()),
                "median_s": float(np.median(seconds)),
            })  # fmt: skip
            figure, ax = plt.subplots(figsize=(6.2, 4.0), layout="constrained")
            ax.set_title(f"{method}: {right[ran].sum()} of {ran.sum()} recovered", fontsize=10)
            plot.basins(on_a_grid(found), ax)
            save(figure, f"guesses-{method.replace(' ', '-')}-{n}")


def recovered(found) -> np.ndarray:
    """Samples whose estimates are both within 0.1 %; NaN is not."""
    return np.all([np.abs(found[name].values / truth - 1.0) < WITHIN for name, truth in TRUTH.items()], axis=0)


def on_a_grid(found):
    """The draws of guesses by their two axes."""
    out = found.set_index(draw=list(GUESSES)).unstack("draw")
    return out.assign_coords({name: out[name].assign_attrs(found[name].attrs) for name in GUESSES})


def alone(study) -> Task:
    """Least squares from the guess only."""
    problem = Problem(study)
    goal = problem.goal(np.full(problem.poses.count, 1e-3))

    def descend(sample):
        before = problem.evaluator.equilibria
        found = levenberg_marquardt(goal, np.log([sample[f"guess_{name}"] for name in STIFF]))
        solved, verdict = problem.evaluator.equilibria - before, found.evaluation.verdict
        if not np.isfinite(found.cost):
            return Outcome({}, int(np.max(verdict.code)), "a pose at the guess is not solved", stable=False, steps=solved)
        values = dict(zip(STIFF, np.exp(found.shared), strict=True)) | {"cost": found.cost}
        return Outcome(values, steps=solved, out_of_balance=float(np.max(verdict.out_of_balance)))

    outputs = {name: Output("N m^2") for name in STIFF} | {"cost": Output()}
    return Task(descend, outputs, about={"study": study, "function": "levenberg_marquardt"})


def perturbed(study, sample):
    """Clamps that the study does not know to be turned; the fit begins from the truth, as the paper's does."""
    study = turned(study, sample["tilt"])
    return replace(study, unknowns=tuple(replace(u, guess=TRUTH[u.name]) for u in study.unknowns))


def perturbed_and_noisy(study, sample):
    """The same with noisy curves, whose noise the study states."""
    return perturbed(noisy(study, NOISE, int(sample["seed"])), sample)


def with_prior(study, sample):
    """The same with the orientations of the clamps as unknowns under their prior."""
    return replace(perturbed_and_noisy(study, sample), tolerance=Tolerance(clamp_rotation=PRIOR))


def mirrored(study, sample):
    """Turns out of the plane of the plane pose only: none about d2 of its clamps, the axis of its bending."""
    return perturbed(study, {"tilt": sample["tilt"] * np.array([1.0, 0.0, 1.0])})


def plane():
    """The plane pose alone, which does not determine GJ: it is known."""
    study = simulated()
    unknowns = tuple(u for u in study.unknowns if u.name == "bending_stiffness")
    cable = {**study.cable, "torsional_stiffness": TRUTH["torsional_stiffness"]}
    return replace(study, cable=cable, unknowns=unknowns, poses=(study.pose("plane"),))


def tolerant():
    return replace(simulated(), tolerance=Tolerance(clamp_rotation=PRIOR))


CASES = {  # the study, its change by a sample, options of the fit, the largest angle, number of draws
    "exact shapes": (simulated, perturbed, {}, TILT, DRAWS),
    "noise, clamps with a prior": (tolerant, with_prior, {}, TILT, DRAWS),
    "exact shapes, a third of the angle": (simulated, perturbed, {}, TILT / 3, 250),
    "noise": (simulated, perturbed_and_noisy, {}, TILT, 250),
    "exact shapes, the paper's distance": (simulated, perturbed, {"distance": "integrated"}, TILT, 100),
    "plane pose alone, turned out of its plane": (plane, mirrored, {}, TILT, 100),
}


def clamps(store: Store) -> None:
    for name, (make, change, options, largest, count) in CASES.items():
        study = make()
        turns = random_turns(DRAWS, len(study.poses), largest)[:count]
        samples = draws(tilt=(turns, "rad"), seed=np.arange(float(count)))
        found = store.sweep(f"clamps {name}", fits(study, change, **options), samples, chunk=10)
        store.keep("clamps", name, errors(found))


def errors(found) -> dict:
    """Of the logarithms of the estimates against the truth: mean, its standard error, spread, share below, linear share."""
    ran, solved, low = done(found), found["code"].values == 0, []
    out = {"draws": int(ran.sum()), "failed": int(np.sum(ran & ~solved))}
    for name, value in ((n, v) for n, v in TRUTH.items() if n in found):
        log = np.log(found[name].values[solved] / value)
        low.append(log < 0)
        out[name] = {
            "mean": float(np.mean(log)), "standard error": float(np.std(log, ddof=1) / np.sqrt(len(log))),
            "spread": float(np.std(log, ddof=1)), "underestimated": float(np.mean(low[-1])),
        } | linear_share(found["tilt"].values[solved], log)  # fmt: skip
    return out | ({"both underestimated": float(np.mean(low[0] & low[1]))} if len(low) == 2 else {})


def linear_share(turns, log) -> dict:
    """Share of the variance that is linear in the turns, cross-validated; from five draws a component on."""
    X = turns.reshape(len(turns), -1)
    if len(X) < 5 * X.shape[1]:
        return {}
    X, left = np.column_stack([np.ones(len(X)), X]), np.empty_like(log)
    for fold in range(5):
        held = np.arange(len(log)) % 5 == fold
        left[held] = log[held] - X[held] @ np.linalg.lstsq(X[~held], log[~held], rcond=None)[0]
    return {"linear in the turns": float(1.0 - np.var(left) / np.var(log))}


def tip(log_EI):
    """Sinking of the tip (m) of a horizontal cantilever, and its status."""
    cable = Cable(LENGTH, WEIGHT / 9.81, jnp.exp(log_EI), TRUTH["torsional_stiffness"])
    model = CableModel(cable, jnp.array([0.0, 0.0, -9.81]))
    e = equilibrium(model, Boundary.of((np.zeros(3), ALONG_X)))
    return -e.points[-1, 2], e.verdict


def slope_of_tip(inputs):
    slope, verdict = jax.jacfwd(tip, has_aux=True)(jnp.log(inputs["bending_stiffness"]))
    return {"slope": slope}, verdict


def cantilever(store: Store) -> None:
    found = sweep(Task(slope_of_tip, {"slope": Output("m")}, traced=True), grid(bending_stiffness=(VALUES, "N m^2")))
    w = WEIGHT
    error, formula = TIP_ERROR / np.abs(found["slope"].values), 8.0 * VALUES * TIP_ERROR / (w * LENGTH**4)
    stiff = VALUES / (w * LENGTH**3) > 1.0
    over = (error / formula)[stiff]
    store.keep("cantilever", "error of EI", {
        "EI/(g rhoA) (m^3)": (VALUES / w).tolist(), "error of the tip (m)": TIP_ERROR, "relative error of EI": error.tolist(),
        "measured over formula, EI/(w L^3) above 1": [float(over.min()), float(over.max())],
        "power of EI/(g rhoA), stiff half": float(np.polyfit(np.log(VALUES[stiff]), np.log(error[stiff]), 1)[0]),
    })  # fmt: skip
    figure, ax = plt.subplots(figsize=(5.6, 4.0), layout="constrained")
    ax.loglog(VALUES / w, error, color="#c1272d", lw=1.5, label="measured: 1 mm over the slope of the tip")
    ax.loglog(VALUES / w, formula, "--", color="k", lw=1.0, label=r"$8\,\Delta u\,EI/(g\rho A\,L^4)$")
    ax.set(xlabel="EI/(g rhoA) (m$^3$), cable of 1 m", ylabel="relative error of EI (-)")
    ax.legend(frameon=False, fontsize=8)
    save(figure, "cantilever")


PARTS = {"cantilever": cantilever, "clamps": clamps, "guesses": guesses}


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.sensitivity", description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--longest", type=float, default=1800.0, help="seconds for one sweep; the next run goes on")
    args = parser.parse_args()
    if unknown := set(args.parts) - set(PARTS):
        parser.error(f"no part is called {min(unknown)!r}: they are {', '.join(PARTS)}")
    jax.config.update("jax_enable_x64", True)
    mpl.use("Agg")
    store = Store(args.longest)
    for name in args.parts or PARTS:
        PARTS[name](store)


if __name__ == "__main__":
    main()
