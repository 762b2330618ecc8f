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
from scipy.interpolate import CubicSpline

from scan2flex_jax.compilation import compiled
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting.parameters import template
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.model import CableModel, Configuration
from scan2flex_jax.statics.starts import complete_curve, curve_start, sagging_start
from scan2flex_jax.study.model import Study, StudyPose

_DENSE = 513  # points of a curve along which a solve starts
_MOST_MARKERS = 128  # of a pose that enter a fit
_MARKED_SHAPE = 2  # markers from which on a solve starts along them
MOST_POINTS = 256  # of a curve that enter a fit: more say nothing new about a smooth curve whose noise is correlated


class Poses(eqx.Module):
    """P poses: measured points (m), their expected arc length (m), supports, and where solves start.

    ``templates`` are the models of the poses, before a fit puts its numbers in, and ``group`` says which of them each pose has:
    poses that differ in gravity or in the effects that act in them have others. ``marked`` is 1 for points whose arc length is
    known (`expected`); None in a study without markers.
    """

    points: Float[Array | np.ndarray, "P m 3"]
    mask: Float[Array | np.ndarray, "P m"]
    expected: Float[Array | np.ndarray, "P m"]
    boundary: Boundary
    turns: Int[Array | np.ndarray, " P"]
    start: Configuration
    templates: tuple[CableModel, ...]
    group: tuple[int, ...] = eqx.field(static=True)
    marked: Float[Array | np.ndarray, "P m"] | None = None

    def template(self, i: int) -> CableModel:
        """The model of pose ``i``."""
        return self.templates[self.group[i]]

    @property
    def count(self) -> int:
        """Number of poses."""
        return len(self.turns)


def boundary_of(pose: StudyPose) -> Boundary:
    """The supports of a study's pose, as `equilibrium` takes them.

    Args:
        pose: Its clamps; one without a quaternion is a ball joint, a missing end is free.

    Returns:
        Both supports, with positions (2, 3) in m, rotations (2, 3, 3), and the motions held (2, 6).

    Examples:
        >>> boundary_of(StudyPose("sag", "fit", Clamp([0, 0, 0]))).held.tolist()[0]
        [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]
    """
    start = (pose.start.position, pose.start.quaternion)
    return Boundary.of(start, None if pose.end is None else (pose.end.position, pose.end.quaternion))


def poses_of(study: Study, study_poses: Sequence[StudyPose], length: float, elements: int) -> Poses:
    """Arrays of poses in a study, all of which must have a centre curve or markers; these are where a solve starts."""
    stack = [_one(pose, length) for pose in study_poses]
    points, mask, expected, marked, _, boundary, turns = jax.tree.map(lambda *x: np.stack(x), *stack)
    each = [_start_of(study, pose, one[4:], length, elements) for pose, one in zip(study_poses, stack, strict=True)]
    start = jax.tree.map(lambda *x: np.stack([np.asarray(a) for a in x]), *each)
    if all(pose.markers is None for pose in study.poses):
        marked = None
    templates, group = _templates(study, study_poses)
    return Poses(points, mask, expected, boundary, turns, start, templates, group, marked)


def _start_of(study, pose, known, length, elements):
    """Where solves of a pose start: along what was measured; one marker tells too little, and the cable just sags."""
    dense, boundary, turns = known
    if pose.curve is None and len(pose.markers.points) < _MARKED_SHAPE:
        return _sag(boundary, np.asarray(length), np.asarray(study.gravity_in(pose)), turns, elements)
    return _start(dense, boundary, turns, elements)


def check_distance(study: Study, distance: str) -> None:
    """Raise `Scan2FlexError` where markers stand beside a distance of whole curves."""
    marked = next((pose.name for pose in study.poses if pose.markers is not None), None)
    if marked is not None and distance in ("integrated", "hausdorff"):
        said = f"pose {marked!r} has markers, and the distance {distance!r} is one of whole curves"
        raise Scan2FlexError(f"{said}: leave the distance out.")


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


@compiled
def _sag(boundary, length, gravity, turns, elements):
    return sagging_start(boundary, length, gravity, turns, elements)


def _one(pose, length):
    """Points, mask, expected arc lengths, which are markers, a dense curve along them, supports and turns of one pose."""
    boundary, marks = boundary_of(pose), pose.markers
    if pose.curve is None and marks is None:
        raise Scan2FlexError(f"pose {pose.name!r} has no centre curve: run `scan2flex extract` on the study first")
    points, expected, marked = np.zeros((0, 3)), np.zeros(0), np.zeros(0)
    if marks is not None:
        points, expected = _thinned(np.asarray(marks.points), np.asarray(marks.arc_length), _MOST_MARKERS)
        marked = np.ones(len(points))
    if pose.curve is None:
        dense = _through_markers(points, expected, pose, boundary, length)
    else:
        curve, given = _thinned(np.asarray(pose.curve.points), pose.curve.arc_length, MOST_POINTS - len(points))
        full = complete_curve(curve, boundary, length)
        s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(full, axis=0), axis=1))])
        along = s[1:-1] * length / s[-1] if given is None else np.asarray(given)
        points, expected = np.concatenate([curve, points]), np.concatenate([along, expected])
        marked, dense = np.concatenate([np.zeros(len(curve)), marked]), _dense(full)
    pad = MOST_POINTS - len(points)
    return (
        np.concatenate([points, np.repeat(points[-1:], pad, axis=0)]),
        np.concatenate([np.ones(len(points)), np.zeros(pad)]),
        np.concatenate([expected, np.repeat(expected[-1:], pad)]),
        np.concatenate([marked, np.repeat(marked[-1:], pad)]),
        dense,
        boundary,
        np.array(int(pose.turns)),
    )


def _thinned(points, given, most):
    """At most ``most`` points, evenly by index order along the curve, first and last kept."""
    if len(points) <= most:
        return points, given
    keep = np.unique(np.round(np.linspace(0, len(points) - 1, most)).astype(int))
    return points[keep], None if given is None else np.asarray(given)[keep]


def _through_markers(points, s, pose, boundary, length):
    """A smooth curve through supports and markers, with the clamps' tangents; straight on to a free end."""
    near = 1e-6 * length
    held = pose.end is not None
    inside = (s > near) & ((s < length - near) | (not held))
    knots, at = [np.asarray(pose.start.position), *points[inside]], [0.0, *s[inside]]
    if held:
        knots, at = [*knots, np.asarray(pose.end.position)], [*at, max(length, at[-1] + near)]
    R, clamped = np.asarray(boundary.rotation), np.asarray(boundary.held)[:, 3] > 0
    free = (2, np.zeros(3))
    ends = [(1, R[end, :, 2]) if clamped[end] else free for end in (0, 1)]
    spline = CubicSpline(at, np.array(knots), bc_type=tuple(ends))
    along = np.linspace(0.0, max(length, at[-1]), _DENSE)
    beyond = np.maximum(along - at[-1], 0.0)[:, None]
    return spline(np.minimum(along, at[-1])) + beyond * spline(at[-1], 1)


def _dense(points, count=_DENSE):
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
