"""The whole chain from a scan to its centre curve (`scan2flex_jax.scan` describes it), for one cloud and for a study.

Every compiled function has one shape for all clouds (points padded to `SNAKES_POINTS` and `REFINE_POINTS`, curves of
`SNAKES_KNOTS` and `refine.KNOTS` points), so that the poses of a study share one compilation.

Symbols: r radius, L length between the clamps, s arc length: m.
"""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from scan2flex_jax.errors import Scan2FlexError, StudyError
from scan2flex_jax.scan import cloud as clouds
from scan2flex_jax.scan import coarse_curve, refine, snakes, spline
from scan2flex_jax.scan.centre_curve import CentreCurve, centre_curve
from scan2flex_jax.scan.guide_points import checked_guides, guide_tube, guided_curve
from scan2flex_jax.scan.plausibility import clamp_to_clamp, doubts, foreign
from scan2flex_jax.scan.settings import USUAL
from scan2flex_jax.scan.strand_matching import End
from scan2flex_jax.study.model import MeasuredCurve, Study, StudyPose
from scan2flex_jax.study.sense import check_study

SNAKES_POINTS = 2048
SNAKES_KNOTS = 20
REFINE_POINTS = 8192
_PLANE_POINTS = 40_000
_RENEWALS = 3  # rounds of selecting the points near the curve again
_RADII_SHARE = 0.25  # r_i of the coarse step may differ from r by this share


@dataclass(frozen=True)
class _Cable:
    """What is known besides the cloud (m): radius, length, ends, guide points, viewpoints, noise; None where unknown."""

    radius: float
    length: float | None
    start: End | None
    end: End | None
    guides: Float[np.ndarray, "g 3"] | None
    eyes: Float[np.ndarray, "v 3"] | None
    noise: float | None

    @property
    def clamps(self):
        """Positions of the two ends."""
        return tuple(None if one is None else one.position for one in (self.start, self.end))


def extract(
    cloud: clouds.Cloud | np.ndarray,
    radius: float,
    *,
    length: float | None = None,
    start: End | None = None,
    end: End | None = None,
    guide_points: ArrayLike | None = None,
    viewpoints: ArrayLike | None = None,
    noise: float | None = None,
) -> CentreCurve:
    """The centre curve of a cable of ``radius`` (m) in a cloud (`Cloud` or points, m).

    ``length`` (m) and the ends guide the search; ``viewpoints`` (m) matter if the noise is as large as the radius;
    ``noise`` is the standard deviation of one coordinate (m), if known. Refuses with one `Scan2FlexError`.
    """
    _require_float64()
    if not (np.isfinite(radius) and radius > 0):
        raise Scan2FlexError(f"the radius must be a positive number of metres, got {radius}")
    notes, given = (list(cloud.notes), cloud.points) if isinstance(cloud, clouds.Cloud) else ([], cloud)
    points = clouds.check_cloud(given, radius, length)
    stages = {"cloud": points[clouds.thin(points, 20_000)]}
    eyes = None if viewpoints is None else np.atleast_2d(np.asarray(viewpoints, float))
    known = _Cable(radius, length, start, end, None, eyes, noise)
    if guide_points is not None:
        stages["guide points"], said = checked_guides(guide_points, radius, length, *known.clamps)
        known, notes = replace(known, guides=stages["guide points"]), [*notes, *said]
    points = _cleaned(points, known)
    coarse, found_by = _coarse(cloud, points, known)
    stages["coarse"] = coarse
    extended = _lengthened(coarse, max(2.0 * radius, 0.02 * spline.length(coarse)), known)
    inside = _near(points, extended, radius)
    if inside.sum() < 4:
        raise Scan2FlexError(
            f"only {inside.sum()} points of the cloud lie near the coarse curve: check the guide points and the units"
        )
    stages["snakes"] = _snake(extended, points[inside], radius)
    few = guide_points is not None and int(inside.sum()) <= USUAL.few

    def refined(starts, near):
        return _refined(starts, near, known, few, found_by, stages, notes)

    curve, fit = refined((extended,) if few else (stages["snakes"], extended), points[inside])
    if few:
        return curve
    for _ in range(_RENEWALS):
        inside, left_out = _renewed(points, inside, fit, radius)
        if not left_out:
            break
        curve, fit = refined((fit.points,), points[inside])
    strange = _strange(curve, fit, points[inside], radius)
    if strange.any():
        curve, fit = refined((fit.points,), points[inside][~strange])
    _refuse_doubtful(curve, known)
    said = _remarks(curve, radius, fit, eyes is not None)
    if strange.any():
        said.append("where most points lie on no tube of this radius (a connector?) or few between gaps they were left out")
    return replace(curve, warnings=(*curve.warnings, *said))


