"""The coarse centre curve without guide points (a step that the paper tried and abandoned).

Every cloud point *votes* for the axis one radius inward along its surface normal (the file's if present, else that of the
neighbouring points). Votes lie close to the centre line even if only one side was seen, and two strands that nearly touch
have votes two radii apart. Votes are gathered into nodes half a radius apart, each with the principal direction of its
neighbours; nodes without such a direction (a clamp, a table) are dropped. The nodes are
chained into *strands* (`strand_matching.py`) and the strands joined end to end from clamp to clamp, over gaps of up to 13 %
of the length.

Symbols: ``r`` radius (m), ``L`` length (m), node spacing ``h`` = r/2 (m, at least L/400).
Reference: normals by principal components (Hoppe et al. 1992); mean shift (Fukunaga, Hostetler 1975).
"""

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.scan import spline
from scan2flex_jax.scan.settings import USUAL
from scan2flex_jax.scan.strand_matching import End, Nodes, chains

VOTERS = 6000  # points that vote: enough for 20 in every patch of a radius
_PATCH = 16  # neighbours for a normal
_CROWD = 160  # neighbours for a mean or a direction
_MEDIAN_OF_TWO = 1.18  # median distance from the centre of a two-dimensional Gaussian, in standard deviations


def axis_votes(points: Float[np.ndarray, "n 3"], radius: float, normals=None) -> tuple[Float[np.ndarray, "n 3"], float]:
    """Each point's estimate of the axis (m), and the apparent radius of the tube.

    ``normals`` (n, 3), of either sign, replace those estimated from the neighbouring points.
    With noise above 0.3 r normals carry no information: each point then votes for the mean of its neighbourhood, and the
    apparent radius is that of the noise.
    """
    tree = cKDTree(points)
    patch = points[tree.query(points, min(_PATCH, len(points)))[1]]
    size, axes = _principal(patch, np.ones(patch.shape[:2]))
    thick, wide = np.sqrt(np.maximum(size[:, 0], 0.0)), np.sqrt(size[:, 1])
    if np.median(thick) > USUAL.thick * radius * min(1.0, np.median(wide) / (0.5 * radius)):
        apparent = max(radius, USUAL.blurred * _across(points, tree, radius))
        return gathered(gathered(points, points, apparent), points, apparent), apparent
    sparse = points[:: max(1, len(points) // 2000)]
    middle = gathered(points, sparse, 0.7 * radius)
    normal = axes[:, :, 0] if normals is None else normals
    outward = np.sign(np.sum(normal * (points - middle), axis=1, keepdims=True))
    votes = points - radius * outward * normal
    return gathered(votes, votes, 0.5 * radius), radius


def _principal(groups: Float[np.ndarray, "n k 3"], weight: Float[np.ndarray, "n k"]):
    """Variances (ascending) and axes of weighted groups of points."""
    weight = weight[..., None] / np.maximum(weight.sum(axis=1), 1e-12)[:, None, None]
    off = groups - np.sum(weight * groups, axis=1, keepdims=True)
    return np.linalg.eigh(np.einsum("nki,nkj->nij", weight * off, off))


def _across(points, tree, radius) -> float:
    """Standard deviation of the cloud across its local direction (m), the median over the cloud."""
    some = points[:: max(1, len(points) // 300)]
    index = tree.query(some, min(400, len(points)), distance_upper_bound=8.0 * radius)[1]
    inside = index < len(points)
    groups = points[np.where(inside, index, 0)]
    _, axes = _principal(groups, inside.astype(float))
    middle = np.nanmedian(np.where(inside[..., None], groups, np.nan), axis=1)
    off = groups - middle[:, None]
    off = off - np.einsum("nki,ni->nk", off, axes[:, :, 2])[..., None] * axes[:, None, :, 2]
    return float(np.median(np.linalg.norm(off, axis=2)[inside]) / _MEDIAN_OF_TWO)


def gathered(votes, source, width):
    """Each vote moved to the Gaussian mean (of ``width``, m) of the source points around it: one step of mean shift."""
    away, index = cKDTree(source).query(votes, min(_CROWD, len(source)))
    weight = np.exp(-0.5 * (away**2 - away[:, :1] ** 2) / width**2)[..., None]
    return np.sum(weight * source[index], axis=1) / np.sum(weight, axis=1)


def _nodes(votes, spacing, radius) -> Nodes:
    """Votes gathered on a grid; nodes with few votes or without a direction are dropped."""
    cell = np.floor(votes / spacing).astype(int)
    _, which, count = np.unique(cell, axis=0, return_inverse=True, return_counts=True)
    which = which.ravel()
    at = np.stack([np.bincount(which, votes[:, k]) for k in range(3)], axis=1) / count[:, None]
    reach = max(3.0 * spacing, 1.5 * radius)
    away, index = cKDTree(votes).query(at, min(_CROWD, len(votes)))
    weight = np.where(away < reach, 1.0, 0.0)
    size, axes = _principal(votes[index], weight)
    lined = size[:, 2] / (size.sum(axis=1) + 1e-300)
    crowd = weight.sum(axis=1)
    keep = (lined > USUAL.lined_up) & (crowd > max(4.0, USUAL.thin * np.median(np.repeat(crowd, count))))
    return Nodes(at[keep], axes[keep][:, :, 2], count[keep])


def find_curve(points, radius, length, start: End | None, end: End | None, normals=None) -> Float[np.ndarray, "m 3"]:
    """Points of the centre curve through a cloud without guide points; a doubtful or absent one is refused."""
    votes, apparent = axis_votes(points, radius, normals)
    scale = length or 2.0 * float(np.max(np.ptp(points, axis=0)))
    spacing = max(0.5 * apparent, scale / 400.0)
    nodes = _nodes(votes, spacing, apparent)
    if len(nodes.at) < 5:
        raise Scan2FlexError(
            f"no cable of radius {radius:.4g} m was found in the cloud: its points do not line up along a curve;"
            f" check the radius, or mark guide points"
        )
    reach = max(4.0 * spacing, 2.0 * apparent)
    held = length is not None and start is not None and end is not None
    found = []
    for gap, bent in ((USUAL.gap, False), (USUAL.gap, True), (USUAL.wide_gap, True))[: 3 if held else 2]:
        for path in chains(nodes, reach, gap * scale, start, end, bent):
            curve = _smoothed(path, spacing, apparent)
            found.append((*_judged(curve, nodes, apparent, length, start, end, gap > USUAL.gap), curve))
        if any(not doubts for _, doubts, _ in found):
            break
    if not found:
        raise Scan2FlexError(
            "no path through the cloud leads from the start clamp to the end clamp: a gap is longer than"
            f" {100 * USUAL.gap:.0f} % of the length, or the clamps stand elsewhere; mark guide points"
        )
    bad, doubts, curve = min(found, key=lambda one: (len(one[1]) > 0, one[0]))
    for other, against, way in found:
        if (
            not (doubts or against)
            and other < bad + USUAL.as_good
            and _differ(curve, way) > USUAL.otherwise * scale + 4.0 * apparent
        ):
            doubts = ("another way through the cloud explains it about as well",)
    if doubts:
        raise Scan2FlexError(
            f"a curve was found in the cloud, but it is not to be trusted: {'; '.join(doubts)};"
            f" mark guide points, or scan from another side"
        )
    return curve


def _differ(one, other) -> float:
    """Largest distance (m) between two curves at equal fractions of their lengths."""
    return float(np.max(np.linalg.norm(spline.evenly(one, 100) - spline.evenly(other, 100), axis=1)))


def _smoothed(path, spacing, radius):
    """The path at even spacing, smoothed over about a radius to remove its zigzag from node to node."""
    length = spline.length(path)
    count = max(16, int(length / (0.5 * spacing)))
    width = max(0.8 * radius, 1.5 * spacing) / (length / (count - 1))
    pad = min(count - 1, int(4 * width) + 1)
    return gaussian_filter1d(spline.extended(spline.along(path, count), pad), width, axis=0)[pad:-pad]


def _judged(curve, nodes, radius, length, start, end, wide):
    """Badness of a curve, and the doubts: its length against L, and the share of lined-up votes it explains."""
    doubts = []
    near = cKDTree(spline.evenly(curve, 400)).query(nodes.at)[0] < 2.0 * radius + 0.01 * (length or 0.0)
    share = nodes.votes[near].sum() / nodes.votes.sum()
    bad, met = 1.0 - share, False
    if length:
        found: float = spline.length(curve)
        found += sum(float(np.linalg.norm(curve[k] - one.position)) for k, one in ((0, start), (-1, end)) if one is not None)
        off = abs(found / length - 1.0)
        bad += 3.0 * off
        met = off < USUAL.met_length and _meets(curve, start, 0) and _meets(curve, end, -1)
        if off >= USUAL.coarse_length:
            doubts.append(f"it is {found:.4g} m long from clamp to clamp where the cable is {length:.4g} m")
    if share < (USUAL.explained_met if met else USUAL.explained):
        doubts.append(f"it explains only {100 * share:.0f} % of what lines up in the cloud")
    if wide and not met:
        doubts.append(
            f"it leaps over a gap of more than {100 * USUAL.gap:.0f} % of the length, and its own length does not agree"
        )
    return bad, tuple(doubts)


def _meets(curve, clamp, k) -> bool:
    """Whether the curve leaves or reaches a clamp in the clamp's direction."""
    if clamp is None or clamp.tangent is None:
        return False
    few = max(2, len(curve) // 50)
    way = curve[few] - curve[0] if k == 0 else curve[-1] - curve[-1 - few]
    return float(way @ clamp.tangent) > USUAL.met_direction * float(np.linalg.norm(way))
