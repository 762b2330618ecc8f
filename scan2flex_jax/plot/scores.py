"""Solutions and hypotheses beside each other: their scores, correlations, the effects to expect, and basins of attraction."""

from typing import TYPE_CHECKING

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes

from scan2flex_jax.names import drawn
from scan2flex_jax.plot.style import MEASURED, MODELLED, legend, spaced

if TYPE_CHECKING:  # for annotations only: drawing needs no import of these types
    import xarray

    from scan2flex_jax.inference import Expectation, Explanation, Fit

_HARDLY_SEEN = 100.0  # usual sizes: an effect that needs more is drawn there


def comparison(explanation: "Explanation", ax: Axes | None = None, most: int = 10) -> Axes:
    """Hypotheses by their log predictive density of poses left out, over that without effects (nats), each with the standard
    error of the difference, as `arviz.plot_compare` draws models; of a single pose, by their log evidence.

    Hollow: effect types that were not refitted, by their gain to first order.
    """
    ax = plt.subplots()[1] if ax is None else ax
    rows = [h for h in explanation.hypotheses if h.kinds][:most]
    gain = [h.elpd if np.isfinite(h.elpd) else h.log_evidence for h in rows]
    tried = {kind for h in explanation.hypotheses for kind in h.kinds}
    rest = [r for r in explanation.ranking if r.kind not in tried][: most - len(rows)]
    names = [h.name if h.variant == "as stated" else f"{h.name} ({h.variant})" for h in rows] + [spaced(r.kind) for r in rest]
    for i, (h, x) in enumerate(zip(rows, gain, strict=True)):
        colour = {"best": MODELLED, "tied": "#e5989b"}.get(h.relation, MEASURED)
        ax.errorbar(x, i, xerr=h.elpd_std if np.isfinite(h.elpd) else None, fmt="o", color=colour, capsize=3, ms=6)
        if h.relation in ("best", "tied"):
            ax.annotate(h.relation, (x, i), (0, 7), textcoords="offset points", ha="center", fontsize=8, color=colour)
    for i, r in enumerate(rest, len(rows)):  # absent effect types may lie far below zero: they are not resolved there
        label = "not refitted, to first order" if i == len(rows) else None
        ax.plot(max(r.log_evidence, -5.0), i, "o", mfc="none", color=MEASURED, ms=5, label=label)
    ax.axvline(0.0, color="k", lw=0.8)
    ax.set_yticks(range(len(names)), names)
    score = "log predictive density" if any(np.isfinite(h.elpd) for h in rows) else "log evidence"
    ax.set_ylim(len(names) - 0.3, -0.9)
    ax.set_xlabel(f"{score} over no effect (nats)", loc="right")  # long names leave little room below the axes
    if rest:
        legend(ax)
    return ax


def correlations(fit: "Fit", ax: Axes | None = None) -> Axes:
    """Correlations of the estimated parameters, with their values; blank if undefined."""
    ax = plt.subplots()[1] if ax is None else ax
    names = [drawn(label.replace("_", " ")) for label in fit.labels]
    ax.imshow(np.where(np.isfinite(fit.correlation), fit.correlation, 0.0), vmin=-1, vmax=1, cmap="coolwarm", alpha=0.7)
    for (i, j), value in np.ndenumerate(fit.correlation):
        ax.text(j, i, f"{value:+.2f}" if np.isfinite(value) else "", ha="center", va="center", fontsize=8)
    ax.set_xticks(range(len(names)), names, rotation=20, ha="right", fontsize=8)
    ax.set_yticks(range(len(names)), names, fontsize=8)
    return ax


