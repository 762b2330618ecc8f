"""A study of one pose that is made in memory as in a notebook: an arc of a circle between clamps that point along it."""

import numpy as np
from scipy.spatial.transform import Rotation

from scan2flex_jax import Study
from tests.study.samples import curve

BOTH = ["bending_stiffness", "torsional_stiffness"]
LEVEL = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])
CABLE = {"length": 0.9, "length_density": 0.3}
POINTS = curve()
HALF = next(h for h in np.linspace(1e-3, np.pi, 20000) if np.sin(h) / h < 0.5 / 0.9)  # of the angle that `curve` turns by


def about_y(angle):
    return Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix() @ LEVEL


def pose(**changes):
    """The pose of `curve` with its clamps along it."""
    ends = {"start": ([0, 0, 0], about_y(HALF)), "end": ([0.5, 0, 0], about_y(-HALF))}
    return {"points": POINTS, **ends, **changes}


def made(cable=CABLE, unknowns=BOTH, poses=None, **others):
    return Study.from_arrays(cable, [pose()] if poses is None else poses, unknowns, **others)
