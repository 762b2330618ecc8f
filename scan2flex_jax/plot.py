"""Pictures of a fit, an explanation, a sweep, on matplotlib axes that they take and return.

Each takes its subject, then what to show of it, then axes: `shapes`, `errors`, `residual`, `evidence`, `load`, `basins`. Axes
left out are made. `overview` and `explained` are whole figures of them; `save` writes one. The page of `report` shows the same
with plotly.
"""

import io
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study.names import drawn
from scan2flex_jax.study.outputs import write_file

if TYPE_CHECKING:  # nothing of what is drawn has to be loaded to draw it
    import xarray

    from scan2flex_jax.diagnosis import Explanation
    from scan2flex_jax.fitting import Fit

_MEASURED, _MODELLED = "#888888", "#c1272d"


def shapes(fit: "Fit | Explanation", pose: str | None = None, ax: Axes | None = None) -> Axes:
    """Measured and modelled centre curves of one pose, or of all, in the plane that shows them best (m)."""
    ax = plt.subplots()[1] if ax is None else ax
    names = list(fit.poses) if pose is None else [pose]
    if pose is not None and pose not in fit.poses:
        raise Scan2FlexError(f"no pose is called {pose!r}: the poses are {', '.join(fit.poses)}")
    axes, labels = _plane(np.concatenate([fit.poses[name].measured for name in names]), np.asarray(fit.study.gravity))
    for i, name in enumerate(names):
        p, colour = fit.poses[name], _MODELLED if pose is not None else f"C{i % 10}"
        flat = p.measured @ axes.T
        ax.plot(flat[:, 0], flat[:, 1], ls="", marker="o", ms=3, color=_MEASURED, label="measured" if i == 0 else None)
        if p.stable:
            flat = p.modelled @ axes.T
            ax.plot(flat[:, 0], flat[:, 1], color=colour, lw=1.5, label=drawn("modelled" if pose is not None else name))
    ax.set_aspect("equal", adjustable="datalim")
    ax.set(xlabel=labels[0], ylabel=labels[1])
    if pose is not None:
        ax.set_title(drawn(f"{pose} ({p.role}): {1e3 * p.rms:.2f} mm RMS"), fontsize=10)
    ax.legend(frameon=False, fontsize=8)
    return ax


def errors(fit: "Fit | Explanation", ax: Axes | None = None) -> Axes:
    """Distance between measured and modelled curve along the cable, per pose (the paper's Fig. 4)."""
    ax = plt.subplots()[1] if ax is None else ax
    for name, p in fit.poses.items():
        if np.isfinite(p.rms):
            order = np.argsort(p.s)
            distance = 1e3 * np.linalg.norm(p.residual, axis=1)
            ax.plot(p.s[order], distance[order], "-" if p.role == "fit" else "--", lw=1.2, label=drawn(f"{name} ({p.role})"))
    ax.set(xlabel="arc length s (m)", ylabel="distance (mm)", ylim=(0, None))
    ax.legend(frameon=False, fontsize=8)
    return ax