def _strange(curve, fit, points, radius):
    """Mask of points that are not to be followed: where most of them lie on no tube, or between gaps that are one."""
    where, there = cKDTree(spline.evenly(fit.points, 800)).query(points)[1] / 800, foreign(fit, radius)
    away, which = cKDTree(curve.points).query(points)
    lost = curve.in_gaps(curve.arc_length[which])
    led = bool(np.any(lost & (np.abs(away - radius) < USUAL.on * fit.sigma)))
    return there[(where * len(there)).astype(int)] | (lost & led)


def _near(points, curve, radius):
    """Mask of the points that may belong to this curve."""
    wide = max(USUAL.tube * radius, USUAL.tube_of_length * spline.length(curve))
    return clouds.near_polyline(points, spline.evenly(curve, 800), wide)


def _renewed(points, inside, fit, radius):
    """Mask of the points near the refined curve, and whether the previous mask missed points of the cable.

    The coarse curve cuts straight across sparsely sampled parts, and so misses points where the cable bends.
    """
    now = _near(points, fit.points, radius)
    come = points[now & ~inside]
    on = clouds.near_polyline(come, spline.evenly(fit.points, 800), radius + USUAL.on * fit.sigma) if len(come) else come
    return now, bool(np.sum(on) > max(3.0, USUAL.missed * np.sum(inside)))


def _refined(starts, near, known, few, found_by, stages, notes):
    """Curve with its doubts, and its `Refined`, from the first start without doubts, else the best.

    If the snakes went astray, the coarse curve is the better start.
    """
    radius, eyes = known.radius, known.eyes
    near = near[clouds.thin(near, REFINE_POINTS)]
    stages["points used"] = near
    points, real = _padded(near, REFINE_POINTS)
    if few and eyes is not None:  # marks lie on the visible side, and the axis a radius behind them
        points = points + radius * (points - eyes[0]) / jnp.linalg.norm(points - eyes[0], axis=1, keepdims=True)
    found = []
    for begin in starts:
        fit = refine.refine(spline.evenly(begin, refine.KNOTS), points, real, radius, eyes, known.noise, few)
        if np.sum(fit.weight > USUAL.certain) >= 4:
            curve = centre_curve(fit, radius, found_by, stages, known.clamps)
            against, astray = doubts(curve, fit, radius, known.length, known.start, known.end, few)
            found.append((replace(curve, warnings=(*notes, *against), doubts=tuple(against), astray=astray), fit))
            if not against:
                break
    if not found:
        raise Scan2FlexError(f"no points lie {radius:.4g} m from a common curve: this cloud shows no cable of that radius")
    return min(found, key=lambda one: (len(one[0].doubts), -np.sum(one[1].weight)))


def _require_float64():
    """Refuse float32: in a scan metres away from the origin it rounds at a tenth of a noise of 0.1 mm."""
    if not jax.config.jax_enable_x64:  # type: ignore[attr-defined]  # jax declares no options
        raise Scan2FlexError(
            "scan2flex_jax computes in float64 only: call jax.config.update('jax_enable_x64', True) before the first array"
            " (or set the environment variable JAX_ENABLE_X64=1)"
        )


