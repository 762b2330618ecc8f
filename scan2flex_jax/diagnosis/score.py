"""Global test for missing physics: the largest efficient score of all groups, calibrated by a parametric bootstrap.

With ``y = M r`` (whitened residual, projected off the base columns) and ``X = M S`` for one group of columns (an effect type at
one site), the score statistic is ``T = |P_X y|^2``, chi-squared with ``k`` degrees of freedom under the null. The largest
``-log p(T_g)`` over all groups is compared with its bootstrap distribution under noise alone (max-T), which accounts for the
look-elsewhere effect over types and sites. Discrepancy fields, one per family, are tested likewise.
References: Rao, "Large sample tests" (1948); Westfall and Young, "Resampling-based multiple testing" (1993).
"""

from dataclasses import dataclass

import numpy as np
from scipy import special

_BLIND = 1e-3  # whitened, projected length of one physical size below which these poses are insensitive to a group
_FLAT = 1e-3  # singular value of a group's columns, over the largest, below which a direction is dropped


@dataclass(frozen=True)
class Group:
    """An effect type at one site: projected, scaled columns ``X`` (n, k), basis ``Q``, which are one-sided, and its owner."""

    owner: int
    X: np.ndarray
    Q: np.ndarray
    one_sided: tuple[bool, ...]

    @property
    def rank(self) -> int:
        """Number of identifiable directions."""
        return self.Q.shape[1]


def group_of(owner: int, columns: np.ndarray, size: np.ndarray, base: np.ndarray, one_sided) -> Group:
    """Columns in units of their physical size, projected off the base."""
    X = columns * size
    X = X - base @ (base.T @ X)
    U, d, _ = np.linalg.svd(X, full_matrices=False)
    keep = (d > _FLAT * max(d[0], 1e-300)) & (d > _BLIND)
    return Group(owner, X, U[:, keep], tuple(one_sided))


def statistics(groups, Y: np.ndarray) -> np.ndarray:
    """``T`` of every group for every column of ``Y`` (n, draws): (groups, draws); 0 for a one-sided group of the wrong sign."""
    out = np.zeros((len(groups), Y.shape[1]))
    for g, group in enumerate(groups):
        if not group.rank:
            continue
        z = group.Q.T @ Y
        out[g] = np.sum(z**2, axis=0)
        if len(group.one_sided) == 1 and group.one_sided[0]:
            out[g] *= group.X[:, 0] @ Y > 0
    return out


def log_p(T: np.ndarray, rank: np.ndarray, one_sided=None) -> np.ndarray:
    """``-log p`` of chi-squared statistics."""
    rank = np.maximum(rank, 1)
    rank = rank[:, None] if T.ndim > 1 else rank
    with np.errstate(divide="ignore"):
        return -np.log(special.chdtrc(rank, T))


@dataclass(frozen=True)
class Test:
    """Global p-value, the p-value of each group (adjusted for multiple testing), and the statistics."""

    p_value: float
    adjusted: np.ndarray
    T: np.ndarray
    best: int
    family_gain: dict[str, float]


def global_test(groups, families, y: np.ndarray, draws: np.ndarray, freedom: int) -> Test:
    """Max-T over groups and discrepancy fields; ``draws`` (n, B) is noise, whitened and projected like ``y``.

    ``families`` maps a name to a function of (n, B) giving log evidence gains (B,).
    """
    rank = np.array([g.rank for g in groups])
    both = np.column_stack([y, draws])
    scale = np.maximum(np.sum(both**2, axis=0) / freedom, 1.0)  # a residual below the noise is not significant
    both = both / np.sqrt(scale)
    T = statistics(groups, both)
    strength = np.where(rank[:, None] > 0, log_p(T, rank), 0.0)
    top = strength.max(axis=0)
    gains = {name: f(both) for name, f in families.items()}
    # ranks of each statistic among the draws, then the best rank of all: one calibrated p-value
    statistics_all = [top, *([np.max(list(gains.values()), axis=0)] if gains else [])]
    ranks = np.array([_exceedance(s) for s in statistics_all])
    best = ranks.min(axis=0)
    p = float((1 + np.sum(best[1:] <= best[0])) / len(best))
    adjusted = np.array([(1 + np.sum(top[1:] >= s)) / len(top) for s in strength[:, 0]])
    return Test(p, adjusted, T[:, 0], int(np.argmax(strength[:, 0])), {n: float(g[0]) for n, g in gains.items()})


def _exceedance(s):
    """For each entry the fraction of entries that are as large."""
    order = np.sort(s)
    return 1.0 - np.searchsorted(order, s, side="left") / len(s)
