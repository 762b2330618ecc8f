"""The paper's Section 6.2 in full, and beyond: guesses, perturbed clamps, natural curvature, and the cantilever of Section 2.4.

`python -m benchmarks.sensitivity [PART ...]` from the repository's root writes `benchmarks/results/sensitivity.json` and
pictures to `docs/sensitivity`. Parts: guesses, clamps, curvature, cantilever, batches. Every part is a sweep that is kept
under `build/sensitivity` and goes on from where it was; a part that is not named keeps the figures of the last run.

The cable is the paper's simulated one (EI 0.1, GJ 0.25 N m^2; shapes of the continuous equations, no noise unless it says so).
"""

import json
import sys
from dataclasses import replace
from pathlib import Path

import jax
import jax.numpy as jnp
import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from scipy.interpolate import CubicHermiteSpline, PchipInterpolator

from benchmarks.record import RESULTS, record, timed
from scan2flex_jax import plot
from scan2flex_jax.equilibrium.solve import SENTENCES, equilibrium
from scan2flex_jax.examples import example_path
from scan2flex_jax.fit.evaluate import one
from scan2flex_jax.fit.least_squares import levenberg_marquardt
from scan2flex_jax.fit.parameters import model_at, template
from scan2flex_jax.fit.poses import boundary_of
from scan2flex_jax.fit.run import Problem
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.model import CableModel
from scan2flex_jax.study import EffectDeclaration, MeasuredCurve, Tolerance, Unknown, load_study
from scan2flex_jax.sweep import (
    Axis,
    Calls,
    Outcome,
    Output,
    Quantity,
    Traced,
    draws,
    equilibria,
    failed,
    fits,
    grid,
    noisy,
    random_turns,
    sweep,
    turned,
)
from scan2flex_jax.sweep import (
    guesses as guesses_of,
)
from scan2flex_jax.sweep.task import NOT_RUN

ROOT = Path(__file__).parents[1]
STORES, PICTURES = ROOT / "build" / "sensitivity", ROOT / "docs" / "sensitivity"
EI, GJ = 0.1, 0.25  # N m^2
STIFF = ("bending_stiffness", "torsional_stiffness")
TRUTH = dict(zip(STIFF, (EI, GJ), strict=True))
WITHIN = 1e-3
TILT = np.deg2rad(3.0)  # the paper's largest perturbation of a clamp


def tell(name):
    return lambda line: sys.stderr.write(f"\r{name}: {line}   ")


def store(part, name):
    return STORES / f"{part}-{name.replace(' ', '-')}"


def simulated():
    """The paper's cable with the poses that are fitted."""
    study = load_study(example_path("simulated-cable"))
    return replace(study, poses=study.fit_poses)


# guesses -----------------------------------------------------------------------------------------------------------------

# bfgs and nelder-mead take 4 to 20 s from a guess: 33 x 33 of them are hours, so they have the paper's 5 x 5 only;
# on 33 x 33 the default fit is its minimisation, which has all to say on where a guess leads
METHODS = {
    "least-squares": (5,),
    "minimisation of least-squares": (5, 33),
    "guess alone": (5, 17),
    "bfgs": (5,),
    "nelder-mead": (5,),
}
LONGEST = 1200.0  # seconds for the guesses of one method in one run; the next run goes on
OUTPUTS = {name: Output("N m^2") for name in STIFF} | {"cost": Output(), "equilibria": Output()}


def guess_grid(n):
    decades = Axis(np.logspace(-2, 2, n), "N m^2")
    return grid(guess_bending_stiffness=decades, guess_torsional_stiffness=decades)


def minimised(study) -> Calls:
    """The minimisation of the default fit, without the noise, the intervals and the poses that follow it."""

    def minimise(lane):
        problem = Problem(guesses_of(study, lane))
        found = problem.minimise("least-squares")
        return outcome(problem, found)

    return Calls(minimise, OUTPUTS, {"study": study, "function": "minimise"})


