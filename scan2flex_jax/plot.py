"""Pictures of a fit, on matplotlib axes that they take and return."""

import matplotlib.pyplot as plt
import numpy as np

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