def _cleaned(points, known):
    """Points that are not isolated, within reach of the cable, and near the guides (if any) or else off tables."""
    held = points[clouds.reachable(points, known.radius, known.clamps, known.length)]
    if len(held) < 4:
        raise Scan2FlexError(
            f"{len(held)} of the {len(points)} points lie where a cable of {known.length:.4g} m between these clamps can be:"
            f" the cloud and the clamps are not in one frame, or not in metres"
        )
    held = held[clouds.not_isolated(held)]
    if known.guides is None:
        held = held[clouds.thin(held, _PLANE_POINTS)]
        return held[clouds.off_planes(held, known.radius)]
    curve, reach = guide_tube(known.guides, known.radius)
    held = held[clouds.near_polyline(held, _lengthened(curve, 3.0 * reach), reach)]
    if len(held) < 4:
        raise Scan2FlexError(f"no points of the cloud lie within {reach:.3g} m of the guide points: are both in metres?")
    return held


def _coarse(cloud, points, known):
    """The coarse curve and its origin; guide points take precedence, and without them a doubt is a refusal."""
    some = points[clouds.thin(points, coarse_curve.VOTERS)]
    normals = clouds.normals_at(cloud, some)
    try:
        found = coarse_curve.find_curve(some, known.radius, known.length, known.start, known.end, normals)
        if known.guides is None:
            return found, "cloud"
        away, which = cKDTree(spline.evenly(found, 800)).query(known.guides)
        if which[-1] < which[0]:
            found, which = found[::-1], 799 - which
        if np.all(away < 3.0 * known.radius + 0.01 * spline.length(found)) and np.all(np.diff(which) > 0):
            return found, "cloud, and the guide points agree"
    except Scan2FlexError:
        if known.guides is None:
            raise
    return guided_curve(known.guides, some, known.radius, known.eyes, normals), "guide points"