def outcome(problem, found, before=0) -> Outcome:
    """What a `Minimum` says."""
    solved = problem.evaluator.equilibria - before
    if not np.isfinite(found.cost):
        code = int(np.max(found.evaluation.verdict.code))
        return Outcome({}, code, f"a pose at the guess: {SENTENCES[code]}", stable=False, steps=solved)
    values = dict(zip(STIFF, np.exp(found.shared), strict=True)) | {"cost": found.cost, "equilibria": solved}
    return Outcome(values, steps=solved, out_of_balance=float(np.max(found.evaluation.verdict.out_of_balance)))


def alone(study) -> Calls:
    """Least squares from the guess only, with no other start beside it."""
    problem = Problem(study)
    goal = problem.goal(np.full(problem.poses.count, 1e-3))

    def descend(lane):
        before = problem.evaluator.equilibria
        found = levenberg_marquardt(goal, np.log([lane[f"guess_{name}"] for name in STIFF]))
        return outcome(problem, found, before)

    return Calls(descend, OUTPUTS, {"study": study, "function": "levenberg_marquardt"})


def recovered(found) -> np.ndarray:
    """Lanes whose estimates are both within 0.1 %."""
    return np.all([np.abs(found[name].values / value - 1) < WITHIN for name, value in TRUTH.items()], axis=0)


def guesses(results) -> None:
    study, part = simulated(), results.setdefault("guesses", {})
    for n in (5, 33, 17):
        for method in (m for m, sizes in METHODS.items() if n in sizes):
            name = f"{method.replace(' ', '-')}-{n}"
            own = {"guess alone": alone, "minimisation of least-squares": minimised}
            task = own[method](study) if method in own else fits(study, method=method)
            found = sweep(task, guess_grid(n), store=STORES / name, chunk=11, longest=LONGEST, progress=tell(name))
            part.setdefault(f"{n} x {n}", {})[method] = outcomes(found)
            report(name, part[f"{n} x {n}"][method])
            picture(found, method, f"guesses-{name}")
            record("sensitivity", results)


def outcomes(found) -> dict:
    """Of the guesses that were run: how many led to the truth, and what it took."""
    run = found["code"].values != NOT_RUN
    steps, seconds = found["steps"].values[run], found["seconds"].values[run]
    return {
        "guesses": int(run.size), "run": int(run.sum()), "recovered": int(recovered(found)[run].sum()),
        "failed": int(np.sum(found["code"].values[run] != 0)), "equilibria": int(steps.sum()),
        "median equilibria": float(np.median(steps)), "seconds": float(seconds.sum()), "median_s": float(np.median(seconds)),
    }  # fmt: skip


def picture(found, method, name) -> None:
    """Where each guess led."""
    figure, ax = plt.subplots(figsize=(6.2, 4.0), layout="constrained")
    run = found["code"].values != NOT_RUN
    ax.set_title(f"{method}: {recovered(found)[run].sum()} of {run.sum()} recovered", fontsize=10)
    plot.basins(found, ax)
    save(figure, name)


# clamps ------------------------------------------------------------------------------------------------------------------

NOISE = 3.0e-4  # m, white, of the curves in the study with a prior: no curve is exact, and the prior's weight is against it
PRIOR = TILT / 3.0  # rad about each axis: an angle even in +-3 degrees about an axis anywhere has this standard deviation


def from_the_truth(study):
    return replace(study, unknowns=tuple(replace(u, guess=TRUTH[u.name]) for u in study.unknowns))


def perturbed(study, lane):
    return from_the_truth(turned(study, lane["tilt"]))


def perturbed_and_noisy(study, lane):
    """Turned clamps, noisy curves whose noise the study states."""
    return perturbed(noisy(study, NOISE, int(lane["seed"])), lane)


def with_prior(study, lane):
    """The same, with the orientations of the clamps as unknowns under their prior."""
    return replace(perturbed_and_noisy(study, lane), tolerance=Tolerance(clamp_rotation=PRIOR))


