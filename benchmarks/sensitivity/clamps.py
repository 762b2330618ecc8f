"""Clamps that are turned at random while the study says they are not: what becomes of EI and GJ (the paper's Fig. 5).

Every draw turns the six clamps of the three poses about axes that point anywhere, by angles even in +-3 degrees. The paper sees
both stiffnesses underestimated in every draw. The errors here are mostly linear in the turns, and as many turns point one way
as the other: `origin` says how much of the spread a linear map of the 36 components explains, and a third of the angle shows
the rest, which is of second order. An error of one sign in every draw comes where a symmetry leaves no linear part: turns out
of the plane of a plane pose have mirror images that give the same EI. Then the orientations are unknowns with a prior, as the
paper proposes.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

from benchmarks import paper
from benchmarks.sensitivity.bench import run as was_run
from benchmarks.sensitivity.bench import save
from scan2flex_jax.study import Tolerance
from scan2flex_jax.sweep import Axis, draws, fits, noisy, random_turns, turned

TILT = np.deg2rad(3.0)  # the paper's largest turn of a clamp
NOISE = 3.0e-4  # m, white, of the curves in the study with a prior: no curve is exact, and the prior is weighed against it
PRIOR = TILT / 3.0  # rad about each axis: an angle even in +-3 degrees about an axis anywhere has this standard deviation
DRAWS = 1000


def perturbed(study, lane):
    """Clamps that the study does not know to be turned; the fit begins from the truth, as the paper's does."""
    return paper.guessed(turned(study, lane["tilt"]), paper.TRUTH.values())


def perturbed_and_noisy(study, lane):
    """The same with noisy curves, whose noise the study states."""
    return perturbed(noisy(study, NOISE, int(lane["seed"])), lane)


def with_prior(study, lane):
    """The same with the orientations of the clamps as unknowns under their prior."""
    return replace(perturbed_and_noisy(study, lane), tolerance=Tolerance(clamp_rotation=PRIOR))


def mirrored(study, lane):
    """Turns out of the plane of the plane pose only: none about d2 of its clamps, the axis of its bending."""
    return perturbed(study, {"tilt": lane["tilt"] * np.array([1.0, 0.0, 1.0])})


def plane():
    """The plane pose alone, which says nothing of GJ: it is known."""
    study = paper.simulated()
    unknowns = tuple(u for u in study.unknowns if u.name == "bending_stiffness")
    cable = {**study.cable, "torsional_stiffness": paper.GJ}
    return replace(study, cable=cable, unknowns=unknowns, poses=(study.pose("plane"),))


def tolerant():
    return replace(paper.simulated(), tolerance=Tolerance(clamp_rotation=PRIOR))


CASES = {  # the study, what a lane makes of it, options of the fit, the largest angle, how many draws
    "exact shapes": (paper.simulated, perturbed, {}, TILT, DRAWS),
    "noise, clamps with a prior": (tolerant, with_prior, {}, TILT, DRAWS),
    "exact shapes, a third of the angle": (paper.simulated, perturbed, {}, TILT / 3, 250),
    "noise": (paper.simulated, perturbed_and_noisy, {}, TILT, 250),
    "exact shapes, the paper's distance": (paper.simulated, perturbed, {"distance": "integrated"}, TILT, 100),
    "plane pose alone, turned out of its plane": (plane, mirrored, {}, TILT, 100),
}


def run(bench, wanted) -> None:
    found = {}
    for name, (make, change, options, largest, count) in CASES.items():
        if wanted(name):
            study = make()
            turns = random_turns(DRAWS, len(study.poses), largest)[:count]
            lanes = draws(tilt=Axis(turns, "rad"), seed=Axis(np.arange(float(count))))
            task = fits(study, change, **options)
            found[name] = bench.sweep(f"clamps {name.replace(chr(39), '')}", task, lanes, chunk=10)
            bench.keep("clamps", name, errors(found[name]))
    if set(PANELS) <= found.keys():
        picture(found)


def errors(found) -> dict:
    """Of the logarithms of the estimates against the truth: mean, its standard error, spread, who is below, and where from."""
    done = was_run(found)
    solved, low = found["code"].values == 0, []
    out = {"draws": int(done.sum()), "failed": int(np.sum(done & ~solved))}
    for name, value in ((n, v) for n, v in paper.TRUTH.items() if n in found):
        log = np.log(found[name].values[solved] / value)
        low.append(log < 0)
        error = float(np.std(log, ddof=1) / np.sqrt(len(log)))
        inside = (found[f"{name}_low"].values <= value) & (value <= found[f"{name}_high"].values)
        out[name] = {
            "mean": float(np.mean(log)), "standard error": error, "in standard errors": float(np.mean(log)) / error,
            "spread": float(np.std(log, ddof=1)), "median": float(np.median(log)), "underestimated": float(np.mean(low[-1])),
            "95 % interval holds the truth": float(np.mean(inside[solved])),
        } | origin(found["tilt"].values[solved], log)  # fmt: skip
    if len(low) == 2:
        out["both underestimated"] = float(np.mean(low[0] & low[1]))
        out["either underestimated"] = float(np.mean(low[0] | low[1]))
    out["seconds"] = float(found["seconds"].values[done].sum())
    return out


def origin(turns, log) -> dict:
    """Share of the variance that is linear in the turns, of draws that the map has not seen; from five draws a component on."""
    X = turns.reshape(len(turns), -1)
    if len(X) < 5 * X.shape[1]:
        return {}
    X, left = np.column_stack([np.ones(len(X)), X]), np.empty_like(log)
    for fold in range(5):
        held = np.arange(len(log)) % 5 == fold
        left[held] = log[held] - X[held] @ np.linalg.lstsq(X[~held], log[~held], rcond=None)[0]
    return {"linear in the turns": float(1.0 - np.var(left) / np.var(log))}


PANELS = ("exact shapes", "noise, clamps with a prior")


def picture(found) -> None:
    """Both estimates of every draw with the truth marked."""
    figure, axes = plt.subplots(1, 2, figsize=(9.0, 4.2), layout="constrained", sharex=True, sharey=True)
    for ax, name in zip(axes, PANELS, strict=True):
        x, y = (found[name][k].values for k in paper.STIFF)
        ax.plot(x, y, ".", ms=3, color="#888888", alpha=0.6)
        ax.plot(paper.EI, paper.GJ, "s", color="#c1272d", ms=7, label="truth")
        ax.plot(np.exp(np.nanmean(np.log(x))), np.exp(np.nanmean(np.log(y))), "+", color="k", ms=12, label="mean")
        ax.axvline(paper.EI, color="#c1272d", lw=0.6)
        ax.axhline(paper.GJ, color="#c1272d", lw=0.6)
        ax.set(xlabel="estimate of EI (N m$^2$)", ylabel="estimate of GJ (N m$^2$)")
        ax.set_title(f"{name} ({np.isfinite(x).sum()} draws)", fontsize=10)
        ax.legend(frameon=False, fontsize=8)
    save(figure, "clamps")