def overview(fit: "Fit | Explanation") -> Figure:
    """A figure with every pose and the errors along the cable."""
    names = list(fit.poses)
    columns = min(3, len(names))
    rows = -(-len(names) // columns) + 1
    figure = plt.figure(figsize=(4.2 * columns, 3.6 * rows), layout="constrained")
    grid = figure.add_gridspec(rows, columns)
    for i, name in enumerate(names):
        shapes(fit, name, figure.add_subplot(grid[i // columns, i % columns]))
    errors(fit, figure.add_subplot(grid[rows - 1, :]))
    figure.suptitle(drawn(fit.study.title), wrap=True, fontsize=11)
    return figure


def save(figure: Figure, file: str | Path, dpi: float = 150, write: Callable[[Path, bytes], object] = write_file) -> None:
    """Write a figure to a file of the format that its name says, in one step: a reader sees the old or the new, whole.

    A study's own files are refused. ``write(path, bytes)`` puts the picture there.
    """
    path, picture = Path(file), io.BytesIO()
    kinds = figure.canvas.get_supported_filetypes()
    kind = path.suffix.lstrip(".").lower() or "png"
    if kind not in kinds:
        raise Scan2FlexError(f"{path.name} is no kind of picture: name a file that ends in .png, .svg or .pdf")
    figure.savefig(picture, format=kind, dpi=dpi)
    write(path if path.suffix else path.with_suffix(".png"), picture.getvalue())


def _plane(points, gravity):
    """Two unit vectors (rows): across, the horizontal direction of largest spread, and up (against gravity)."""
    size = np.linalg.norm(gravity)
    up = -gravity / size if size > 0 else np.array([0.0, 0.0, 1.0])
    level = points - points.mean(0)
    level = level - np.outer(level @ up, up)
    across = np.linalg.svd(level, full_matrices=False)[2][0]
    across = across - (across @ up) * up
    across = across / np.linalg.norm(across)
    across = across if across[np.argmax(np.abs(across))] > 0 else -across
    return np.stack([across, up]), ("across (m)", "up (m)")


def residual(explanation: "Explanation", pose: str | None = None, ax: Axes | None = None) -> Axes:
    """What is left along s (mm), before and after: of one pose both normal components over the 95 % band of the noise, of all
    poses (no ``pose``) the distances."""
    ax = plt.subplots()[1] if ax is None else ax
    if explanation.noise is None:
        raise Scan2FlexError("nothing was solved: there is no residual to draw")
    if pose is None:
        return _residuals(explanation, ax)
    if pose not in explanation.poses:
        raise Scan2FlexError(f"no pose is called {pose!r}: the poses are {', '.join(explanation.poses)}")
    p = explanation.poses[pose]
    order = np.argsort(p.s)
    s = p.s[order]
    band = 1.96e3 * explanation.noise.total
    ax.fill_between([s[0], s[-1]], -band, band, color="#dddddd", lw=0, label="95 % of the noise")
    for k, style in enumerate(("-", "--")):
        ax.plot(s, 1e3 * p.residual_before[order, k], style, color=_MEASURED, lw=1.2, label="before" if k == 0 else None)
        ax.plot(s, 1e3 * p.residual[order, k], style, color=_MODELLED, lw=1.2, label="after" if k == 0 else None)
    ax.set(xlabel="arc length s (m)", ylabel="residual (mm)")
    ax.set_title(drawn(f"{pose} ({p.role}): {1e3 * p.rms_before:.2f} to {1e3 * p.rms:.2f} mm"), fontsize=10)
    ax.legend(frameon=False, fontsize=8)
    return ax


def _residuals(explanation, ax):
    """Distances of all poses along s (mm): thin before, thick after."""
    for i, (name, p) in enumerate(explanation.poses.items()):
        order, colour = np.argsort(p.s), f"C{i % 10}"
        for values, width, label in ((p.residual_before, 0.7, None), (p.residual, 1.6, drawn(f"{name} ({p.role})"))):
            distance = 1e3 * np.linalg.norm(values[order], axis=1)
            ax.plot(p.s[order], distance, "-" if p.role == "fit" else "--", lw=width, color=colour, label=label)
    ax.set(xlabel="arc length s (m)", ylabel="distance (mm), thin before, thick after", ylim=(0, None))
    ax.legend(frameon=False, fontsize=8)
    return ax


def evidence(explanation: "Explanation", ax: Axes | None = None, most: int = 10) -> Axes:
    """Log evidence of the likeliest kinds over the plain rod (nats), coloured by verdict."""
    ax = plt.subplots()[1] if ax is None else ax
    rows = explanation.ranking[:most][::-1]
    colours = {"named": _MODELLED, "favoured": _MODELLED, "tied": "#e5989b"}
    # refits of absent kinds may be far below zero: what is worse than nothing is not told apart
    lengths = [max(r.log_evidence, -5.0) for r in rows]
    ax.barh([r.kind.replace("_", " ") for r in rows], lengths, color=[colours.get(r.verdict, "#bbbbbb") for r in rows])
    for i, r in enumerate(rows):
        ax.annotate(f" {explanation.in_words(r)}", (max(lengths[i], 0.0), i), va="center", fontsize=8)
    ax.axvline(0.0, color="k", lw=0.8)
    low, high = ax.get_xlim()
    ax.set(xlim=(low, low + 1.7 * (high - low)), xlabel="log evidence over the plain rod (nats)")  # the words need room
    return ax


def load(explanation: "Explanation", ax: Axes | None = None) -> Axes:
    """The equivalent load (N/m, scan frame) that all poses share, with its 95 % band: where something acts, not what."""
    ax = plt.subplots()[1] if ax is None else ax
    f = explanation.load
    if f is None:
        raise Scan2FlexError("nothing was solved: there is no load to draw")
    for k, (name, colour) in enumerate(zip("xyz", ("#c1272d", "#2d7d46", "#2b5c9e"), strict=True)):
        mean, band = f.mean[:, k], 1.96 * f.std[:, k]
        ax.plot(f.s, mean, color=colour, lw=1.5, label=name)
        ax.fill_between(f.s, mean - band, mean + band, color=colour, alpha=0.15, lw=0)
    ax.axhline(0.0, color="k", lw=0.8)
    ax.set(xlabel="arc length s (m)", ylabel="equivalent load (N/m)")
    ax.legend(frameon=False, fontsize=8)
    return ax


def explained(explanation: "Explanation") -> Figure:
    """A figure with the evidence, the equivalent load, and every pose's residual before and after."""
    names = list(explanation.poses)
    columns = min(3, max(2, len(names)))
    rows = -(-len(names) // columns) + 1
    figure = plt.figure(figsize=(4.6 * columns, 3.2 * rows), layout="constrained")
    grid = figure.add_gridspec(rows, columns)
    evidence(explanation, figure.add_subplot(grid[0, : columns - 1]))
    load(explanation, figure.add_subplot(grid[0, columns - 1]))
    for i, name in enumerate(names):
        residual(explanation, name, figure.add_subplot(grid[1 + i // columns, i % columns]))
    figure.suptitle(drawn(f"{explanation.study.title}: {explanation.verdict}"), wrap=True, fontsize=11)
    return figure


def basins(sweep: "xarray.Dataset", ax: Axes | None = None, most: int = 5, within: float = 0.01) -> Axes:
    """Where the fits of a sweep over two guesses ended: one colour for each end (estimates alike ``within`` that share),
    by its cost, at most ``most`` of them; crosses where a fit failed, nothing where none was run yet."""
    ax = plt.subplots()[1] if ax is None else ax
    across, up = sweep.attrs["lane_dims"].split()[::-1]
    names = [dim.removeprefix("guess_") for dim in (up, across)]
    found = [sweep[name].transpose(up, across).values for name in names]
    end, sizes = _ends(np.log(np.stack(found)), sweep["cost"].transpose(up, across).values, most, within)
    colours = [*([_MODELLED, "#2b5c9e", "#2d7d46", "#d99a2b", "#7b4b94", "#4aa3a3"][:most]), "#cccccc"]
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
    """Which end each lane reached (the cheapest first, ``most`` for all others, -1 for none), and how many reached each."""
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
    """Edges of cells around positive values, in the middle of their logarithms."""
    logs = np.log(values)
    middle = 0.5 * (logs[1:] + logs[:-1])
    return np.exp(np.r_[2 * logs[0] - middle[0], middle, 2 * logs[-1] - middle[-1]])


def _guessed(sweep, dim):
    """Label of an axis of guesses."""
    return f"guess of {dim.removeprefix('guess_').replace('_', ' ')} ({sweep[dim].attrs['units']})"