def bias(found) -> dict:
    """Of the logarithms of both estimates against the truth: mean, its standard error, spread, and who is below."""
    code = found["code"].values[found["code"].values != NOT_RUN]
    solved, out = found["code"].values == 0, {"draws": int(code.size), "failed": int(np.sum(code != 0))}
    low = []
    for name, value in TRUTH.items():
        log = np.log(found[name].values[solved] / value)
        low.append(log < 0)
        error = float(np.std(log, ddof=1) / np.sqrt(len(log)))
        out[name] = {
            "mean": float(np.mean(log)), "standard error": error, "in standard errors": float(np.mean(log)) / error,
            "spread": float(np.std(log, ddof=1)), "median": float(np.median(log)), "underestimated": float(np.mean(low[-1])),
        }  # fmt: skip
        inside = (found[f"{name}_low"].values <= value) & (value <= found[f"{name}_high"].values)
        out[name]["95 % interval holds the truth"] = float(np.mean(inside[solved]))
    out["both underestimated"] = float(np.mean(low[0] & low[1]))
    out["either underestimated"] = float(np.mean(low[0] | low[1]))
    out["seconds"] = float(found["seconds"].sum())
    return out


CLAMPS = {  # what is fitted, how, the largest angle, from how many draws, and seconds at most
    "exact shapes": (perturbed, {}, TILT, 1000, 900.0),
    "noise, clamps with a prior": (with_prior, {}, TILT, 150, 300.0),
    "noise": (perturbed_and_noisy, {}, TILT, 150, 300.0),
    "exact shapes, a third of the angle": (perturbed, {}, TILT / 3, 60, 300.0),
    "exact shapes, the paper's distance": (perturbed, {"distance": "integrated"}, TILT, 60, 300.0),
}


def clamps(results) -> None:
    study, part, found = simulated(), results.setdefault("clamps", {}), {}
    for name, (change, options, largest, count, longest) in CLAMPS.items():
        lanes = draws(tilt=Axis(random_turns(1000, 3, largest)[:count], "rad"), seed=Axis(np.arange(float(count))))
        base = replace(study, tolerance=Tolerance(clamp_rotation=PRIOR)) if change is with_prior else study
        task = fits(base, change, **options)
        found[name] = sweep(task, lanes, store=store("clamps", name), chunk=10, longest=longest, progress=tell(name))
        part[name] = bias(found[name])
        report(name, part[name])
        record("sensitivity", results)
    scatter(found)
    record("sensitivity", results)


def scatter(found) -> None:
    """Both estimates of every draw with the truth marked (the paper's Fig. 5)."""
    panels = ("exact shapes", "noise, clamps with a prior")
    figure, axes = plt.subplots(1, 2, figsize=(9.0, 4.2), layout="constrained", sharex=True, sharey=True)
    for ax, name in zip(axes, panels, strict=True):
        x, y = (found[name][k].values for k in STIFF)
        ax.plot(x, y, ".", ms=3, color="#888888", alpha=0.6)
        ax.plot(EI, GJ, "s", color="#c1272d", ms=7, label="truth")
        ax.plot(np.exp(np.nanmean(np.log(x))), np.exp(np.nanmean(np.log(y))), "+", color="k", ms=12, label="mean")
        ax.axvline(EI, color="#c1272d", lw=0.6)
        ax.axhline(GJ, color="#c1272d", lw=0.6)
        ax.set(xlabel="estimate of EI (N m$^2$)", ylabel="estimate of GJ (N m$^2$)")
        ax.set_title(name, fontsize=10)
        ax.legend(frameon=False, fontsize=8)
    save(figure, "clamps")


# natural curvature -------------------------------------------------------------------------------------------------------

CURVED = 2.0  # 1/m about d1: a cable that came off a reel of half a metre
KINK = {"position": 0.4, "angle": np.array([0.5, 0.0, 0.0]), "width": 0.1}
STARTS = (-8.0, -2.0, 0.0, 4.0, 8.0)


