"""Guide points: the user's marks on the cable's surface, from start to end, checked and turned into a coarse curve.

They lie on the visible side, a radius off the axis: the curve through them is moved onto the axis votes of the
cloud around it (`coarse_curve.axis_votes`), if there are any.

Symbols: r radius, L length: m.
"""

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.scan import spline
from scan2flex_jax.scan.coarse_curve import axis_votes, gathered
from scan2flex_jax.scan.settings import USUAL


def checked_guides(guides, radius: float, length: float | None, start=None, end=None):
    """The guide points from start to end, and a note if they ran the other way; a wrong order is refused."""
    guides = np.asarray(guides, float)
    if guides.ndim != 2 or guides.shape[1] != 3 or len(guides) < 2 or not np.isfinite(guides).all():
        raise Scan2FlexError(
            f"guide points need at least two rows of three finite coordinates (m), got the shape {guides.shape}"
        )
    total, best = spline.length(guides), spline.length(_untangled(guides))
    step = spline.unit(np.diff(guides, axis=0))
    folds = np.flatnonzero(np.sum(step[1:] * step[:-1], axis=1) < USUAL.fold)
    too_long = length is not None and total > USUAL.guides_longer * length + 2.0 * np.pi * radius
    if (too_long and best < total) or (best < USUAL.guides_shorter * total and len(folds)):
        where = f" (look at point {folds[0] + 2})" if len(folds) else ""
        known = f", where the cable is {length:.4g} m" if length else ""
        raise Scan2FlexError(
            f"the guide points seem to be in a wrong order{where}: as listed they make a way of {total:.4g} m{known};"
            f" list them from the start of the cable to its end"
        )
    if start is not None and end is not None:
        as_is = np.linalg.norm(guides[0] - start) + np.linalg.norm(guides[-1] - end)
        turned = np.linalg.norm(guides[-1] - start) + np.linalg.norm(guides[0] - end)
        if turned < 0.5 * as_is:
            return guides[::-1].copy(), ("the guide points ran from end to start: they were turned round",)
    return guides, ()


def _untangled(points):
    """The shortest order under 2-opt exchanges, with first and last point kept."""
    order, improved = points.copy(), True
    while improved:
        improved = False
        for i in range(1, len(order) - 2):
            for j in range(i + 1, len(order) - 1):
                old = np.linalg.norm(order[i] - order[i - 1]) + np.linalg.norm(order[j + 1] - order[j])
                new = np.linalg.norm(order[j] - order[i - 1]) + np.linalg.norm(order[j + 1] - order[i])
                if new < old - 1e-12:
                    order[i : j + 1] = order[i : j + 1][::-1]
                    improved = True
    return order


def guide_tube(guides, radius: float) -> tuple[Float[np.ndarray, "m 3"], float]:
    """Fine samples of the spline through the guide points, and the largest distance (m) of the cable from it."""
    spacing = np.max(np.linalg.norm(np.diff(guides, axis=0), axis=1))
    return spline.evenly(guides, 400), max(4.0 * radius, 0.3 * spacing)


def guided_curve(guides, points, radius: float, eyes=None, normals=None) -> Float[np.ndarray, "m 3"]:
    """The curve through the guide points, moved onto the axis: by a radius away from the viewpoint that saw them, if known,
    then onto the votes around it."""
    curve = spline.evenly(guides, 200)
    if eyes is not None:
        behind = [_behind(curve, eye, radius) for eye in eyes]
        tree = cKDTree(points)
        around = [np.sum(tree.query_ball_point(c, 1.3 * radius, return_length=True)) for c in behind]
        curve = behind[int(np.argmax(around))]
    if len(points) >= 100:
        votes, apparent = axis_votes(points, radius, normals)
        near = cKDTree(votes).query(curve)[0] < USUAL.guided * apparent
        moved = gathered(curve, votes, 0.5 * apparent)
        near &= np.linalg.norm(moved - curve, axis=1) < USUAL.guided * apparent
        curve = np.where(near[:, None], moved, curve)
        kernel = np.hanning(11)[1:-1] / np.hanning(11)[1:-1].sum()
        curve = np.column_stack([np.convolve(x, kernel, "valid") for x in spline.extended(curve, 4).T])
    return curve


def _behind(curve, eye, radius):
    """The curve moved by a radius away from an eye, perpendicular to itself."""
    tangent, look = spline.tangents(curve), curve - eye
    return curve + radius * spline.unit(look - np.sum(look * tangent, axis=1, keepdims=True) * tangent)
