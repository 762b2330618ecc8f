"""Points picked on a depth image: pixel coordinates and depth, made points in space by the pinhole model.

    x = (u - c_u) z / f,   y = (v - c_v) z / f,   z = depth

Such picks are few and lie on the side that the camera sees; they are cloud and guide points at once. The camera stands at
the origin, so the depth noise is judged along the ray (`scan/refine.py`).

Symbols: u, v pixel column and row; f focal length and (c_u, c_v) principal point (pixels); depth z (mm in the file, m here).
Wrong intrinsics scale and bend the result: the part of the length that runs across the view goes with 1/f, and an unknown
radial distortion adds to it. `length_sensitivity` says how much for a given set of picks.
"""

import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.scan.centre_curve import CentreCurve
from scan2flex_jax.scan.extraction import extract
from scan2flex_jax.study.files import read_text
from scan2flex_jax.study.limits import curve_limit
from scan2flex_jax.study.values import Where


@dataclass(frozen=True)
class Intrinsics:
    """Focal length and principal point (pixels); the default is the nominal Azure Kinect, 640 x 576 narrow view."""

    focal: float = 504.0
    centre: tuple[float, float] = (320.0, 288.0)


def read_picks(path: str | Path) -> Float[np.ndarray, "n 3"]:
    """Rows of ``u, v, depth in mm`` without a header, in order along the cable."""
    limit = curve_limit()
    text = read_text(Path(path), limit.bytes, Where(str(path)), "the file is not there: name one.", limit)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of an empty table, which is refused below
            picks = np.loadtxt(text.splitlines(), delimiter=",", ndmin=2)
    except ValueError as fault:
        raise Scan2FlexError(f"{path} is no table of u, v, depth in mm: {' '.join(str(fault).split())[:100]}") from fault
    if picks.shape[1] != 3 or not np.isfinite(picks).all() or not (picks[:, 2] > 0).all():
        raise Scan2FlexError(f"{path} must hold three finite columns u, v, depth in mm with positive depth")
    return picks


def deproject(picks: Float[np.ndarray, "n 3"], camera: Intrinsics = Intrinsics()) -> Float[np.ndarray, "n 3"]:
    """Points (m) in the camera's frame."""
    z = 1e-3 * picks[:, 2]
    x = (picks[:, 0] - camera.centre[0]) * z / camera.focal
    y = (picks[:, 1] - camera.centre[1]) * z / camera.focal
    return np.stack([x, y, z], axis=1)


def curve_from_picks(picks, radius: float, noise: float, camera: Intrinsics = Intrinsics()) -> CentreCurve:
    """The centre curve through picks on a cable of ``radius`` (m) with depth ``noise`` (m)."""
    points = deproject(picks, camera)
    return extract(points, radius, guide_points=points, viewpoints=np.zeros((1, 3)), noise=noise)


def length_sensitivity(picks, radius: float, noise: float, camera: Intrinsics = Intrinsics(), change: float = 0.02) -> float:
    """Relative change of the length per relative change of the focal length (-), by a central difference."""
    lengths = [
        curve_from_picks(picks, radius, noise, Intrinsics(camera.focal * (1.0 + way * change), camera.centre)).length
        for way in (1.0, -1.0)
    ]
    return float((lengths[0] - lengths[1]) / (2.0 * change) / (0.5 * sum(lengths)))
