"""Changes of a study per sample: other guesses, rotated clamps, curves with noise."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study import MeasuredCurve, Study

_ENDS = ("start", "end")


def guesses(study: Study, sample: dict) -> Study:
    """The study with the sample's ``guess_NAME`` as the guess of each unknown NAME."""
    given = {name.removeprefix("guess_"): x for name, x in sample.items() if name.startswith("guess_")}
    strangers = [name for name in sample if name.removeprefix("guess_") not in set(study.unknown_names) & given.keys()]
    if strangers:
        known = ", ".join(study.unknown_names)
        raise Scan2FlexError(f"{strangers[0]!r} is no guess for an unknown of the study: they are {known}")
    return replace(study, unknowns=tuple(replace(u, guess=given.get(u.name, u.guess)) for u in study.unknowns))


def turned(study: Study, turns: ArrayLike) -> Study:
    """The study with its clamps rotated by rotation vectors ``turns`` (poses, 2, 3), rad, in the clamps' own frames.

    A ball joint or a free end has no orientation and is unchanged.
    """
    turns = np.array(turns, float)  # a copy: scipy refuses read-only arrays
    if turns.shape != (len(study.poses), 2, 3):
        wanted = (len(study.poses), 2, 3)
        raise Scan2FlexError(f"turns have shape {turns.shape}: give {wanted}, a vector for each end of each pose")
    return replace(study, poses=tuple(_turned(pose, *turn) for pose, turn in zip(study.poses, turns, strict=True)))


def _turned(pose, *turns):
    ends = {}
    for end, vector in zip(_ENDS, turns, strict=True):
        clamp = getattr(pose, end)
        if clamp is not None and clamp.quaternion is not None:
            R = Rotation.from_quat(clamp.quaternion, scalar_first=True) * Rotation.from_rotvec(vector)
            ends[end] = replace(clamp, quaternion=R.as_quat(scalar_first=True))
    return replace(pose, **ends)


def random_turns(count: int, poses: int, largest: float, seed: int = 0) -> np.ndarray:
    """Rotation vectors (count, poses, 2, 3), rad: angles uniform in +-``largest`` about isotropic axes.

    The standard deviation about any one axis is ``largest / 3``.
    """
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=(count, poses, 2, 3))
    return rng.uniform(-largest, largest, (count, poses, 2, 1)) * axis / np.linalg.norm(axis, axis=-1, keepdims=True)


def noisy(study: Study, noise: float, seed: int) -> Study:
    """The study with white noise of ``noise`` (m) on every coordinate of its curves, also stated as each pose's noise."""
    rng, poses = np.random.default_rng(seed), []
    for pose in study.poses:
        if not pose.measured and not study.only_compared(pose):
            raise Scan2FlexError(f"pose {pose.name!r} has no centre curve and no markers: only these are given noise")
        curve, markers = pose.curve, pose.markers
        if curve is not None:
            curve = MeasuredCurve(curve.points + noise * rng.standard_normal(curve.points.shape), curve.arc_length)
        if markers is not None:
            markers = replace(markers, points=markers.points + noise * rng.standard_normal(markers.points.shape))
        poses.append(replace(pose, curve=curve, markers=markers, noise=noise))
    return replace(study, poses=tuple(poses))