def made(study, **cable):
    """The study with shapes of its own model on a fine mesh (160 elements) and every value known."""
    whole = replace(study, cable={**study.cable, **TRUTH, **cable}, unknowns=())
    problem = Problem(whole, 160)
    found = problem.evaluator(np.zeros(0))
    if not found.solved:
        raise SystemExit("the poses of the study on natural curvature could not be solved")
    nodes, s = np.linspace(0.0, problem.length, 161), np.linspace(0.02, 0.98, 80) * problem.length
    curves = [CubicHermiteSpline(nodes, r, R[:, :, 2])(s) for r, R in zip(*found.configuration, strict=True)]
    return replace(whole, poses=tuple(replace(p, curve=MeasuredCurve(c)) for p, c in zip(whole.poses, curves, strict=True)))


def unknown(study, *more):
    cable = {k: v for k, v in study.cable.items() if k not in (*STIFF, *(u.name for u in more))}
    both = tuple(Unknown(name, low=1e-3, high=1e3) for name in STIFF)
    return replace(study, cable=cable, unknowns=(*both, *more))


def about_one_axis(study, lane):
    """EI, GJ and natural curvature about d1 are unknown; the other two components are held at zero."""
    k = lane["start"]
    tight = np.array([20.0, 1e-9, 1e-9])
    return guessed(study, lane, Unknown("natural_curvature", np.array([k, 0.0, 0.0]), -tight, tight))


def about_all_axes(study, lane):
    return guessed(study, lane, Unknown("natural_curvature", np.array([lane["start"], 0.0, 0.0]), -20.0, 20.0))


def guessed(study, lane, more):
    *both, more = unknown(study, more).unknowns
    both = (replace(u, guess=lane[f"guess_{u.name}"]) for u in both)
    return replace(unknown(study, more), unknowns=(*both, more))


def kinked(study, lane):
    """A curvature that varies along the cable, as far as the format can declare it: a set bend of unknown angle."""
    start = {**KINK, "angle": np.array([lane["start"] / 8.0, 0.0, 0.0])}
    effect = EffectDeclaration("kink", start)
    study = replace(study, effects=(effect,))
    return guessed(study, lane, Unknown("kink.angle", start["angle"], -3.0, 3.0))


def curvature(results) -> None:
    part, plain = results.setdefault("natural curvature", {}), simulated()
    decades = Axis([0.01, 1.0], "N m^2")
    lanes = grid(start=Axis(STARTS, "1/m"), guess_bending_stiffness=decades, guess_torsional_stiffness=decades)
    curved = made(plain, natural_curvature=np.array([CURVED, 0.0, 0.0]))
    bent = replace(made(replace(plain, effects=(EffectDeclaration("kink", KINK),))), effects=())
    cases = {
        "about one axis": (curved, about_one_axis, "natural_curvature", np.array([CURVED, 0, 0])),
        "about all axes": (curved, about_all_axes, "natural_curvature", np.array([CURVED, 0, 0])),
        "a set bend": (bent, kinked, "kink.angle", KINK["angle"]),
    }
    for name, (study, change, parameter, truth) in cases.items():
        first = change(study, {k: v[0] for k, v in lanes.take(slice(None)).items()})
        found = sweep(fits(first, of(study, change)), lanes, store=store("curvature", name), progress=tell(name))
        part[name] = curved_outcomes(found, parameter, truth)
        report(name, part[name])
        record("sensitivity", results)


def curved_outcomes(found, parameter, truth) -> dict:
    """From how many starts the curvature came back to 1 %, and both stiffnesses with it."""
    near = np.all(np.abs(found[parameter].values - truth) < 0.01 * np.linalg.norm(truth), axis=-1)
    stiff = np.all([np.abs(found[k].values / v - 1) < 0.01 for k, v in TRUTH.items()], axis=0)
    return {
        "starts": int(near.size), "recovered": int((near & stiff).sum()), "curvature recovered": int(near.sum()),
        "failed": len(failed(found)), "seconds": float(found["seconds"].sum()),
        "recovered by start (1/m)": {f"{k:g}": int((near & stiff)[i].sum()) for i, k in enumerate(found["start"].values)},
    }  # fmt: skip


