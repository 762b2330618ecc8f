"""The measured poses as arrays of one shape: points, supports, models, and the starts of their solves.

Curves are padded to one number of points, so that all studies share one compilation; ``mask`` is 1 for real points. Longer
curves are thinned evenly first.
"""

from collections.abc import Sequence
from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jaxtyping import Bool, Float, Int
from scipy.interpolate import CubicSpline

from scan2flex_jax.compilation import compiled
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting.noise import noise_ratio
from scan2flex_jax.fitting.parameters import guide_key, template
from scan2flex_jax.fitting.readings import AT_END, POINT, Readings, components, rows_of, stacked
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.model import CableModel, Configuration, discretise
from scan2flex_jax.statics.starts import complete_curve, curve_start, default_start, sagging_start
from scan2flex_jax.study.kinds import kind_format
from scan2flex_jax.study.mistakes import on_axis
from scan2flex_jax.study.model import Study, StudyPose, at_end

_DENSE = 513  # points of the curve along which a solve starts
_MOST_MARKERS = 128  # of a pose in a fit
_MARKED_SHAPE = 2  # least number of markers along which a solve starts
MOST_POINTS = 256  # of a curve in a fit: more add no information on a smooth curve whose noise is correlated


class History(eqx.Module):
    """All Q poses of a study with memory in their order, those of a group of poses among them, and what is between them.

    ``at`` (P,): place of each pose of the group; ``reset`` (Q,): whether the cable was straightened before a pose; ``held``
    (Q,): time (s) from a pose to the next, 0 where it is not known.
    """

    poses: "Poses"
    at: Int[np.ndarray, " P"]
    reset: Bool[np.ndarray, " Q"]
    held: Float[np.ndarray, " Q"]