def _lengthened(curve, by, known=None):
    """The curve extended at both ends, so that the cloud ends before it does: along the clamps if it ends at them."""
    back = max(2, len(curve) // 40)
    first, last = spline.unit(curve[0] - curve[back]), spline.unit(curve[-1] - curve[-1 - back])
    head, tail = [curve[0] + by * first], [curve[-1] + by * last]
    start, end, radius = (None, None, 0.0) if known is None else (known.start, known.end, known.radius)
    near = by + 2.0 * radius
    if start is not None and start.tangent is not None and np.linalg.norm(curve[0] - start.position) < near:
        curve = curve[np.argmax((curve - start.position) @ start.tangent > 0.5 * radius) :]
        head = [start.position - by * start.tangent, start.position]
    if end is not None and end.tangent is not None and np.linalg.norm(curve[-1] - end.position) < near:
        keep = (end.position - curve) @ end.tangent > 0.5 * radius
        curve = curve[: len(curve) - int(np.argmax(keep[::-1]))]
        tail = [end.position, end.position + by * end.tangent]
    return np.concatenate([head, curve, tail])


def _padded(points, count):
    """Points in an array of ``count`` rows, and the mask of real rows."""
    real = np.arange(count) < len(points)
    rows = np.concatenate([points, np.repeat(points[:1], count - len(points), axis=0)])
    return jnp.asarray(rows), jnp.asarray(real)


def _snake(curve, near, radius):
    """Points of the snakes curve (m)."""
    x0 = spline.evenly(curve, SNAKES_KNOTS)
    some = near[clouds.thin(near, SNAKES_POINTS)]
    points, real = _padded(some, SNAKES_POINTS)
    c = spline.coefficients(jnp.asarray(x0))
    samples = np.asarray(spline.evaluate(c, snakes.gap_samples(SNAKES_KNOTS)))
    in_gap = cKDTree(some).query(samples)[0] > 2.5 * radius
    away = cKDTree(spline.evenly(curve, 800)).query(np.asarray(points))[0]
    radii = np.clip(away, (1 - _RADII_SHARE) * radius, (1 + _RADII_SHARE) * radius)
    problem = snakes.SnakesProblem(points, jnp.asarray(radii), real, jnp.asarray(in_gap), jnp.asarray(float(radius)))
    return snakes.minimise_snakes(x0, problem)


def _refuse_doubtful(curve: CentreCurve, known):
    """Refuse a curve found without guide points whose length is far from the known one: it followed a wrong path."""
    length = known.length
    if not length or known.start is None or known.end is None or curve.found_by != "cloud":
        return
    whole = clamp_to_clamp(curve, known.start, known.end)
    if abs(whole / length - 1.0) > USUAL.refused:
        raise Scan2FlexError(
            f"the curve found in the cloud is {whole:.4g} m long from clamp to clamp where the cable is {length:.4g} m:"
            f" it is not to be trusted; mark guide points, or correct the length"
        )


def _remarks(curve: CentreCurve, radius, fit, viewed):
    """Remarks on a curve without doubts: gaps, and the limits of the noise model."""
    said = []
    if viewed and fit.facing < USUAL.face_eye:
        said.append(
            f"{100 * (1.0 - fit.facing):.0f} % of the points face none of the viewpoints: these are not the scan's,"
            f" and were left aside"
        )
    if not curve.along_ray and curve.noise > USUAL.noisy * radius:
        said.append(
            f"a point is uncertain by {curve.noise:.2g} m where the radius is {radius:.4g} m, and no viewpoints are given:"
            f" a scan from one side then draws the curve towards the sensor by up to half a radius; give the viewpoints"
        )
    for a, b in curve.gaps:
        said.append(f"no points were seen from s = {a:.4g} m to {b:.4g} m: there the curve is a smooth guess")
    return said


def extract_study(
    study: Study, progress: Callable[[str, int, int], None] | None = None
) -> tuple[Study, dict[str, CentreCurve]]:
    """A copy of the study with a centre curve for every pose that has a scan and none yet, and the curves by pose name.

    Points within gaps are guesses, and no measurements: the study's curves leave them out.

    ``progress(pose, number, total)`` is called before each pose; its exceptions are ignored.
    """
    check_study(study, "extract")
    found: dict[str, CentreCurve] = {}
    poses = []
    todo = [pose.name for pose in study.poses if pose.scan is not None and pose.curve is None]
    for pose in study.poses:
        if pose.name in todo:
            if progress is not None:
                with suppress(Exception):
                    progress(pose.name, len(found) + 1, len(todo))
            curve = found[pose.name] = extract_pose(study, pose)
            pose = replace(pose, curve=MeasuredCurve(curve.points[curve.seen]))  # noqa: PLW2901
        poses.append(pose)
    return replace(study, poses=tuple(poses)), found


def extract_pose(study: Study, pose: StudyPose) -> CentreCurve:
    """The centre curve of one pose of a study; a fault names the study's scan file."""
    radius, length = study.cable.get("radius"), study.cable.get("length")
    name = str(pose.scan)
    if radius is None:
        raise StudyError(name, "cable.radius", "a scan needs the cable's radius (m): give it under [cable].")
    try:
        return extract(
            clouds.load_cloud(name),
            float(radius),
            length=None if length is None else float(length),
            start=None if pose.start is None else End(pose.start.position, pose.start.tangent),
            end=None if pose.end is None else End(pose.end.position, pose.end.tangent),
            guide_points=pose.guide_points,
            viewpoints=pose.viewpoints,
            noise=pose.noise,
        )
    except Scan2FlexError as fault:
        sentence = fault.sentence if isinstance(fault, StudyError) else f"{fault}"
        raise StudyError(name, f"pose {pose.name!r}", sentence) from fault
