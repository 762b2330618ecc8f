"""The points of a scan for a direct fit, and a curve good enough to start it.

The points come from the whole file: all that lie near the curve, whether given, found or marked. Cleaning is left to
the weights of the fit, so that the same scan gives the same points for every start, up to a few at the tube's edge.

Symbols: r radius, L length: m.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from scan2flex_jax.errors import Scan2FlexError, StudyError
from scan2flex_jax.scan import cloud as clouds
from scan2flex_jax.scan import coarse_curve, guide_points, spline
from scan2flex_jax.scan.extraction import cleaned, extract_pose, lengthened
from scan2flex_jax.scan.strand_matching import End
from scan2flex_jax.study.model import Study, StudyPose

_WIDE, _WIDE_OF_LENGTH = 3.0, 0.015  # of r, of L: half-width of the tube around the curve


@dataclass(frozen=True)
class NearCurve:
    """Points (m) of a scan near a curve (m), for a direct fit.

    ``noise``: standard deviation of a point from the surface (m), if extraction estimated it; ``refused``: its reason if not.
    """

    points: Float[np.ndarray, "n 3"]
    curve: Float[np.ndarray, "m 3"]
    noise: float | None = None
    refused: str | None = None


def near_curve(study: Study, pose: StudyPose) -> NearCurve:
    """The points of a pose near its centre curve: the study's, an extracted one, or a coarse one if extraction fails.

    An unusable pose is refused with one `Scan2FlexError`, that of the extraction if it failed first.
    """
    if study.cable.get("radius") is None:
        raise StudyError(str(pose.scan), "cable.radius", "a scan needs the cable's radius (m): give it under [cable].")
    if pose.curve is not None:
        return _near(study, pose, np.asarray(pose.curve.points))
    try:
        found = extract_pose(study, pose)
        return replace(_near(study, pose, found.points), noise=found.noise)
    except Scan2FlexError as refusal:
        try:
            return replace(_near(study, pose, _doubtful(study, pose)), refused=str(refusal))
        except Scan2FlexError:
            raise refusal from None


def _near(study, pose, curve):
    """The points of the scan around a curve that is extended slightly at both ends."""
    radius = float(study.cable["radius"])
    wide = max(_WIDE * radius, _WIDE_OF_LENGTH * float(np.sum(np.linalg.norm(np.diff(curve, axis=0), axis=1))))
    points = _checked(study, pose)
    near = points[clouds.near_polyline(points, spline.evenly(lengthened(curve, 2.0 * radius), 800), wide)]
    if len(near) < 4:
        raise Scan2FlexError(f"only {len(near)} points of the cloud lie near the curve that the fit starts from")
    return NearCurve(near, curve)


def _checked(study, pose):
    length = study.cable.get("length")
    points = clouds.load_cloud(str(pose.scan)).points
    return clouds.check_cloud(points, float(study.cable["radius"]), None if length is None else float(length))


def _doubtful(study, pose):
    """After a refusal of the extraction: the curve through the guide points, or the doubtful one."""
    radius, length = float(study.cable["radius"]), study.cable.get("length")
    ends = [None if c is None else End(c.position, c.tangent) for c in (pose.start, pose.end)]
    points = cleaned(_checked(study, pose), radius, length, ends[0], ends[1], pose.guide_points)
    some = points[clouds.thin(points, coarse_curve.VOTERS)]
    if pose.guide_points is not None:
        return guide_points.guided_curve(pose.guide_points, some, radius, pose.viewpoints).points
    return coarse_curve.find_curve(some, radius, length, *ends).points