class Poses(eqx.Module):
    """P poses: measured points (m), their expected arc length (m), supports, and starts of solves.

    ``templates`` are the models of the poses before a fit inserts its parameters, and ``group`` is the index of each pose's
    template: poses that differ in gravity or in their effects have different ones. ``marked`` is 1 for points whose arc length
    is known (`expected`), `states.AT_END` for those at the end of the cable; None in a study without markers. ``rows``: for
    poses whose markers have some coordinates only, the axes of these in the first rows; zeros for other poses, None in a study
    without any. ``history``: of a study with memory; None without. ``noise``: the stated noise of each pose over that pooled
    over the fitted ones; None where all have the same. ``readings``: what each row is a reading of; None in a study whose rows
    are all points of the centre curve. ``reference``: the poses from which readings are changes, in those of ``changes``, with
    values of zero and a pose itself in place of the others; None without any.
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
    history: History | None = None
    rows: Float[Array | np.ndarray, "P 3 3"] | None = None
    noise: Float[np.ndarray, " P"] | None = None
    readings: Readings | None = None
    reference: "Poses | None" = None
    changes: tuple[bool, ...] = eqx.field(static=True, default=())

    def template(self, i: int) -> CableModel:
        """The model of pose ``i``."""
        return self.templates[self.group[i]]

    def similar(self, which: Sequence[int]) -> list[tuple[CableModel, list[int]]]:
        """Some of the poses, those together whose models differ in gravity alone, with one of these models."""
        keys: dict[int, tuple] = {}
        for group in {self.group[i] for i in which}:
            model = eqx.tree_at(lambda m: m.gravity, self.templates[group], None)
            leaves, tree = jax.tree.flatten(model)
            keys[group] = tree, *(np.asarray(leaf).tobytes() for leaf in leaves)
        found: dict[tuple, list[int]] = {}
        for i in which:
            found.setdefault(keys[self.group[i]], []).append(int(i))
        return [(self.template(own[0]), own) for own in found.values()]

    @property
    def count(self) -> int:
        """Number of poses."""
        return len(self.turns)

    @property
    def seen(self) -> Bool[np.ndarray, "P m"]:
        """Mask of the rows that are points: of the centre curve, or marks."""
        mask = np.asarray(self.mask) > 0
        return mask if self.readings is None else mask & (np.asarray(self.readings.kind) == POINT)

    def coordinates(self, i: int) -> Int[np.ndarray, " m"]:
        """The number of measured values of each row of pose ``i``: two of a curve, of a mark those that it has."""
        some = 0 if self.rows is None else int(np.count_nonzero(np.any(np.asarray(self.rows[i]) != 0, axis=1)))
        marked = np.zeros(len(np.asarray(self.mask)[i])) if self.marked is None else np.asarray(self.marked)[i]
        count = np.where(marked > 0, some or 3, 2)
        if self.readings is None:
            return count
        kind, axes = np.asarray(self.readings.kind)[i], np.asarray(self.readings.axes)[i]
        return np.array([n if k == POINT else components(int(k), a) for n, k, a in zip(count, kind, axes, strict=True)])

    @property
    def values(self) -> int:
        """The number of measured values of all poses, at least 1."""
        rows = zip(map(self.coordinates, range(self.count)), np.asarray(self.mask) > 0, strict=True)
        return max(int(sum(np.sum(own[real]) for own, real in rows)), 1)

    def weighed(self, factor: Float[np.ndarray, " P"]) -> "Poses":
        """The poses with readings in other units scaled by a ``factor`` each."""
        if self.readings is None:
            return self
        scale, noise = (np.asarray(x) * factor[:, None] for x in (self.readings.scale, self.readings.noise))
        readings = self.readings._replace(scale=scale, noise=noise)
        reference = None if self.reference is None else self.reference.weighed(factor)
        return replace(self, readings=readings, reference=reference)

    def only(self, which: Sequence[int]) -> "Poses":
        """Some of the poses, in this order."""
        at = np.array(which, int)
        arrays = (self.points, self.mask, self.expected, self.boundary, self.turns, self.start, self.marked, self.rows)
        arrays, readings = jax.tree.map(lambda x: np.asarray(x)[at], (arrays, self.readings))
        points, mask, expected, boundary, turns, start, marked, rows = arrays
        noise = None if self.noise is None else self.noise[at]
        group = tuple(self.group[i] for i in which)
        changes = tuple(self.changes[i] for i in which) if self.changes else ()
        history = None if self.history is None else replace(self.history, at=self.history.at[at])
        reference = None if self.reference is None else self.reference.only(which)
        own = (points, mask, expected, boundary, turns, start, self.templates, group, marked, history, rows, noise)
        return Poses(*own, readings, reference, changes)


def boundary_of(pose: StudyPose) -> Boundary:
    """The supports of a study's pose, as `equilibrium` takes them.

    Args:
        pose: Its clamps; one without a quaternion is a ball joint, a missing start or end is free.

    Returns:
        Both supports, with positions (2, 3) in m, rotations (2, 3, 3), and the motions held (2, 6).

    Examples:
        >>> boundary_of(StudyPose("sag", "fit", Clamp([0, 0, 0]))).held.tolist()[0]
        [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]
    """
    ends = (pose.start, pose.end)
    found = Boundary.of(*(None if clamp is None else (clamp.position, clamp.quaternion) for clamp in ends))
    held = np.array(found.held)
    for clamp, own in zip(ends, held, strict=True):
        if clamp is not None:  # the rest is held by `rod.support.Guide`
            own[:3] *= clamp.free is None
            own[3:] *= clamp.hinge is None
    return replace(found, held=jnp.asarray(held))


def poses_of(study: Study, study_poses: Sequence[StudyPose], length: float, elements: int) -> Poses:
    """Arrays of poses of a study, all of which must have a centre curve or markers; solves start along these.

    A pose that is changed keeps its place in the history of a study with memory, by its name.
    """
    found = _without_history(study, study_poses, length, elements)
    if not study.history_dependent:
        return found
    whole = found if tuple(study_poses) == study.poses else _without_history(study, study.poses, length, elements)
    return replace(found, history=History(whole, *places_of(study, study_poses)))


def places_of(study: Study, study_poses: Sequence[StudyPose]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places of poses among all of a study; of these, whether each begins without history, and how long (s) it is held."""
    names, last = [pose.name for pose in study.poses], study.poses[-1]
    pairs = [(p.time, q.time) for p, q in zip(study.poses, (*study.poses[1:], last), strict=True)]
    held = np.array([0.0 if a is None or b is None else b - a for a, b in pairs])
    at = np.array([names.index(pose.name) for pose in study_poses], int)
    return at, np.array([pose.reset for pose in study.poses]), held


