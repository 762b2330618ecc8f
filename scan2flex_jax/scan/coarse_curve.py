"""The coarse centre curve without guide points (a step that the paper tried and abandoned).

Every cloud point *votes* for the axis one radius inward along its surface normal (the file's if present, else that of the
neighbouring points). Votes lie close to the centre line even if only one side was seen, and two strands that nearly touch
have votes two radii apart. Votes are gathered into nodes half a radius apart, each with the principal direction of its
neighbours; nodes without such a direction (a clamp, a table) are dropped. The nodes are
chained into *strands* (`strand_matching.py`) and the strands joined end to end from clamp to clamp, over gaps of up to 10 %
of the length.

Symbols: ``r`` radius (m), ``L`` length (m), node spacing ``h`` = r/2 (m, at least L/400).
Reference: normals by principal components (Hoppe et al. 1992); mean shift (Fukunaga, Hostetler 1975).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.scan.spline import evenly
from scan2flex_jax.scan.strand_matching import End, Nodes, chains

VOTERS = 6000  # points that vote: enough for 20 in every patch of a radius
GAP = 0.13  # of L: the longest gap that is bridged (10 % and the thin edges of the cloud on both sides)
_PATCH = 16  # neighbours for a normal
_CROWD = 160  # neighbours for a mean or a direction
_WIDER = 1.5  # apparent radius of a noisy tube, in standard deviations
_MEDIAN_OF_TWO = 1.18  # median distance from the centre of a two-dimensional Gaussian, in standard deviations
_THIN = 0.2  # of the usual density: less is debris
_NOISY = 0.3  # normals are useless for patches thicker than this share of r
WIDE_GAP = 0.28  # of L: longest gap if no other path exists; the length must then agree
_EXPLAINED = 0.75  # share of the votes that a trusted curve explains
_ENOUGH = 0.35  # the same for a curve whose length and clamps agree: the remaining votes are clutter
_LENGTH_OFF, _LENGTH_MEETS = 0.08, 0.02  # of L: for a trusted curve, and for one that is trusted for its length alone
_MEETS = 0.8  # cosine between the curve's ends and the clamps' directions
_AS_GOOD = 0.15  # of badness: another curve within this margin makes the result ambiguous
_OTHERWISE = 0.06  # of L: two curves at a larger distance at some s are different
_SHARP = 0.5  # rad of turn per radius of length: a sharper turn is a jump between strands
_LINE_UP = 0.7  # share of the variance along the first axis: less is no curve


@dataclass(frozen=True)
class Coarse:
    """A coarse centre curve: points (m) from start to end, whether it is trusted, and the doubts."""

    points: Float[np.ndarray, "m 3"]
    sure: bool
    doubts: tuple[str, ...] = ()

    @property
    def length(self) -> float:
        """Length of the polyline (m)."""
        return float(np.sum(np.linalg.norm(np.diff(self.points, axis=0), axis=1)))


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
    if np.median(thick) > _NOISY * radius * min(1.0, np.median(wide) / (0.5 * radius)):
        apparent = max(radius, _WIDER * _across(points, tree, radius))
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
    keep = (lined > _LINE_UP) & (crowd > max(4.0, _THIN * np.median(np.repeat(crowd, count))))
    return Nodes(at[keep], axes[keep][:, :, 2], count[keep])


def find_curve(points, radius, length, start: End | None, end: End | None, normals=None) -> Coarse:
    """The centre curve through a cloud without guide points; a doubtful one carries its doubts, an absent one is refused."""
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
    for gap, bent in ((GAP, False), (GAP, True), (WIDE_GAP, True))[: 3 if held else 2]:
        for path in chains(nodes, reach, gap * scale, start, end, bent):
            curve = _smoothed(path, spacing, apparent)
            found.append((*_judged(curve, nodes, apparent, length, start, end, gap > GAP), curve))
        if any(not doubts for _, doubts, _ in found):
            break
    if not found:
        raise Scan2FlexError(
            "no path through the cloud leads from the start clamp to the end clamp: a gap is longer than"
            f" {100 * GAP:.0f} % of the length, or the clamps stand elsewhere; mark guide points"
        )
    bad, doubts, curve = min(found, key=lambda one: (len(one[1]) > 0, one[0]))
    for other, against, way in found:
        if not (doubts or against) and other < bad + _AS_GOOD and _differ(curve, way) > _OTHERWISE * scale + 4.0 * apparent:
            doubts = ("another way through the cloud explains it about as well",)
    return Coarse(curve, not doubts, doubts)


def _differ(one, other) -> float:
    """Largest distance (m) between two curves at equal fractions of their lengths."""
    return float(np.max(np.linalg.norm(evenly(one, 100) - evenly(other, 100), axis=1)))


def _smoothed(path, spacing, radius):
    """The path at even spacing, smoothed over about a radius to remove its zigzag from node to node."""
    count = max(16, int(np.sum(np.linalg.norm(np.diff(path, axis=0), axis=1)) / (0.5 * spacing)))
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    even = np.column_stack([np.interp(np.linspace(0, s[-1], count), s, x) for x in path.T])
    width = max(0.8 * radius, 1.5 * spacing) / (s[-1] / (count - 1))
    first, last = 2 * even[0] - even[1:][::-1], 2 * even[-1] - even[:-1][::-1]  # odd reflection keeps the ends
    pad = min(count - 1, int(4 * width) + 1)
    long = np.concatenate([first[-pad:], even, last[:pad]])
    return gaussian_filter1d(long, width, axis=0)[pad:-pad]


def _judged(curve, nodes, radius, length, start, end, wide):
    """Badness of a curve, and the doubts: its length against L, and the share of lined-up votes it explains."""
    doubts = []
    near = cKDTree(evenly(curve, 400)).query(nodes.at)[0] < 2.0 * radius + 0.01 * (length or 0.0)
    share = nodes.votes[near].sum() / nodes.votes.sum()
    bad, met = 1.0 - share, False
    if length:
        found = np.sum(np.linalg.norm(np.diff(curve, axis=0), axis=1))
        found += np.linalg.norm(curve[0] - start.position) if start is not None else 0.0
        found += np.linalg.norm(curve[-1] - end.position) if end is not None else 0.0
        bad += 3.0 * abs(found / length - 1.0)
        met = abs(found / length - 1.0) < _LENGTH_MEETS and _meets(curve, start, 0) and _meets(curve, end, -1)
        if not 1.0 - _LENGTH_OFF < found / length < 1.0 + _LENGTH_OFF:
            doubts.append(f"it is {found:.4g} m long from clamp to clamp where the cable is {length:.4g} m")
    if share < (_ENOUGH if met else _EXPLAINED):
        doubts.append(f"it explains only {100 * share:.0f} % of what lines up in the cloud")
    if wide and not met:
        doubts.append(f"it leaps over a gap of more than {100 * GAP:.0f} % of the length, and its own length does not agree")
    turn = _turns(curve, radius)
    bad += 0.3 * max(0.0, float(turn.max()) - _SHARP)
    return bad, tuple(doubts)


def _meets(curve, clamp, k) -> bool:
    """Whether the curve leaves or reaches a clamp in the clamp's direction."""
    if clamp is None or clamp.tangent is None:
        return False
    few = max(2, len(curve) // 50)
    way = curve[few] - curve[0] if k == 0 else curve[-1] - curve[-1 - few]
    return float(way @ clamp.tangent) > _MEETS * float(np.linalg.norm(way))


def _turns(curve, radius):
    """Angles (rad) by which the curve turns per radius of its length."""
    even = evenly(curve, max(8, int(np.sum(np.linalg.norm(np.diff(curve, axis=0), axis=1)) / radius)))
    step = np.diff(even, axis=0)
    step /= np.linalg.norm(step, axis=1, keepdims=True)
    return np.arccos(np.clip(np.sum(step[1:] * step[:-1], axis=1), -1.0, 1.0))
