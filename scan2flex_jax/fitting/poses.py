"""The measured poses as arrays of one shape, so that all of them are solved and differentiated in one batch.

Curves are padded to one number of points, so that all studies share one compilation; ``mask`` is 1 for real points. Longer
curves are thinned evenly along their arc length first.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import numpy as np
from jax import Array
from jaxtyping import Float, Int

from scan2flex_jax.compilation import compiled
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting.parameters import template
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.model import CableModel, Configuration
from scan2flex_jax.statics.starts import complete_curve, curve_start
from scan2flex_jax.study.model import Study, StudyPose

MOST_POINTS = 256  # of a curve that enter a fit: more say nothing new about a smooth curve whose noise is correlated


class Poses(eqx.Module):
    """P poses: measured points (m), their expected arc length (m), supports, and where solves start.

    ``templates`` are the models of the poses, before a fit puts its numbers in, and ``group`` says which of them each pose has:
    poses that differ in gravity or in the effects that act in them have others.
    """

    points: Float[Array | np.ndarray, "P m 3"]
    mask: Float[Array | np.ndarray, "P m"]
    expected: Float[Array | np.ndarray, "P m"]
    boundary: Boundary
    turns: Int[Array | np.ndarray, " P"]
    start: Configuration
    templates: tuple[CableModel, ...]
    group: tuple[int, ...] = eqx.field(static=True)

    def template(self, i: int) -> CableModel:
        """The model of pose ``i``."""
        return self.templates[self.group[i]]

    @property
    def count(self) -> int:
        """Number of poses."""
        return len(self.turns)


def boundary_of(pose: StudyPose) -> Boundary:
    """The supports of a study's pose, as `equilibrium` takes them."""
    start = (pose.start.position, pose.start.quaternion)
    return Boundary.of(start, None if pose.end is None else (pose.end.position, pose.end.quaternion))


def poses_of(study: Study, study_poses: Sequence[StudyPose], length: float, elements: int) -> Poses:
    """Arrays of poses in a study, all of which must have a centre curve; the start of each is its measured curve."""
    thinned = [_thinned(*_measured(pose)) for pose in study_poses]
    stack = [_one(pose, points, given, length) for pose, (points, given) in zip(study_poses, thinned, strict=True)]
    points, mask, expected, dense, boundary, turns = jax.tree.map(lambda *x: np.stack(x), *stack)
    each = [_start(*one, elements) for one in zip(dense, _unstack(boundary), turns, strict=True)]
    start = jax.tree.map(lambda *x: np.stack([np.asarray(a) for a in x]), *each)
    return Poses(points, mask, expected, boundary, turns, start, *_templates(study, study_poses))


def _templates(study, study_poses):
    """The models of poses, each once, and which of them each pose has."""
    models: dict[tuple, CableModel] = {}
    keys = [(study.gravity_in(p).tobytes(), *(e in study.acting(p) for e in study.effects)) for p in study_poses]
    for key, pose in zip(keys, study_poses, strict=True):
        if key not in models:
            models[key] = template(study, pose)
    return tuple(models.values()), tuple(list(models).index(key) for key in keys)


@compiled
def _start(dense, boundary, turns, elements):
    return curve_start(dense, boundary, turns, elements)


def _unstack(tree):
    return [jax.tree.map(lambda x, i=i: x[i], tree) for i in range(len(jax.tree.leaves(tree)[0]))]


def _one(pose, points, given, length):
    boundary = boundary_of(pose)
    full = complete_curve(points, boundary, length)
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(full, axis=0), axis=1))])
    expected = s[1:-1] * length / s[-1] if given is None else np.asarray(given)
    pad = MOST_POINTS - len(points)
    return (
        np.concatenate([points, np.repeat(points[-1:], pad, axis=0)]),
        np.concatenate([np.ones(len(points)), np.zeros(pad)]),
        np.concatenate([expected, np.repeat(expected[-1:], pad)]),
        _dense(full),
        boundary,
        np.array(int(pose.turns)),
    )


def _measured(pose):
    """Points (n, 3) of a pose and their arc lengths (n,), None where they were not measured."""
    if pose.curve is None:
        raise Scan2FlexError(f"pose {pose.name!r} has no centre curve: run `scan2flex extract` on the study first")
    return np.asarray(pose.curve.points), pose.curve.arc_length


def _thinned(points, given):
    """At most `MOST_POINTS` points, evenly by index order along the curve, first and last kept."""
    if len(points) <= MOST_POINTS:
        return points, given
    keep = np.unique(np.round(np.linspace(0, len(points) - 1, MOST_POINTS)).astype(int))
    return points[keep], None if given is None else np.asarray(given)[keep]


def _dense(points, count=513):
    """The polygon at ``count`` equally spaced points, so that every curve starts a solve through one compiled shape."""
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.linspace(0.0, s[-1], count)
    smooth = np.stack([np.interp(at, s, points[:, k]) for k in range(3)], axis=1)
    width = max(1, count // 40)
    kernel = np.ones(width) / width
    inner = np.stack([np.convolve(smooth[:, k], kernel, mode="valid") for k in range(3)], axis=1)
    half = (width - 1) // 2
    smooth[half : half + len(inner)] = inner
    return smooth