def _without_history(study, study_poses, length, elements):
    stack = [_one(study, pose, length) for pose in study_poses]
    points, mask, expected, marked, readings, _, boundary, turns = jax.tree.map(lambda *x: np.stack(x), *stack)
    each = [_start_of(study, pose, one[5:], length, elements) for pose, one in zip(study_poses, stack, strict=True)]
    start = jax.tree.map(lambda *x: np.stack([np.asarray(a) for a in x]), *each)
    if all(pose.markers is None and not pose.angle and not pose.wrench for pose in study.poses):
        marked = None
    if not any(pose.angle or pose.wrench or getattr(pose.markers, "offset", None) is not None for pose in study.poses):
        readings = None
    templates, group = _templates(study, study_poses)
    whole = all(not np.any(measured_rows(pose)) for pose in study.poses)
    rows = None if whole else np.stack([measured_rows(pose) for pose in study_poses])
    noise = noise_ratio(study, study_poses)
    found = Poses(points, mask, expected, boundary, turns, start, templates, group, marked, rows=rows, noise=noise)
    return _with_reference(study, study_poses, replace(found, readings=readings), length, elements)


def _with_reference(study, study_poses, found: Poses, length, elements) -> Poses:
    """The poses with those from which their readings are changes; unchanged where no reading of the study is one."""
    if all(pose.change_from is None for pose in study.poses):
        return found
    others = [pose if pose.change_from is None else study.pose(pose.change_from) for pose in study_poses]
    boundary, turns = jax.tree.map(lambda *x: np.stack(x), *[(boundary_of(pose), np.array(int(pose.turns))) for pose in others])
    each = [start_along(study, pose, length, elements) for pose in others]
    start = jax.tree.map(lambda *x: np.stack([np.asarray(a) for a in x]), *each)
    templates, group = _templates(study, others)
    zeros, changes = np.zeros_like(found.points), tuple(pose.change_from is not None for pose in study_poses)
    reference = replace(found, points=zeros, boundary=boundary, turns=turns, start=start, templates=templates, group=group)
    return replace(found, reference=reference, changes=changes)


def measured_rows(pose: StudyPose) -> Float[np.ndarray, "3 3"]:
    """The axes of the coordinates that markers have, one a row; zeros where they have all three, or there are none, but for
    changes from another pose, which has other normals."""
    rows = np.zeros((3, 3))
    if pose.markers is not None and (pose.markers.measured != "xyz" or pose.change_from is not None):
        own = ["xyz".index(name) for name in pose.markers.measured]
        rows[np.arange(len(own)), own] = 1.0
    return rows


def _start_of(study, pose, known, length, elements):
    """The start of a pose's solves: along the measured curve or markers, or a sagging cable if there is only one marker, or no
    clamp: between ball joints there is one branch, and noise of a curve would bend a soft cable in every element."""
    dense, boundary, turns = known
    joints = pose.start is not None and pose.end is not None and not np.any(boundary.held[:, 3])
    hangs, shapeless = joints and np.any(study.gravity_in(pose)), pose.curve is None and _no_shape(pose)
    if pose.start is None and shapeless:
        return _generic(template(study, pose), boundary, np.asarray(length), turns, elements)
    if hangs or shapeless:
        return _sag(boundary, np.asarray(length), np.asarray(study.gravity_in(pose)), turns, elements)
    return _start(dense, boundary, turns, elements)