def of(study, change):
    """The change applied to ``study``, whatever study declares the outputs."""
    return lambda _, lane: change(study, lane)


# cantilever --------------------------------------------------------------------------------------------------------------

LENGTH, DENSITY, G = 1.0, 0.2, 9.81  # m, kg/m, m/s^2
TIP_ERROR = 1.0e-3  # m, standard deviation of the measured sinking of the tip
LEAST_POINTS = 33


def cantilever_tip(log_EI):
    """Sinking of the tip (m) of a horizontal cantilever, and its verdict."""
    model = CableModel(Cable(LENGTH, DENSITY, jnp.exp(log_EI), 0.25), jnp.array([0.0, 0.0, -G]))
    e = equilibrium(model, Boundary.of((np.zeros(3), np.array([0.5, 0.5, 0.5, 0.5]))))
    return -e.points[-1, 2], e.verdict


def cantilever_lane(lane):
    log_EI = jnp.log(lane["bending_stiffness"])
    slope, verdict = jax.jacfwd(cantilever_tip, has_aux=True)(log_EI)
    return {"tip": cantilever_tip(log_EI)[0], "slope": slope}, verdict


def cantilever(results) -> None:
    task = Traced(cantilever_lane, {"tip": Output("m"), "slope": Output("m")})
    values = np.logspace(-3, 1, LEAST_POINTS)
    found = sweep(task, grid(bending_stiffness=Axis(values, "N m^2")), store=STORES / "cantilever", progress=tell("cantilever"))
    tip, slope, w = found["tip"].values, found["slope"].values, DENSITY * G
    error = TIP_ERROR / np.abs(slope)
    formula = 8.0 * values * TIP_ERROR / (w * LENGTH**4)
    stiff = values / (w * LENGTH**3) > 1.0
    drawn = redrawn(values, tip)
    results["cantilever"] = {
        "EI (N m^2)": values.tolist(), "EI/(g rhoA) (m^3)": (values / w).tolist(), "tip (m)": tip.tolist(),
        "error of the tip (m)": TIP_ERROR, "relative error of EI": error.tolist(), "formula 8 EI du/(w L^4)": formula.tolist(),
        "of draws": drawn, "failed": len(failed(found)), "length (m)": LENGTH,
        "measured over formula, EI/(w L^3) above 1": [float(f((error / formula)[stiff])) for f in (np.min, np.max)],
        "power of EI/(g rhoA), stiff half": float(np.polyfit(np.log(values[stiff]), np.log(error[stiff]), 1)[0]),
    }  # fmt: skip
    report("cantilever", {k: v for k, v in results["cantilever"].items() if not isinstance(v, list) or len(v) < 3})
    figure, ax = plt.subplots(figsize=(5.6, 4.0), layout="constrained")
    ax.loglog(values / w, error, color="#c1272d", lw=1.5, label="measured: 1 mm over the slope of the tip")
    ax.loglog(values / w, formula, "--", color="k", lw=1.0, label=r"$8\,\Delta u\,EI/(g\rho A\,L^4)$")
    at, spread = zip(*(d.values() for d in drawn), strict=True)
    ax.loglog(at, spread, "o", ms=4, color="#2b5c9e", label="2,000 draws of the tip's error")
    ax.set(xlabel="EI/(g rhoA) (m$^3$), cable of 1 m", ylabel="relative error of EI (-)")
    ax.legend(frameon=False, fontsize=8)
    save(figure, "cantilever")
    record("sensitivity", results)


