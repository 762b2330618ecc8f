"""Pairs of effects: evidence of all pairs of groups from one Gram matrix.

With the scaled columns of all groups ``X`` (projected off the base columns), ``G = X'X`` and ``c = X'y``, the log Bayes factor
of a set of columns S is ``1/2 c_S' (I + G_SS)^-1 c_S - 1/2 log |I + G_SS|``, without the residuals. The first effect of a
greedy search is often a compromise between two effects, which a search over pairs avoids.
"""

from itertools import combinations

import numpy as np

from scan2flex_jax.diagnosis.evidence import log_evidence


def best_pairs(groups, y: np.ndarray, singles: np.ndarray, kinds, count: int = 4, atoms: int = 70):
    """``[(log evidence, i, j)]`` of the best pairs of different effect types, each pair of types once.

    ``singles``: log evidence of each group. The ``atoms`` groups of most evidence enter, and the best of each type.
    """
    order = list(np.argsort(singles)[::-1][:atoms])
    for kind in dict.fromkeys(kinds):
        own = [i for i in range(len(groups)) if kinds[i] == kind and groups[i].rank]
        order += sorted(own, key=lambda i: -singles[i])[:3]
    chosen = list(dict.fromkeys(int(i) for i in order if groups[i].rank))
    X = np.concatenate([groups[i].X for i in chosen], axis=1)
    ends = np.cumsum([groups[i].X.shape[1] for i in chosen])
    spans = [np.arange(e - groups[i].X.shape[1], e) for i, e in zip(chosen, ends, strict=True)]
    G, c = X.T @ X, X.T @ y
    found: dict = {}
    for (a, i), (b, j) in combinations(enumerate(chosen), 2):
        if kinds[i] == kinds[j]:
            continue
        S = np.r_[spans[a], spans[b]]
        value = log_evidence(G[np.ix_(S, S)], c[S], (*groups[i].one_sided, *groups[j].one_sided))
        key = tuple(sorted((kinds[i], kinds[j])))
        if key not in found or value > found[key][0]:
            found[key] = (value, i, j)
    return sorted(found.values(), reverse=True)[:count]