def _no_shape(pose) -> bool:
    """Whether a pose has no markers for a curve through them: too few, without a coordinate, beside the axis, or changes."""
    marks = pose.markers
    return marks is None or not on_axis(pose) or len(marks.points) < _MARKED_SHAPE or marks.measured != "xyz"


def start_along(study: Study, pose: StudyPose, length: float, elements: int) -> Configuration:
    """The start of the solve of one pose along its measured curve or markers."""
    return _start_of(study, pose, _one(study, pose, length)[5:], length, elements)


def bowed(study: Study, pose: StudyPose, bow: np.ndarray, length: float, elements: int) -> Configuration:
    """The generic start of a pose with its nodes displaced by ``bow`` (elements + 1, 3) in m, for another branch."""
    boundary, turns = boundary_of(pose), np.array(int(pose.turns))
    sag = _sag(boundary, np.asarray(length), np.asarray(study.gravity_in(pose)), turns, elements)
    return _start(_dense(np.asarray(sag.r) + bow), boundary, turns, elements)


def check_no_memory(study: Study, instead: str) -> None:
    """Raise `Scan2FlexError` if poses depend on those before them, for what solves each pose by itself."""
    kind = next((e.kind for e in study.effects if kind_format(e.kind).memory != "none"), None)
    if kind is not None:
        raise Scan2FlexError(f"{kind} makes poses depend on those before them: {instead}, or leave the effect out.")


def check_distance(study: Study, distance: str) -> None:
    """Raise `Scan2FlexError` if a study has markers and the distance is one of whole curves."""
    marked = next((pose for pose in study.poses if pose.markers is not None or pose.angle or pose.wrench), None)
    if marked is not None and distance in ("integrated", "hausdorff"):
        what = "readings" if marked.markers is None else "markers"
        said = f"pose {marked.name!r} has {what}, and the distance {distance!r} is one of whole curves"
        raise Scan2FlexError(f"{said}: leave the distance out.")


def _templates(study, study_poses):
    """The distinct models of the poses, and the index of each pose's model."""
    models: dict[tuple, CableModel] = {}
    keys = [(study.gravity_in(p).tobytes(), guide_key(p), *(e in study.acting(p) for e in study.effects)) for p in study_poses]
    for key, pose in zip(keys, study_poses, strict=True):
        if key not in models:
            models[key] = template(study, pose)
    return tuple(models.values()), tuple(list(models).index(key) for key in keys)


@compiled
def _start(dense, boundary, turns, elements):
    return curve_start(dense, boundary, turns, elements)


@compiled
def _generic(model, boundary, length, turns, elements):
    model = eqx.tree_at(lambda m: m.cable.length, model, jnp.broadcast_to(length, model.cable.length.shape))
    return default_start(discretise(model, boundary, elements), model.gravity, turns)


@compiled
def _sag(boundary, length, gravity, turns, elements):
    return sagging_start(boundary, length, gravity, turns, elements)