def redrawn(values, tip) -> list[dict]:
    """Relative spread of EI read off noisy tips by the measured curve, where every draw still has an EI on the curve."""
    order, out = np.argsort(tip), []
    inverse = PchipInterpolator(tip[order], np.log(values)[order], extrapolate=False)
    rng = np.random.default_rng(0)
    for k in range(2, len(values) - 2, 3):
        logs = inverse(tip[k] + TIP_ERROR * rng.standard_normal(2000))
        if np.all(np.isfinite(logs)):
            spread = float(np.std(np.exp(logs)) / values[k])
            out.append({"EI/(g rhoA) (m^3)": float(values[k] / (DENSITY * G)), "relative error of EI": spread})
    return out


# batches -----------------------------------------------------------------------------------------------------------------

LANES = 16  # each way: 256 lanes
WIDTHS = (1, 16, 256)
MIDDLE = {"middle": Quantity(lambda e: e.points[len(e.points) // 2], Output("m", ("axis",)))}


def batches(results) -> None:
    """A loop over lanes against `jax.vmap`, and lanes of like cost together against lanes as they come."""
    study = simulated()
    pose = study.pose("twist-90")
    problem = Problem(study)
    start, boundary, bare = one(problem.poses.start, study.poses.index(pose)), boundary_of(pose), template(study)
    layout = problem.layout

    def scene(lane):
        x = jnp.log(jnp.stack([lane[name] for name in STIFF]))
        return model_at(layout, bare, x), boundary, start

    axis = Axis(np.logspace(-2, 2, LANES), "N m^2")
    lanes, task = grid(**dict.fromkeys(STIFF, axis)), equilibria(scene, MIDDLE)
    cheap = equilibria(scene_of(pose), MIDDLE, elements=8)
    seconds, part = {}, results.setdefault("batches", {})
    for width in WIDTHS:
        t = timed(lambda width=width: sweep(task, lanes, at_once=width, chunk=256), 1)
        seconds[str(width)] = 1e3 * t["min_s"] / lanes.count
    steps = sweep(task, lanes)["steps"].values.ravel()
    guess = sweep(cheap, lanes)["steps"].values.ravel()
    part.update({"lanes": lanes.count, "ms per lane by lanes at once": seconds, "steps": [int(steps.min()), int(steps.max())]})
    part["steps of batches of 16 over steps of the lanes"] = {
        "as they come": waste(steps, np.arange(len(steps))),
        "by the steps of a mesh of 8": waste(steps, np.argsort(-guess, kind="stable")),
        "by their own steps (the limit)": waste(steps, np.argsort(-steps, kind="stable")),
        "at random": waste(steps, np.random.default_rng(0).permutation(len(steps))),
    }
    report("batches", part)
    record("sensitivity", results)


def scene_of(pose):
    """The pose on a coarse mesh from a generic start."""
    boundary = boundary_of(pose)
    gravity = jnp.array([0.0, 0.0, -G])
    return lambda lane: (CableModel(Cable(LENGTH, DENSITY, *(lane[name] for name in STIFF)), gravity), boundary)


def waste(steps, order, width=16) -> float:
    """What batches of ``width`` run, over what their lanes need."""
    groups = steps[order].reshape(-1, width)
    return float(width * groups.max(axis=1).sum() / steps.sum())


# -------------------------------------------------------------------------------------------------------------------------


def report(name, figures) -> None:
    sys.stderr.write(f"\n{name}: {json.dumps(figures)}\n")


def save(figure, name) -> None:
    plot.save(figure, PICTURES / f"{name}.png", dpi=80)
    plt.close(figure)


PARTS = {"guesses": guesses, "clamps": clamps, "curvature": curvature, "cantilever": cantilever, "batches": batches}


def main() -> None:
    jax.config.update("jax_enable_x64", True)
    mpl.use("Agg")
    path = RESULTS / "sensitivity.json"
    results = json.loads(path.read_text())["results"] if path.exists() else {}
    for name in sys.argv[1:] or PARTS:
        PARTS[name](results)


if __name__ == "__main__":
    main()
