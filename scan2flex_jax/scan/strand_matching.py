"""Strands: chains of axis nodes, joined end to end into one cable.

A cable that passes close to itself offers many short cuts, and a shortest path takes them. So the nodes are first
chained into strands without sharp turns or skipped steps; then strand *ends* are joined, each at most once,
by a minimum-cost matching in which a join costs its length and its turn. Where two strands cross, going straight on is
the cheapest pairing of the four ends; a path from the middle of one strand to another does not exist.

Symbols: node positions (m), ``reach`` the longest step inside a strand (m), ``gap`` the longest join (m).
Reference: Dijkstra's algorithm (scipy.sparse.csgraph); weighted matching (Galil 1986, networkx).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import networkx as nx
import numpy as np
from jaxtyping import Float
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from scan2flex_jax.scan import spline
from scan2flex_jax.scan.settings import USUAL

_MOST_STRANDS = 60
_TAIL = 7  # nodes at the end of a strand that give its direction


@dataclass(frozen=True)
class End:
    """One end of the cable from the study: position (m) and unit tangent (towards growing s), if known."""

    position: Float[np.ndarray, "3"]
    tangent: Float[np.ndarray, "3"] | None = None


@dataclass(frozen=True)
class Nodes:
    """Axis nodes (m), the principal direction of each one's neighbours, and its number of votes."""

    at: Float[np.ndarray, "n 3"]
    along: Float[np.ndarray, "n 3"]
    votes: np.ndarray


def chains(
    nodes: Nodes, reach: float, gap: float, start: End | None, end: End | None, bent: bool
) -> Iterator[Float[np.ndarray, "m 3"]]:
    """Candidate cables, each as node positions from start to end: from cautious and bold strands.

    ``bent`` strands are extrapolated beyond their ends with their curvature, others straight.
    """
    for step, straight in ((0.75, 0.85), (1.0, 0.75), (0.75, 0.95)):
        strands = draw_strands(nodes, step * reach, straight)
        path = _joined(strands, reach, gap, start, end, bent)
        if path is not None and len(path) >= 4:
            yield path


def draw_strands(nodes: Nodes, reach: float, straight: float) -> list[Float[np.ndarray, "m 3"]]:
    """Strands, longest first: repeatedly the longest gently turning path of the remaining nodes, until only crumbs remain.

    ``straight`` is the smallest cosine between a step and the directions of its two nodes.
    """
    left = np.ones(len(nodes.at), bool)
    strands = []
    for _ in range(_MOST_STRANDS):
        active = np.flatnonzero(left)
        path = _longest(nodes.at[active], nodes.along[active], reach, straight) if len(active) > 2 else []
        if len(path) < 3:
            break
        strand = nodes.at[active[path]]
        if spline.length(strand) > USUAL.crumb * reach:
            strands.append(strand)
        fine = np.concatenate([np.linspace(a, b, 5) for a, b in pairwise(strand)])
        away, which = cKDTree(fine).query(nodes.at)
        direction = np.repeat(np.diff(strand, axis=0), 5, axis=0)[which]
        aligned = np.abs(np.sum(nodes.along * direction, axis=1)) > 0.6 * np.linalg.norm(direction, axis=1)
        left &= ~((away < reach) & aligned)
        left[active[path]] = False
    return strands


