"""Pictures of a fit, on matplotlib axes that they take and return."""

import io
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study.files import write_atomic

_MEASURED, _MODELLED = "#888888", "#c1272d"


def shapes(fit, pose: str, ax=None):
    """Measured and modelled centre curve of one pose, in the plane that shows it best (m)."""
    ax = plt.subplots()[1] if ax is None else ax
    p = fit.poses[pose]
    axes, labels = _plane(p.measured, np.asarray(fit.study.gravity))
    for curve, style, label in ((p.measured, {"ls": "", "marker": "o", "ms": 3, "color": _MEASURED}, "measured"),
                                (p.modelled, {"color": _MODELLED, "lw": 1.5}, "modelled")):  # fmt: skip
        flat = curve @ axes.T
        ax.plot(flat[:, 0], flat[:, 1], label=label, **style)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set(xlabel=labels[0], ylabel=labels[1])
    ax.set_title(f"{pose} ({p.role}): {1e3 * p.rms:.2f} mm RMS".replace("$", r"\$"), fontsize=10)
    ax.legend(frameon=False, fontsize=8)
    return ax


def errors(fit, ax=None):
    """Distance between measured and modelled curve along the cable, per pose (the paper's Fig. 4)."""
    ax = plt.subplots()[1] if ax is None else ax
    for name, p in fit.poses.items():
        if np.isfinite(p.rms):
            order = np.argsort(p.s)
            distance = 1e3 * np.linalg.norm(p.residual, axis=1)
            ax.plot(p.s[order], distance[order], "-" if p.role == "fit" else "--", lw=1.2, label=f"{name} ({p.role})")
    ax.set(xlabel="arc length s (m)", ylabel="distance (mm)", ylim=(0, None))
    ax.legend(frameon=False, fontsize=8)
    return ax


def overview(fit):
    """A figure with every pose and the errors along the cable."""
    names = list(fit.poses)
    columns = min(3, len(names))
    rows = -(-len(names) // columns) + 1
    figure = plt.figure(figsize=(4.2 * columns, 3.6 * rows), layout="constrained")
    grid = figure.add_gridspec(rows, columns)
    for i, name in enumerate(names):
        shapes(fit, name, figure.add_subplot(grid[i // columns, i % columns]))
    errors(fit, figure.add_subplot(grid[rows - 1, :]))
    figure.suptitle(fit.study.title.replace("$", r"\$"), wrap=True, fontsize=11)
    return figure


def save(figure, file, dpi=150) -> None:
    """Write a figure to a file of the format that its name says, in one step: a reader sees the old or the new, whole."""
    file, picture = Path(file), io.BytesIO()
    kinds = figure.canvas.get_supported_filetypes()
    kind = file.suffix.lstrip(".").lower() or "png"
    if kind not in kinds:
        raise Scan2FlexError(f"{file.name} is no kind of picture: name a file that ends in .png, .svg or .pdf")
    figure.savefig(picture, format=kind, dpi=dpi)
    write_atomic(file if file.suffix else file.with_suffix(".png"), picture.getvalue())


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


def residual(explanation, pose: str, ax=None):
    """Both normal components of one pose's residual along s (mm), before and after, over the 95 % band of the noise."""
    ax = plt.subplots()[1] if ax is None else ax
    p = explanation.poses[pose]
    order = np.argsort(p.s)
    s = p.s[order]
    band = 1.96e3 * explanation.noise.total
    ax.fill_between([s[0], s[-1]], -band, band, color="#dddddd", lw=0, label="95 % of the noise")
    for k, style in enumerate(("-", "--")):
        ax.plot(s, 1e3 * p.residual_before[order, k], style, color=_MEASURED, lw=1.2, label="before" if k == 0 else None)
        ax.plot(s, 1e3 * p.residual[order, k], style, color=_MODELLED, lw=1.2, label="after" if k == 0 else None)
    ax.set(xlabel="arc length s (m)", ylabel="residual (mm)")
    ax.set_title(f"{pose} ({p.role}): {1e3 * p.rms_before:.2f} to {1e3 * p.rms:.2f} mm".replace("$", r"\$"), fontsize=10)
    ax.legend(frameon=False, fontsize=8)
    return ax


def evidence(explanation, ax=None, most: int = 10):
    """Log evidence of the likeliest kinds over the plain rod (nats), coloured by verdict."""
    ax = plt.subplots()[1] if ax is None else ax
    rows = explanation.ranking[:most][::-1]
    colours = {"named": _MODELLED, "favoured": _MODELLED, "tied": "#e5989b"}
    # refits of absent kinds may be far below zero: what is worse than nothing is not told apart
    lengths = [max(r.log_evidence, -5.0) for r in rows]
    ax.barh([r.kind.replace("_", " ") for r in rows], lengths, color=[colours.get(r.verdict, "#bbbbbb") for r in rows])
    for i, r in enumerate(rows):
        ax.annotate(f" {r.verdict}", (max(lengths[i], 0.0), i), va="center", fontsize=8)
    ax.axvline(0.0, color="k", lw=0.8)
    ax.margins(x=0.18)
    ax.set(xlabel="log evidence over the plain rod (nats)")
    return ax


def load(explanation, ax=None):
    """The equivalent load (N/m, scan frame) that all poses share, with its 95 % band: where something acts, not what."""
    ax = plt.subplots()[1] if ax is None else ax
    f = explanation.load
    for k, (name, colour) in enumerate(zip("xyz", ("#c1272d", "#2d7d46", "#2b5c9e"), strict=True)):
        mean, band = f.mean[:, k], 1.96 * f.std[:, k]
        ax.plot(f.s, mean, color=colour, lw=1.5, label=name)
        ax.fill_between(f.s, mean - band, mean + band, color=colour, alpha=0.15, lw=0)
    ax.axhline(0.0, color="k", lw=0.8)
    ax.set(xlabel="arc length s (m)", ylabel="equivalent load (N/m)")
    ax.legend(frameon=False, fontsize=8)
    return ax


def explained(explanation):
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
    title = f"{explanation.study.title}: {explanation.verdict}"
    figure.suptitle(title.replace("$", r"\$"), wrap=True, fontsize=11)
    return figure