def expected(expectation: "Expectation", ax: Axes | None = None) -> Axes:
    """The smallest effects that poses would find, over their usual size: what lies left of 1 is worth looking for."""
    ax = plt.subplots(figsize=(6.4, 5.6), layout="constrained")[1] if ax is None else ax
    sizes = [min(v.size, _HARDLY_SEEN) for v in expectation.effects]
    colours = [MODELLED if size <= 1.0 else MEASURED for size in sizes]
    ax.hlines(range(len(sizes)), min(sizes), sizes, color=colours, lw=1.0, alpha=0.4)
    ax.scatter(sizes, range(len(sizes)), color=colours, s=28, zorder=3)
    ax.axvline(1.0, color="k", lw=0.8)
    ax.set_yticks(range(len(sizes)), [spaced(v.kind) for v in expectation.effects], fontsize=8)
    ax.set(xscale="log", xlabel="smallest effect that would be found, over its usual size", ylim=(len(sizes) - 0.3, -0.7))
    return ax


def basins(sweep: "xarray.Dataset", ax: Axes | None = None, most: int = 5, within: float = 0.01) -> Axes:
    """Basins of attraction of a sweep of fits over two guesses: one colour per solution (estimates equal to within the fraction
    ``within``), ordered by cost, at most ``most``; crosses mark failed fits, and fits not yet run are blank."""
    ax = plt.subplots()[1] if ax is None else ax
    across, up = map(str, sweep["code"].dims[::-1])
    names = [dim.removeprefix("guess_") for dim in (up, across)]
    found = [sweep[name].transpose(up, across).values for name in names]
    end, sizes = _ends(np.log(np.stack(found)), sweep["cost"].transpose(up, across).values, most, within)
    colours = [*([MODELLED, "#2b5c9e", "#2d7d46", "#d99a2b", "#7b4b94", "#4aa3a3"][:most]), "#cccccc"]
    x, y = (_log_edges(sweep[dim].values) for dim in (across, up))
    ax.pcolormesh(x, y, np.ma.masked_less(end, 0), cmap=mpl.colors.ListedColormap(colours), vmin=-0.5, vmax=most + 0.5)
    row, column = np.nonzero((end < 0) & (sweep["code"].transpose(up, across).values > 0))  # below 0: not run
    ax.plot(sweep[across].values[column], sweep[up].values[row], "kx", ms=3, lw=0)
    handles = []
    for k, size in enumerate(sizes):
        if size:
            values = [v[end == k][0] for v in found]
            label = f"{values[0]:.3g}, {values[1]:.3g}" if k < most else "elsewhere"
            handles.append(mpl.patches.Patch(color=colours[k], label=f"{label} ({size})"))
    ax.set(xscale="log", yscale="log", xlabel=_guessed(sweep, across), ylabel=_guessed(sweep, up))
    ax.legend(handles=handles, frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return ax


def _ends(logs, cost, most, within):
    """The solution reached from each start (cheapest first, ``most`` for all others, -1 for none), and the number of starts."""
    end = np.full(cost.shape, -1)
    solved = np.isfinite(cost) & np.all(np.isfinite(logs), axis=0)
    groups, left = [], solved.copy()
    while left.any():
        seed = np.unravel_index(np.argmin(np.where(left, cost, np.inf)), cost.shape)
        group = left & (np.max(np.abs(logs - logs[(slice(None), *seed)][:, None, None]), axis=0) < within)
        groups.append(group)
        left &= ~group
    first, others = groups[:1], sorted(groups[1:], key=lambda g: -g.sum())
    for k, group in enumerate(first + others):
        end[group] = min(k, most)
    return end, [int(np.sum(end == k)) for k in range(most + 1)]


def _log_edges(values):
    """Edges of cells around positive values, midway between their logarithms."""
    logs = np.log(values)
    middle = 0.5 * (logs[1:] + logs[:-1])
    return np.exp(np.r_[2 * logs[0] - middle[0], middle, 2 * logs[-1] - middle[-1]])


def _guessed(sweep, dim):
    """Label of an axis of guesses."""
    return f"guess of {dim.removeprefix('guess_').replace('_', ' ')} ({sweep[dim].attrs['units']})"
