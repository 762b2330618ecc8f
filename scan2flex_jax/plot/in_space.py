"""Shapes in space: measured and modelled curves of a pose, with the supports and the effects where they sit."""

from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.geometry.curves import arc_length
from scan2flex_jax.plot.style import BEFORE, BROADEST, MEASURED, MODELLED, PALE, chosen, legend, named, spaced
from scan2flex_jax.study.sense import SUPPORTS

if TYPE_CHECKING:  # for annotations only: drawing needs no import of these types
    from scan2flex_jax.inference import Explanation, Fit
    from scan2flex_jax.study import Study

IN_SPACE: dict[str, Any] = {"aspect": "equal", "adjustable": "datalim", "xlabel": "across (m)", "ylabel": "up (m)"}
_POINT, _ARROW = 0.01, 0.15  # of the length: a narrower span is drawn as a point; length of the arrow of a force


def shapes(fit: "Fit | Explanation", pose: str | None = None, ax: Axes | None = None) -> Axes:
    """Measured and modelled centre curves of one pose, or of all, in the plane that shows them best (m).

    For one pose of an explanation with an added effect, the curve of the baseline model is drawn too, and the effect where it
    sits: a span as a broad line, a mass or a bend as a mark, a force with its arrow, stiffness that varies as the line's width.
    """
    ax = plt.subplots()[1] if ax is None else ax
    names = chosen(fit, pose)
    seen = {name: seen_points(fit, name) for name in names}
    shown = [x if len(x) else fit.poses[name].modelled for name, x in seen.items()]
    axes = plane(np.concatenate(shown), fit.study)
    before = _before(fit) if pose is not None else None
    for i, name in enumerate(names):
        p, colour = fit.poses[name], MODELLED if pose is not None else f"C{i % 10}"
        if before is not None and before.poses[name].stable:
            ax.plot(*(before.poses[name].modelled @ axes.T).T, color=BEFORE, label="before", **PALE)
        ax.plot(*(seen[name] @ axes.T).T, ls="", marker="o", ms=3, mew=0, color=MEASURED, label="measured" if i == 0 else None)
        if p.stable:
            ax.plot(*(p.modelled @ axes.T).T, color=colour, lw=1.5, label=_modelled_as(fit, name, pose))
            if before is not None:
                _in_place(ax, fit, p.modelled, axes)
    for i, name in enumerate(names):
        _supports(ax, fit.study, name, axes, label=i == 0)
    ax.set(**IN_SPACE)
    rows = legend(ax)
    if pose is not None:
        off = f": {1e3 * p.rms:.3g} mm RMS" if len(p.s) else ""
        ax.set_title(named(pose, f" ({p.role}){off}"), fontsize=10, pad=8 + 13 * rows)
    return ax


def _in_place(ax, explanation, curve, axes):
    """The effects that were found, on the curve (n, 3) of one pose."""
    if explanation.along is not None:
        as_broad(ax, curve @ axes.T, explanation.along, None)
    length = arc_length(curve, np)[-1]
    for i, r in enumerate(explanation.chosen):
        place, width = r.parameters.get("position"), float(r.parameters.get("width", 0.0))
        if place is None:
            continue
        label = f"{spaced(r.kind)} at {float(place):.3g} m"
        s = np.linspace(max(place - 0.5 * width, 0.0), min(place + 0.5 * width, length), 25)
        x, y = (_places(curve, s) @ axes.T).T
        if width > _POINT * length:
            ax.plot(x, y, color=f"C{i}", lw=BROADEST, alpha=0.45, solid_capstyle="butt", label=label)
        else:
            ax.plot(x[12], y[12], ls="", marker="D", ms=BROADEST, mfc="none", mec=f"C{i}", mew=1.8, label=label)
        force = r.parameters.get("force")
        if force is not None and np.linalg.norm(force) > 0:
            tip = _ARROW * length * axes @ np.asarray(force) / np.linalg.norm(force)
            arrow = {"arrowstyle": "->", "color": f"C{i}", "lw": 1.8}
            ax.annotate("", (x[12] + tip[0], y[12] + tip[1]), (x[12], y[12]), arrowprops=arrow, annotation_clip=False)


def _supports(ax, study, pose, axes, label):
    """Triangles at the supports of a pose."""
    held = [e.parameters["anchor"] for e in study.acting(study.pose(pose)) if e.kind in SUPPORTS and "anchor" in e.parameters]
    if held:
        x, y = axes @ np.transpose(held)
        ax.plot(x, y, ls="", marker="^", ms=BROADEST, mfc="none", mec=MEASURED, label="supports" if label else None)


def measured(study: "Study", pose: str, ax: Axes | None = None) -> Axes:
    """Measured centre curve of one pose without a solve, in the plane that shows it best (m)."""
    ax = plt.subplots()[1] if ax is None else ax
    curve = study.pose(pose).curve
    if curve is None:
        raise Scan2FlexError(f"pose {pose!r} has no centre curve to draw")
    axes = plane(curve.points, study)
    ax.plot(*(curve.points @ axes.T).T, ls="", marker="o", ms=3, mew=0, color=MEASURED, label="measured")
    ax.set(**IN_SPACE)
    ax.set_title(named(pose), fontsize=10, pad=22)
    legend(ax)
    return ax


def seen_points(fit, name):
    """Measured points of a pose (m); coordinates that were not measured are those of the model at the same arc length."""
    p, markers = fit.poses[name], fit.study.pose(name).markers
    if markers is None or markers.measured == "xyz" or not p.stable or len(p.measured) != len(markers.points):
        return p.measured
    known = np.array([axis in markers.measured for axis in "xyz"])
    return np.where(known, p.measured, _places(p.modelled, p.s))


def _places(curve, s):
    """The points of a curve at arc lengths."""
    return np.stack([np.interp(s, arc_length(curve, np), x) for x in curve.T], axis=1)


def _modelled_as(fit, name, pose):
    if pose is None:
        return named(name)
    return "modelled" if _before(fit) is None else "after"


def _before(fit) -> "Fit | None":
    """The baseline fit of an explanation that added an effect."""
    return fit.fit if getattr(fit, "chosen", None) else None


def plane(points: np.ndarray, study: "Study") -> np.ndarray:
    """Two unit vectors (rows): across, the horizontal direction of largest spread, and up (against gravity)."""
    gravity = np.asarray(study.gravity)
    size = np.linalg.norm(gravity)
    up = -gravity / size if size > 0 else np.array([0.0, 0.0, 1.0])
    level = points - points.mean(0)
    level = level - np.outer(level @ up, up)
    across = np.linalg.svd(level, full_matrices=False)[2][0]
    across = across - (across @ up) * up
    across = across / np.linalg.norm(across)
    across = across if across[np.argmax(np.abs(across))] > 0 else -across
    return np.stack([across, up])


def as_broad(ax, curve, along, label):
    """A curve as broad as it is stiff: with the fourth root, as the diameter of a solid section."""
    at = np.linspace(0.0, 2.0 * along.s[-1] - along.s[-2], len(curve))
    root = along.at(0.5 * (at[1:] + at[:-1]))[0] ** 0.25
    steps = list(np.stack([curve[:-1], curve[1:]], axis=1))
    pieces = LineCollection(steps, linewidths=BROADEST * root / root.max(), colors=MODELLED)
    pieces.set(label=label, capstyle="round")
    ax.add_collection(pieces)
