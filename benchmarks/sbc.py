"""Simulation-based calibration (Talts et al. 2018, arXiv 1804.06788) of `fit`: EI, GJ and a natural curvature.

    python -m benchmarks.sbc [--draws 300]

Parameters are drawn from the priors that the study declares, sizes and correlation length of the noise from those of the model
(`Settings`); shapes are simulated by the package's own rod, and fitted. The rank of the true value in its posterior, a normal
one in the logarithm of a stiffness, is uniform if the posterior is right. A draw whose interval is withheld is counted apart.
"""

import argparse
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy import stats
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from benchmarks.record import record
from scan2flex_jax.cli.setup import prepare_jax
from scan2flex_jax.inference import fit
from scan2flex_jax.posterior.likelihood import _ODDS, _ROUGH, _correlation
from scan2flex_jax.posterior.settings import USUAL
from scan2flex_jax.prediction import predict
from scan2flex_jax.study import Clamp, EffectDeclaration, MeasuredCurve, Study, StudyPose, Unknown

PICTURE = Path(__file__).parents[1] / "docs" / "sbc.png"
PRIORS = {"bending_stiffness": (0.1, 0.02), "torsional_stiffness": (0.15, 0.03)}  # N m^2
CURVATURE = 0.5  # 1/m, standard deviation about each axis
NOISE, POINTS, ELEMENTS, BINS = 1e-3, 40, 40, 15
STATIONS = np.linspace(0.02, 0.98, POINTS)  # of the length of 1 m
START = Rotation.from_euler("y", 90, degrees=True)  # d3 along x
ENDS = ((0.6, 0.0, 0.0, START), (0.6, 0.2, 0.0, Rotation.from_euler("x", 90, degrees=True) * START),
        (0.5, 0.3, 0.1, Rotation.from_euler("z", 45, degrees=True) * START))  # fmt: skip


def clamp(x, y, z, turn):
    return Clamp(np.array([x, y, z]), turn.as_quat(scalar_first=True))


def study(values):
    """The study that is fitted, with these values for the simulation."""
    poses = [StudyPose(f"p{k}", "fit", clamp(0, 0, 0, START), clamp(*end), noise=NOISE) for k, end in enumerate(ENDS)]
    cable = {"length": 1.0, "length_density": 0.2} | {name: values[name] for name in PRIORS}
    bend = EffectDeclaration("natural_curvature", {"curvature": values["natural_curvature.curvature"]})
    unknowns = [Unknown(name, prior={"mean": m, "std": s}) for name, (m, s) in PRIORS.items()]
    unknowns.append(Unknown("natural_curvature.curvature", prior={"mean": 0.0, "std": CURVATURE}))
    return Study.from_arrays(cable, poses, unknowns, effects=[bend], title="calibration")


def noise_of(rng, white_alone):
    """Noise (P, n, 3) in m of one draw: white and correlated, their ratio and the correlation length as the model expects."""
    if white_alone:
        return NOISE * rng.normal(size=(len(ENDS), POINTS, 3))
    total, odds = NOISE * np.exp(USUAL.stated * rng.normal()), np.exp(2 * rng.normal() / np.sqrt(_ODDS))
    white, correlated = total * np.sqrt(np.array([odds, 1.0]) / (1.0 + odds))
    length = USUAL.correlation * np.exp(USUAL.correlation_spread * rng.normal())
    lag = np.abs(STATIONS[:, None] - STATIONS) / length
    K = np.asarray(_correlation(lag, np.sqrt(_ROUGH) * rng.normal())[0])
    root = np.linalg.cholesky(K + 1e-9 * np.eye(POINTS))
    shape = (len(ENDS), POINTS, 3)
    return white * rng.normal(size=shape) + correlated * np.einsum("ij,pjk->pik", root, rng.normal(size=shape))


def one_draw(rng, white_alone=False):
    """The normal scores of the true values in their posteriors, by name; None for one that is withheld."""
    values = {name: stats.truncnorm.rvs(-3, 3, m, s, random_state=rng) for name, (m, s) in PRIORS.items()}
    values["natural_curvature.curvature"] = rng.normal(0.0, CURVATURE, 3)
    made = study(values)
    poses = []
    shapes = predict(made, elements=ELEMENTS).values()
    for pose, shape, noise in zip(made.poses, shapes, noise_of(rng, white_alone), strict=True):
        points = CubicSpline(shape.s, shape.points)(STATIONS)
        poses.append(replace(pose, curve=MeasuredCurve(points + noise)))
    found = fit(replace(made, poses=tuple(poses)), elements=ELEMENTS)
    scores = {}
    for name, e in found.estimates.items():
        truth, known = np.atleast_1d(values[name]), e.low is not None
        if name in PRIORS:
            scores[name] = float(np.log(truth[0] / e.value) / (np.log(e.high / e.low) / 3.92)) if known else None
        else:
            for k, axis in enumerate(("d1", "d2", "d3")):
                scores[f"{name} about {axis}"] = float((truth[k] - e.value[k]) / e.std[k]) if known else None
    return scores


def figures(scores):
    """Ranks, their test, and coverage."""
    z = np.array([s for s in scores if s is not None and np.isfinite(s)])
    ranks = stats.norm.cdf(z)
    counts = np.histogram(ranks, BINS, (0.0, 1.0))[0]
    covered = {str(c): float(np.mean(np.abs(z) < stats.norm.ppf(0.5 + c / 200))) for c in (50, 80, 95)}
    rest = {"withheld": len(scores) - len(z), "counts": counts.tolist(), "covered": covered}
    return {"draws": len(z), "p_value": float(stats.chisquare(counts).pvalue), "spread": float(z.std()), **rest}


def picture(rows):
    """The histograms of ranks, with the band of 95 % of a uniform one."""
    figure, axes = plt.subplots(1, len(rows), figsize=(2.6 * len(rows), 2.4), layout="constrained", sharey=True)
    for ax, row in zip(axes, rows, strict=True):
        low, high = stats.binom.ppf([0.025, 0.975], row["draws"], 1 / BINS)
        ax.axhspan(low, high, color="0.88")
        ax.bar((np.arange(BINS) + 0.5) / BINS, row["counts"], 0.9 / BINS)
        ax.set_title(f"{row['parameter'].replace('natural_curvature.', '')}\np = {row['p_value']:.2f}", fontsize=9)
        ax.set_xlabel("rank of the truth", fontsize=9)
    axes[0].set_ylabel("draws", fontsize=9)
    figure.savefig(PICTURE, dpi=110)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=300)
    given = parser.parse_args()
    prepare_jax()
    rows = []
    for white_alone, draws in ((False, given.draws), (True, given.draws // 4)):
        scores = []
        for k in range(draws):
            scores.append(one_draw(np.random.default_rng([1804, k]), white_alone))
            if k % 20 == 19:
                print(k + 1, flush=True)
        for name in scores[0]:
            rows.append({"white_alone": white_alone, "parameter": name, **figures([s[name] for s in scores])})
    picture([row for row in rows if not row["white_alone"]])
    record("sbc", {"draws": given.draws, "bins": BINS, "rows": rows})


if __name__ == "__main__":
    main()
