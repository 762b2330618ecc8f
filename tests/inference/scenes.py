"""Studies whose shapes come from the continuous equations (`reference.cosserat_bvp`), with one thing in them undeclared, and
thinned cases of the independent simulator."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
from reference import clamped_cases, cosserat_bvp, rotations

from scan2flex_jax.inference.fitting import fitted
from scan2flex_jax.posterior.posterior import Variant
from scan2flex_jax.posterior.program import slots_of
from scan2flex_jax.study import MeasuredCurve, Tolerance, Unknown, load_study
from scan2flex_jax.study.model import Clamp, Study, StudyPose

CASES = Path(__file__).parents[1] / "data" / "blind" / "cases"
NOISE, POINTS = 2.0e-4, 60  # m
START = clamped_cases.START_FRAME
X = np.array([1.0, 0.0, 0.0])
Z = np.array([0.0, 0.0, 1.0])
LEVEL = np.array([0.6, 0.0, 0.0])
# end position (m), axis and angle (rad) by which the end clamp is turned; twists far from those at which a branch ends
ENDS = {
    "level": (LEVEL, X, 0.0), "twist+": (np.array([0.65, 0.15, 0]), X, np.pi / 4),
    "twist-": (np.array([0.65, 0.15, 0]), X, -np.pi / 4), "aside": (np.array([0.6, 0.2, 0.1]), Z, 0.6),
}  # fmt: skip
PLANE = {
    "near": (np.array([0.45, 0, 0]), X, 0.0), "level": (LEVEL, X, 0.0), "up": (np.array([0.6, 0, 0.15]), X, 0.0),
    "far": (np.array([0.75, 0, 0]), X, 0.0),
}  # fmt: skip


def frame(axis, angle):
    return rotations.about(axis, angle) @ START


@cache
def shape(name, plane=False, natural_curvature=(0.0, 0.0, 0.0), compliance=0.0):
    """Positions (m) of a pose, continued from the level one; ``compliance`` (rad/(N m)) of the grip at the start, whose turn
    is found by fixed-point iteration."""
    end, axis, angle = (PLANE if plane else ENDS)[name]
    start, found = START, None
    for _ in range(5 if compliance else 1):
        rods = [
            cosserat_bvp.Clamped(1.0, clamped_cases.POSE_K, clamped_cases.POSE_WEIGHT, LEVEL + x * (end - LEVEL),
                                 frame(axis, x * angle), start, x * np.array(natural_curvature),
                                 clamped_cases.POSE_COMPLIANCE) for x in np.linspace(0.0, 1.0, 5)
        ]  # fmt: skip
        found = cosserat_bvp.solve(rods, cosserat_bvp.sag_curve(rods[0]))
        start = rotations.exp(compliance * found.moments([0.0])[0]) @ START
    return found.positions(np.linspace(0.02, 0.98, POINTS))


def study(plane=False, gravity=(0.0, 0.0, -9.81), tolerance=None, seed=0, **hidden):
    """What the experimenter declares: EI and GJ unknown, clamps, length and density as they are said to be."""
    rng = np.random.default_rng(seed)
    poses = []
    for name, (end, axis, angle) in (PLANE if plane else ENDS).items():
        points = shape(name, plane, **hidden)
        noisy = points + NOISE * rng.standard_normal(points.shape)
        held = Clamp(np.zeros(3), rotations.quaternion(START)), Clamp(end, rotations.quaternion(frame(axis, angle)))
        poses.append(StudyPose(name, "fit", *held, curve=MeasuredCurve(noisy)))
    return Study(
        title="exact classes", gravity=np.array(gravity), cable={"length": 1.0, "length_density": 0.2},
        unknowns=(Unknown("bending_stiffness"), Unknown("torsional_stiffness")), poses=tuple(poses),
        tolerance=tolerance or Tolerance(),
    )  # fmt: skip


def variant_of(study, elements=20, **given):
    """A study with its hypothesis without effects."""
    found = fitted(study, slots=slots_of(study), elements=elements)
    variant = Variant("as stated", found.problem, found.minimum, **given)
    variant.fit = found
    return variant


def case(name, poses=4, unseen=()):
    """A case of the independent simulator with its first fitted poses, and of the others those ``unseen``; thinned so that all
    share what is compiled."""
    full = load_study(CASES / name)
    kept = (*full.fit_poses[:poses], *map(full.pose, unseen))
    return replace(full, poses=tuple(replace(p, curve=thinned(p.curve)) for p in kept))


def thinned(curve):
    """About 64 points of a curve."""
    step = -(-len(curve.points) // 64)
    s = curve.arc_length
    return MeasuredCurve(curve.points[::step], None if s is None else s[::step])