def _one(study, pose, length):
    """Points, mask, expected arc lengths, mask of markers, readings, a dense curve along the points, supports and turns of one
    pose."""
    boundary, marks, stated = boundary_of(pose), pose.markers, study.stated_length
    if pose.scan is not None and pose.curve is None and marks is None:
        raise Scan2FlexError(f"pose {pose.name!r} has no centre curve: run `scan2flex extract` on the study first")
    points, expected, marked, aside = np.zeros((0, 3)), np.zeros(0), np.zeros(0), np.zeros((0, 3))
    if marks is not None:
        both, expected = _thinned(np.c_[np.nan_to_num(marks.points), marks.aside], np.asarray(marks.arc_length), _MOST_MARKERS)
        points, aside = both[:, :3], both[:, 3:]
        marked = np.where([at_end(s, stated) for s in expected], AT_END, 1.0)
    others = rows_of(study, pose, length)
    if pose.curve is None:
        shown = not _no_shape(pose)
        dense = _through_markers(points, expected, pose, boundary, length) if shown else np.zeros((_DENSE, 3))
    else:
        curve, given = _thinned(np.asarray(pose.curve.points), pose.curve.arc_length, MOST_POINTS - len(points) - len(others))
        full = complete_curve(curve, boundary, length)
        s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(full, axis=0), axis=1))])
        along = s[1:-1] * length / s[-1] if given is None else np.asarray(given)
        points, expected = np.concatenate([curve, points]), np.concatenate([along, expected])
        marked, dense = np.concatenate([np.zeros(len(curve)), marked]), _dense(full)
        aside = np.concatenate([np.zeros((len(curve), 3)), aside])
    beyond = len(points) + len(others) - MOST_POINTS
    if beyond > 0:
        raise Scan2FlexError(f"pose {pose.name!r} has {beyond} readings too many: leave some out.")
    readings = _padded(aside, others)
    if others:
        points = np.concatenate([points, [row.value for row in others]])
        expected, marked = np.r_[expected, [row.s for row in others]], np.r_[marked, [row.mark for row in others]]
    if not len(points):  # a pose from which others are changes
        points, expected, marked, mask = np.zeros((1, 3)), np.zeros(1), np.zeros(1), np.zeros(MOST_POINTS)
    else:
        mask = np.r_[np.ones(len(points)), np.zeros(MOST_POINTS - len(points))]
    pad = MOST_POINTS - len(points)
    return (
        np.concatenate([points, np.repeat(points[-1:], pad, axis=0)]),
        mask,
        np.concatenate([expected, np.repeat(expected[-1:], pad)]),
        np.concatenate([marked, np.repeat(marked[-1:], pad)]),
        readings,
        dense,
        boundary,
        np.array(int(pose.turns)),
    )


def _padded(aside, others) -> Readings:
    """What the rows of a pose are: points, with their places beside the axis, then the others."""
    n, rows = len(aside), slice(len(aside), len(aside) + len(others))
    kind, axes, scale = np.full(MOST_POINTS, POINT), np.zeros((MOST_POINTS, 3, 3)), np.ones(MOST_POINTS)
    places, noise = np.concatenate([aside, np.zeros((MOST_POINTS - n, 3))]), np.zeros(MOST_POINTS)
    if others:
        kind[rows], _, axes[rows], scale[rows], noise[rows] = stacked(others)[0]
    return Readings(kind, places, axes, scale, noise)


def _thinned(points, given, most):
    """At most ``most`` points, evenly by index order along the curve, first and last kept."""
    if len(points) <= most:
        return points, given
    keep = np.unique(np.round(np.linspace(0, len(points) - 1, most)).astype(int))
    return points[keep], None if given is None else np.asarray(given)[keep]


def _through_markers(points, s, pose, boundary, length):
    """A smooth curve through supports and markers, with the clamps' tangents; straight beyond the last one to a free end."""
    near = 1e-6 * length
    begun, held = pose.start is not None, pose.end is not None
    inside = ((s > near) | (not begun)) & ((s < length - near) | (not held))
    knots, at = [*points[inside]], [*s[inside]]
    if begun:
        knots, at = [np.asarray(pose.start.position), *knots], [0.0, *at]
    if held:
        knots, at = [*knots, np.asarray(pose.end.position)], [*at, max(length, at[-1] + near)]
    if len(at) < _MARKED_SHAPE:  # one marker of a cable without clamps: its solves start elsewhere
        return np.repeat(knots, _DENSE, axis=0)
    R, clamped = np.asarray(boundary.rotation), np.asarray(boundary.held)[:, 3] > 0
    free = (2, np.zeros(3))
    ends = [(1, R[end, :, 2]) if clamped[end] else free for end in (0, 1)]
    spline = CubicSpline(at, np.array(knots), bc_type=tuple(ends))
    along = np.linspace(0.0, max(length, at[-1]), _DENSE)
    before, beyond = np.minimum(along - at[0], 0.0)[:, None], np.maximum(along - at[-1], 0.0)[:, None]
    return spline(np.clip(along, at[0], at[-1])) + before * spline(at[0], 1) + beyond * spline(at[-1], 1)


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
