"""The coarse centre curve: through the user's guide points, or found without any.

Finding it (the step that the paper tried and gave up): every cloud point *votes* for the axis by stepping one radius
inward along its local surface normal. Votes lie close to the centre line even where only one side was seen, and two
strands that nearly touch have votes two radii apart. Votes are gathered into nodes half a radius apart, each with the
direction in which its neighbours line up; nodes of a table top line up with nothing and are dropped. The curve is the
shortest path from clamp to clamp over *directed* nodes (node, heading): an edge costs its length, more when it turns away
from the heading, and three times as much across a gap, so that a path does not jump to a strand that crosses.

Symbols: ``r`` radius (m), ``L`` length (m), node spacing ``h`` = r/2 (m, at least L/400).
Reference: Dijkstra's algorithm of scipy.sparse.csgraph; normals by principal components (Hoppe et al. 1992).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.scan.spline import evenly

VOTERS = 6000  # points that vote: enough for 20 in every patch of a radius
_PATCH = 16  # neighbours of a normal
_CROWD = 160  # neighbours of a mean or a direction
_WIDER = 1.5  # a noisy tube looks this many standard deviations wide
_BALL = 64  # neighbours that tell inside from outside
_NOISY = 0.3  # normals are useless when the patch is thicker than this share of r
_GAP = 0.13  # of L: the longest gap that is bridged
_GAP_COSTS = (3.0, 10.0, 30.0)  # per length, tried in turn: cheap gaps invite shortcuts, dear ones detours
_TURN_COST = 4.0
_EXPLAINED = 0.75  # share of the votes that a trusted curve explains
_LENGTH_OFF = 0.06  # of L, for a trusted curve
_LINE_UP = 0.65  # share of the variance along the first axis: less is no curve


@dataclass(frozen=True)
class Coarse:
    """A rough centre curve: points (m) from start to end, whether to trust it, and why not."""

    points: Float[np.ndarray, "m 3"]
    sure: bool
    doubts: tuple[str, ...] = ()

    @property
    def length(self) -> float:
        """Length of the polyline (m)."""
        return float(np.sum(np.linalg.norm(np.diff(self.points, axis=0), axis=1)))


@dataclass(frozen=True)
class End:
    """One end of the cable as the study tells it: position (m) and unit tangent (towards growing s), if known."""

    position: Float[np.ndarray, "3"]
    tangent: Float[np.ndarray, "3"] | None = None


def axis_votes(points: Float[np.ndarray, "n 3"], radius: float) -> tuple[Float[np.ndarray, "n 3"], float]:
    """Where each point believes the axis to be (m), and the radius at which the cloud looks like a tube.

    With noise beyond 0.3 r normals mean nothing: then each point votes for the middle of its surroundings, and the tube
    looks as wide as the noise makes it.
    """
    tree = cKDTree(points)
    away, ball = tree.query(points, min(_BALL, len(points)))
    patch = points[ball[:, :_PATCH]]
    size, axes = _principal(patch, np.ones(patch.shape[:2]))
    thick, wide = np.sqrt(np.maximum(size[:, 0], 0.0)), np.sqrt(size[:, 1])
    if np.median(thick) > _NOISY * radius * min(1.0, np.median(wide) / (0.5 * radius)):
        apparent = max(radius, _WIDER * _across(points, tree, radius))
        return _gathered(_gathered(points, points, apparent), points, apparent), apparent
    near = (away < 2.0 * radius)[..., None]
    middle = np.sum(points[ball] * near, axis=1) / near.sum(axis=1)
    normal = axes[:, :, 0]
    outward = np.sign(np.sum(normal * (points - middle), axis=1, keepdims=True))
    votes = points - radius * outward * normal
    return _gathered(votes, votes, 0.5 * radius), radius


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
    size, _ = _principal(points[np.where(inside, index, 0)], inside.astype(float))
    return float(np.sqrt(np.median(size[:, 0] + size[:, 1])))


def _gathered(votes, source, width):
    """Each vote moved to the Gaussian mean (of ``width``, m) of the source points around it: one step of mean shift."""
    away, index = cKDTree(source).query(votes, min(_CROWD, len(source)))
    weight = np.exp(-0.5 * (away / width) ** 2)[..., None]
    return np.sum(weight * source[index], axis=1) / np.sum(weight, axis=1)


@dataclass(frozen=True)
class _Nodes:
    """Axis nodes (m), their line-up directions, and how many votes each holds."""

    at: np.ndarray
    along: np.ndarray
    votes: np.ndarray


def _nodes(votes, spacing, radius) -> _Nodes:
    """Votes gathered on a grid; what is thin of votes or lines up with nothing is dropped."""
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
    keep = (lined > _LINE_UP) & (crowd > max(4.0, 0.05 * np.median(crowd)))
    return _Nodes(at[keep], axes[keep][:, :, 2], count[keep])


def _edges(nodes: _Nodes, spacing, radius, gap, gap_cost):
    """Directed edges between (node, heading) states: tail, head, cost. State 2i is node i along its axis, 2i+1 against."""
    pairs = cKDTree(nodes.at).query_pairs(gap, output_type="ndarray")
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    step = nodes.at[pairs[:, 1]] - nodes.at[pairs[:, 0]]
    size = np.linalg.norm(step, axis=1)
    step = step / np.maximum(size, 1e-12)[:, None]
    short = size < max(4.0 * spacing, 2.0 * radius)
    base = size * np.where(short, 1.0, gap_cost)
    tails, heads, costs = [], [], []
    for leave in (0, 1):
        for arrive in (0, 1):
            c1 = (1 - 2 * leave) * np.sum(step * nodes.along[pairs[:, 0]], axis=1)
            c2 = (1 - 2 * arrive) * np.sum(step * nodes.along[pairs[:, 1]], axis=1)
            turn = np.arccos(np.clip(c1, -1, 1)) ** 2 + np.arccos(np.clip(c2, -1, 1)) ** 2
            good = (np.minimum(c1, c2) > 0.5) | (short & (c1 + c2 > 1.2))
            tails.append(2 * pairs[good, 0] + leave)
            heads.append(2 * pairs[good, 1] + arrive)
            costs.append((base * (1.0 + _TURN_COST * turn))[good])
    return np.concatenate(tails), np.concatenate(heads), np.concatenate(costs)


def _end_edges(nodes: _Nodes, end: End, gap: float, outgoing: bool):
    """Edges between a clamp and the states near it; states and costs (twice the distance, more for a turn)."""
    step = nodes.at - end.position
    size = np.linalg.norm(step, axis=1)
    near = np.flatnonzero(size < gap)
    step = step[near] / np.maximum(size[near], 1e-9)[:, None] * (1.0 if outgoing else -1.0)
    states, costs = [], []
    for sign in (0, 1):
        c = (1 - 2 * sign) * np.sum(step * nodes.along[near], axis=1)
        turn = np.arccos(np.clip(c, -1, 1)) ** 2
        if end.tangent is not None:
            turn = turn + np.arccos(np.clip(step @ end.tangent, -1, 1)) ** 2
            faces = (1 - 2 * sign) * (nodes.along[near] @ end.tangent) > -0.2
        else:
            faces = np.ones(len(near), bool)
        good = faces & ((c > 0.0) | (size[near] < 0.2 * gap))
        states.append(2 * near[good] + sign)
        costs.append((2.0 * size[near] * (1.0 + _TURN_COST * turn))[good])
    return np.concatenate(states), np.concatenate(costs)


def find_curve(points, radius, length, start: End | None, end: End | None) -> Coarse:
    """The centre curve through a cloud without guide points; a doubtful one says why, an absent one is refused."""
    votes, apparent = axis_votes(points, radius)
    scale = length or 2.0 * float(np.max(np.ptp(points, axis=0)))
    spacing = max(0.5 * apparent, scale / 400.0)
    nodes = _nodes(votes, spacing, apparent)
    if len(nodes.at) < 5:
        raise Scan2FlexError(
            f"no cable of radius {radius:.4g} m was found in the cloud: its points do not line up along a curve;"
            f" check the radius, or mark guide points"
        )
    found = []
    for gap, cost in [(0.4 * _GAP, _GAP_COSTS[0]), *((_GAP, cost) for cost in _GAP_COSTS)]:
        reach = max(gap * scale, 4.0 * spacing)
        path = _shortest(nodes, _edges(nodes, spacing, apparent, reach, cost), start, end, max(_GAP * scale, reach))
        if len(path) < 4:
            continue
        curve = _smoothed(path, spacing, apparent)
        found.append((*_judged(curve, nodes, apparent, length, start, end), curve))
        if not found[-1][1]:
            break
    if not found:
        raise Scan2FlexError(
            "no path through the cloud leads from the start clamp to the end clamp: a gap is longer than"
            f" {100 * _GAP:.0f} % of the length, or the clamps stand elsewhere; mark guide points"
        )
    _, doubts, curve = min(found, key=lambda one: one[0])
    return Coarse(curve, not doubts, doubts)


def _shortest(nodes: _Nodes, edges, start, end, gap):
    """Node positions on the cheapest path; a free end is the state that is furthest to reach."""
    tails, heads, costs = edges
    n = 2 * len(nodes.at)
    if start is not None:
        states, cost = _end_edges(nodes, start, gap, True)
        tails, heads, costs = np.append(tails, np.full(len(states), n)), np.append(heads, states), np.append(costs, cost)
    if end is not None:
        states, cost = _end_edges(nodes, end, gap, False)
        tails, heads = np.append(tails, states), np.append(heads, np.full(len(states), n + 1))
        costs = np.append(costs, cost)
    graph = coo_matrix((costs, (tails.astype(int), heads.astype(int))), shape=(n + 2, n + 2)).tocsr()
    source = n
    if start is None:
        reached = dijkstra(graph, indices=0)[:n]
        source = int(np.argmax(np.where(np.isfinite(reached), reached, -1.0))) ^ 1  # turned round: the other way is far
    cost, before = dijkstra(graph, indices=source, return_predecessors=True)
    target = n + 1 if end is not None else int(np.argmax(np.where(np.isfinite(cost[:n]), cost[:n], -1.0)))
    if not np.isfinite(cost[target]) or cost[target] <= 0.0:
        return nodes.at[:0]
    states = []
    while target >= 0:
        states.append(target)
        target = before[target]
    inner = [k // 2 for k in states[::-1] if k < n]
    return nodes.at[inner]


def _smoothed(path, spacing, radius):
    """The path at even spacing, its zigzag from node to node taken out over about a radius."""
    count = max(16, int(np.sum(np.linalg.norm(np.diff(path, axis=0), axis=1)) / (0.5 * spacing)))
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])
    even = np.column_stack([np.interp(np.linspace(0, s[-1], count), s, x) for x in path.T])
    width = max(0.8 * radius, 1.5 * spacing) / (s[-1] / (count - 1))
    first, last = 2 * even[0] - even[1:][::-1], 2 * even[-1] - even[:-1][::-1]  # odd reflection keeps the ends
    pad = min(count - 1, int(4 * width) + 1)
    long = np.concatenate([first[-pad:], even, last[:pad]])
    return gaussian_filter1d(long, width, axis=0)[pad:-pad]


def _judged(curve, nodes, radius, length, start, end):
    """Badness of a curve, and the doubts about it: its length beside L, the share of lined-up votes it explains."""
    doubts = []
    near = cKDTree(evenly(curve, 400)).query(nodes.at)[0] < 2.0 * radius + 0.01 * (length or 0.0)
    share = nodes.votes[near].sum() / nodes.votes.sum()
    bad = 1.0 - share
    if share < _EXPLAINED:
        doubts.append(f"it explains only {100 * share:.0f} % of what lines up in the cloud")
    if length:
        found = np.sum(np.linalg.norm(np.diff(curve, axis=0), axis=1))
        found += np.linalg.norm(curve[0] - start.position) if start is not None else 0.0
        found += np.linalg.norm(curve[-1] - end.position) if end is not None else 0.0
        bad += 3.0 * abs(found / length - 1.0)
        if not 1.0 - _LENGTH_OFF < found / length < 1.0 + _LENGTH_OFF:
            doubts.append(f"it is {found:.4g} m long from clamp to clamp where the cable is {length:.4g} m")
    return bad, tuple(doubts)
