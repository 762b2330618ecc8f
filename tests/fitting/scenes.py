"""Studies for the tests of the fit: the paper's simulated cable, and shapes made from known values of any unknown.

All made studies have 20 elements and curves of 60 points, so that those with the same unknowns share one compilation.
"""

from dataclasses import replace
from functools import cache

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from scan2flex_jax.examples import example_path
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.study import MeasuredCurve, Tolerance, Unknown, load_study

ELEMENTS = 20
POINTS = 60
EI, GJ = 0.1, 0.25  # N m^2, the paper's Section 6.2
TRUE = {"bending_stiffness": EI, "torsional_stiffness": GJ}
NAMES = ("plane", "twist-90", "aside-45", "unseen")  # of the poses; the last is kept for validation
EXACT = Tolerance()
BOTH = (Unknown("bending_stiffness"), Unknown("torsional_stiffness"))
# where the made curves are measured: uneven, and 2 % of the length short of both clamps
STATIONS = 0.02 + 0.96 * np.linspace(0.0, 1.0, POINTS) ** 1.2


@cache
def example(name="simulated-cable"):
    return load_study(example_path(name))


def guessed(study, **guesses):
    """The study with these guesses."""
    return replace(study, unknowns=tuple(replace(u, guess=guesses.get(u.name, u.guess)) for u in study.unknowns))


def thinned(pose):
    """The pose with a curve of `POINTS` points, which serves to pin the branch."""
    points = pose.curve.points
    at = np.linspace(0, len(points) - 1, POINTS)
    points = np.stack([np.interp(at, np.arange(len(points)), x) for x in points.T], axis=1)
    return replace(pose, curve=MeasuredCurve(points))


@cache
def _poses(names):
    return tuple(thinned(p) for p in example().poses if p.name in names)


def study_of(unknowns=BOTH, poses=("plane", "twist-90", "aside-45"), effects=(), tolerance=EXACT, **cable):
    """The simulated cable with these unknowns; stiffnesses are known where they are not among them."""
    cable = {**TRUE, **example().cable, **cable}
    names = [u.name for u in unknowns]
    cable = {k: v for k, v in cable.items() if k not in names}
    study = replace(example(), cable=cable, unknowns=tuple(unknowns), poses=_poses(tuple(poses)))
    return replace(study, effects=tuple(effects), tolerance=tolerance)


def to_fit(study):
    """The study with all of its poses to fit."""
    return replace(study, poses=tuple(replace(p, role="fit") for p in study.poses))


def held_out(study):
    """The study with its last pose for validation."""
    return replace(study, poses=(*study.poses[:-1], replace(study.poses[-1], role="validate")))


def vector(layout, truth):
    """The numbers of the fit for values of the unknowns."""
    parts = [s.numbers(np.broadcast_to(truth[s.name], s.shape)) for s in layout.slots]
    return np.concatenate([*parts, np.zeros(layout.shared - layout.unknowns)])


def exact_curves(study, truth, local=None, elements=ELEMENTS):
    """Curves (m) of the model with known values, one per pose; ``local`` moves the clamps, in their tolerances."""
    problem = Problem(study, elements)
    found = problem.evaluator(vector(problem.layout, truth), local)
    assert found.solved
    nodes = np.linspace(0.0, problem.length, elements + 1)
    curves = zip(found.configuration.r, found.configuration.R, strict=True)
    return [CubicHermiteSpline(nodes, r, R[:, :, 2])(STATIONS * problem.length) for r, R in curves]


def measured(study, curves, noise=0.0, seed=0, stated=None):
    """The study with these curves and white noise (m) on every coordinate."""
    rng = np.random.default_rng(seed)
    noisy = [MeasuredCurve(c + noise * rng.standard_normal(c.shape)) for c in curves]
    return replace(study, poses=tuple(replace(p, curve=c, noise=stated) for p, c in zip(study.poses, noisy, strict=True)))


def summary_of(found):
    """The summary of a fit without the score of what may be missing, which compiles the catalogue: beside a reservation none
    is taken."""
    return replace(found, reservation="as said by a test").summary()