def _longest(at, along, reach, straight) -> list[int]:
    """The longest of the cheapest paths over (node, heading) states, by two sweeps."""
    pairs = cKDTree(at).query_pairs(reach, output_type="ndarray").reshape(-1, 2)
    pairs = np.concatenate([pairs, pairs[:, ::-1]])
    step = at[pairs[:, 1]] - at[pairs[:, 0]]
    size = np.linalg.norm(step, axis=1)
    step = step / np.maximum(size, 1e-12)[:, None]
    tails, heads, costs = [], [], []
    for leave in (0, 1):
        for arrive in (0, 1):
            c1 = (1 - 2 * leave) * np.sum(step * along[pairs[:, 0]], axis=1)
            c2 = (1 - 2 * arrive) * np.sum(step * along[pairs[:, 1]], axis=1)
            good = (c1 > straight) & (c2 > straight)
            turn = np.sqrt(np.maximum(2.0 - c1 - c2, 0.0))
            tails.append(2 * pairs[good, 0] + leave)
            heads.append(2 * pairs[good, 1] + arrive)
            costs.append((size * (1.0 + USUAL.turn_cost * turn))[good])
    n = 2 * len(at)
    graph = coo_matrix((np.concatenate(costs), (np.concatenate(tails), np.concatenate(heads))), shape=(n, n)).tocsr()
    best: list[int] = []
    for seed in np.linspace(0, n - 1, 6).astype(int):
        first = dijkstra(graph, indices=seed)
        far = int(np.argmax(np.where(np.isfinite(first), first, -1.0))) ^ 1  # reversed, back along the whole strand
        cost, before = dijkstra(graph, indices=far, return_predecessors=True)
        state = int(np.argmax(np.where(np.isfinite(cost), cost, -1.0)))
        path = []
        while state >= 0:
            path.append(int(state) // 2)
            state = int(before[state])
        if len(path) > len(best):
            best = path[::-1]
    return list(dict.fromkeys(best))


class _Tip(NamedTuple):
    """An end to be joined: position (m), unit outward direction (None: any), curvature vector there (1/m)."""

    at: np.ndarray
    out: np.ndarray | None
    bend: np.ndarray


def _joined(strands, reach, gap, start, end, bent):
    """Node positions along the strands joined from the start clamp to the end clamp (or as far as they go)."""
    ends = [_Tip(strand[side], *_outward(strand, side, bent)) for strand in strands for side in (0, -1)]
    graph = nx.Graph()
    graph.add_nodes_from(range(len(ends)))
    for i in range(len(ends)):
        for j in range(i + 1, len(ends)):
            if i // 2 != j // 2:
                _offer(graph, i, j, _join_cost(ends[i], ends[j], reach, gap), gap)
    for name, clamp, sign in (("start", start, 1.0), ("end", end, -1.0)):
        if clamp is not None:
            held = _Tip(clamp.position, None if clamp.tangent is None else sign * clamp.tangent, np.zeros(3))
            for i, one in enumerate(ends):
                _offer(graph, name, i, _join_cost(one, held, reach, gap), 3.0 * gap)
    mate = dict(nx.max_weight_matching(graph))
    mate |= {b: a for a, b in mate.items()}
    if start is None and end is None:
        return _longest_chain(strands, mate)
    path, last = _follow(strands, mate, mate.get("start" if start is not None else "end"))
    complete = start is None or end is None or last == "end"
    path = path if start is not None or path is None else path[::-1]
    return path if complete else None


def _offer(graph, i, j, cost, limit):
    """Offer a join that is cheaper than leaving both ends open."""
    if cost is not None and cost < 6.0 * limit:
        graph.add_edge(i, j, weight=6.0 * limit - cost)


def _outward(strand, side, bent):
    """Unit outward direction of a strand at its first (0) or last (-1) node, and its curvature there (1/m).

    The chord of the last nodes lags behind a sharp bend, by up to a radian; a parabola (``bent``) does not,
    but takes the noise of the nodes for a bend.
    """
    back = strand[min(4, len(strand) - 1)] if side == 0 else strand[max(-5, -len(strand))]
    chord = spline.unit(strand[side] - back)
    tail = (strand[:_TAIL] if side == 0 else strand[: -_TAIL - 1 : -1]) - strand[side]
    if not bent or len(tail) < 5:
        return chord, np.zeros(3)
    half, slope, _ = np.polyfit(spline.arc_length(tail), tail, 2)
    out = -spline.unit(slope)
    return out, 2.0 * (half - (half @ out) * out)


def _join_cost(a: _Tip, b: _Tip, reach, limit):
    """Cost (m) of joining two ends, or None if they are too far apart or face elsewhere. An end without direction faces any.

    Directions are extrapolated to the middle of the join with the curvature of their strands.
    """
    step = b.at - a.at
    size = float(np.linalg.norm(step))
    if size > limit + reach:
        return None
    step = step / max(size, 1e-12)
    c1 = 1.0 if a.out is None else float(spline.unit(a.out + 0.5 * size * a.bend) @ step)
    c2 = 1.0 if b.out is None else float(-spline.unit(b.out + 0.5 * size * b.bend) @ step)
    along = 1.0 if a.out is None or b.out is None else float(-a.out @ b.out)
    if size > 1.5 * reach and min(c1, c2) < USUAL.facing:
        return None
    if 0.8 * reach < size <= 1.5 * reach and c1 + c2 < 0.5:  # side by side: another strand
        return None
    if along < -0.9:
        return None
    if size <= 1.5 * reach:  # too short for a meaningful direction of its own
        return size + reach * USUAL.turn_cost * (1.0 - along)
    return size * (1.0 + USUAL.turn_cost * (np.arccos(min(c1, 1.0)) + np.arccos(min(c2, 1.0))))


def _follow(strands, mate, at):
    """Walk from strand end ``at`` through strands and joins; positions, and the end of the walk."""
    parts, seen = [], set()
    while isinstance(at, int) and at // 2 not in seen:
        seen.add(at // 2)
        strand = strands[at // 2]
        parts.append(strand if at % 2 == 0 else strand[::-1])
        at = mate.get(at ^ 1)
    return (np.concatenate(parts) if parts else None), at


def _longest_chain(strands, mate):
    """Without clamps: the chain with the most nodes."""
    walks = [_follow(strands, mate, i)[0] for i in range(2 * len(strands)) if mate.get(i) is None]
    walks = walks or [_follow(strands, mate, 0)[0]]
    return max(walks, key=len)
