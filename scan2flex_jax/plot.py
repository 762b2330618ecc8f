"""Plots of a fit, an explanation or a sweep, on matplotlib axes that each function takes and returns.

Arguments are the object, the part of it to show, then the axes (created by default): `shapes`, `errors`, `residual`,
`comparison`, `load`, `law`, `stiffness`, `basins`, `expected`. `overview`, `explained` and `varied` are whole figures;
`save` writes one. The page of `report` uses the same plots. The state before is drawn broad and pale under the state after;
legends stand above the axes.
"""

import io
import textwrap
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.names import drawn
from scan2flex_jax.study.outputs import write_file
from scan2flex_jax.study.sense import SUPPORTS

if TYPE_CHECKING:  # for annotations only: drawing needs no import of these types
    import xarray

    from scan2flex_jax.inference import Expectation, Explanation, Fit
    from scan2flex_jax.study import Study

Beside = Mapping[str, tuple[np.ndarray, np.ndarray]]
MEASURED, BAND, _MODELLED, _BEFORE = "#555d66", "#dddddd", "#c1272d", "#e9a13b"
_PALE: dict[str, Any] = {"lw": 4.0, "alpha": 0.55, "solid_capstyle": "round"}  # before, under a thin line of after
_EVEN = "nothing lets the stiffness vary along this cable: there is no stiffness to draw"
_BROADEST = 7.0  # points: a line where the cable is stiffest
_POINT, _ARROW = 0.01, 0.15  # of the length: a narrower span is drawn as a point; length of the arrow of a force
_DECADES = 5.0  # largest over smallest stiffness from which on it is drawn in logarithms
_HARDLY_SEEN = 100.0  # usual sizes: an effect that needs more is drawn there
_TANGLE = 4  # largest number of poses whose lines can be distinguished in one panel
_COLUMNS = 3  # of panels in a figure, and of a legend
_BETWEEN = 0.12  # inches above and below a panel: a panel's title is not taken for the label of the axis above it
_TITLE = 10  # characters of a figure's title per inch of its width
_ROW, _HANDLE, _LONGEST = 64, 6, 28  # characters of a row of a legend, of a line in it, and of the name of a pose


def _legend(ax):
    """A legend above the axes, off the data, in as many columns as fit; its number of rows, 0 without labels."""
    labels = ax.get_legend_handles_labels()[1]
    if not labels:
        return 0
    columns = int(np.clip(_ROW // (max(map(len, labels)) + _HANDLE), 1, _COLUMNS))
    ax.legend(frameon=False, fontsize=8, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.2, ncols=columns)
    return -(-len(labels) // columns)


def _named(name, words=""):
    """A pose name with words appended, shortened to the width of a panel."""
    return drawn((name if len(name) <= _LONGEST else f"{name[:_LONGEST]}...") + words)


def shapes(fit: "Fit | Explanation", pose: str | None = None, ax: Axes | None = None) -> Axes:
    """Measured and modelled centre curves of one pose, or of all, in the plane that shows them best (m).

    For one pose of an explanation with an added effect, the curve of the baseline model is drawn too, and the effect where it
    sits: a span as a broad line, a mass or a bend as a mark, a force with its arrow, stiffness that varies as the line's width.
    """
    ax = plt.subplots()[1] if ax is None else ax
    names = list(fit.poses) if pose is None else [pose]
    if pose is not None and pose not in fit.poses:
        raise Scan2FlexError(f"no pose is called {pose!r}: the poses are {', '.join(fit.poses)}")
    seen = {name: _seen(fit, name) for name in names}
    shown = [x if len(x) else fit.poses[name].modelled for name, x in seen.items()]
    axes, labels = _plane(np.concatenate(shown), np.asarray(fit.study.gravity))
    before = _before(fit) if pose is not None else None
    for i, name in enumerate(names):
        p, colour = fit.poses[name], _MODELLED if pose is not None else f"C{i % 10}"
        if before is not None and before.poses[name].stable:
            ax.plot(*(before.poses[name].modelled @ axes.T).T, color=_BEFORE, label="before", **_PALE)
        ax.plot(*(seen[name] @ axes.T).T, ls="", marker="o", ms=3, mew=0, color=MEASURED, label="measured" if i == 0 else None)
        if p.stable:
            ax.plot(*(p.modelled @ axes.T).T, color=colour, lw=1.5, label=_modelled_as(fit, name, pose))
            if before is not None:
                _in_place(ax, fit, p.modelled, axes)
    for i, name in enumerate(names):
        _supports(ax, fit.study, name, axes, label=i == 0)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set(xlabel=labels[0], ylabel=labels[1])
    rows = _legend(ax)
    if pose is not None:
        off = f": {1e3 * p.rms:.3g} mm RMS" if len(p.s) else ""
        ax.set_title(_named(pose, f" ({p.role}){off}"), fontsize=10, pad=8 + 13 * rows)
    return ax


def _in_place(ax, explanation, curve, axes):
    """The effects that were found, on the curve (n, 3) of one pose."""
    if explanation.along is not None:
        _as_broad(ax, curve @ axes.T, explanation.along, None)
    at = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))]
    for i, r in enumerate(explanation.chosen):
        place, width = r.parameters.get("position"), float(r.parameters.get("width", 0.0))
        if place is None:
            continue
        label = f"{_spaced(r.kind)} at {float(place):.3g} m"
        s = np.linspace(max(place - 0.5 * width, 0.0), min(place + 0.5 * width, at[-1]), 25)
        x, y = (np.stack([np.interp(s, at, c) for c in curve.T], axis=1) @ axes.T).T
        if width > _POINT * at[-1]:
            ax.plot(x, y, color=f"C{i}", lw=_BROADEST, alpha=0.45, solid_capstyle="butt", label=label)
        else:
            ax.plot(x[12], y[12], ls="", marker="D", ms=_BROADEST, mfc="none", mec=f"C{i}", mew=1.8, label=label)
        force = r.parameters.get("force")
        if force is not None and np.linalg.norm(force) > 0:
            tip = _ARROW * at[-1] * axes @ np.asarray(force) / np.linalg.norm(force)
            arrow = {"arrowstyle": "->", "color": f"C{i}", "lw": 1.8}
            ax.annotate("", (x[12] + tip[0], y[12] + tip[1]), (x[12], y[12]), arrowprops=arrow, annotation_clip=False)


def _supports(ax, study, pose, axes, label):
    """Triangles at the supports of a pose."""
    held = [e.parameters["anchor"] for e in study.acting(study.pose(pose)) if e.kind in SUPPORTS and "anchor" in e.parameters]
    if held:
        x, y = axes @ np.transpose(held)
        ax.plot(x, y, ls="", marker="^", ms=_BROADEST, mfc="none", mec=MEASURED, label="supports" if label else None)


def measured(study: "Study", pose: str, ax: Axes | None = None) -> Axes:
    """Measured centre curve of one pose without a solve, in the plane that shows it best (m)."""
    ax = plt.subplots()[1] if ax is None else ax
    curve = study.pose(pose).curve
    if curve is None:
        raise Scan2FlexError(f"pose {pose!r} has no centre curve to draw")
    axes, labels = _plane(curve.points, np.asarray(study.gravity))
    ax.plot(*(curve.points @ axes.T).T, ls="", marker="o", ms=3, mew=0, color=MEASURED, label="measured")
    ax.set_aspect("equal", adjustable="datalim")
    ax.set(xlabel=labels[0], ylabel=labels[1])
    ax.set_title(_named(pose), fontsize=10, pad=22)
    _legend(ax)
    return ax


def _seen(fit, name):
    """Measured points of a pose (m); coordinates that were not measured are those of the model at the same arc length."""
    p, markers = fit.poses[name], fit.study.pose(name).markers
    if markers is None or markers.measured == "xyz" or not p.stable or len(p.measured) != len(markers.points):
        return p.measured
    at = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(p.modelled, axis=0), axis=1))]
    known = np.array([axis in markers.measured for axis in "xyz"])
    return np.where(known, p.measured, np.stack([np.interp(p.s, at, x) for x in p.modelled.T], axis=1))


def _modelled_as(fit, name, pose):
    if pose is None:
        return _named(name)
    return "modelled" if _before(fit) is None else "after"


def _before(fit) -> "Fit | None":
    """The baseline fit of an explanation that added an effect."""
    return fit.fit if getattr(fit, "chosen", None) else None


def errors(fit: "Fit | Explanation", pose: str | None = None, ax: Axes | None = None) -> Axes:
    """Distance between measured and modelled curve along the cable (mm), of one pose or of all (the paper's Fig. 4)."""
    ax = plt.subplots()[1] if ax is None else ax
    if pose is not None and pose not in fit.poses:
        raise Scan2FlexError(f"no pose is called {pose!r}: the poses are {', '.join(fit.poses)}")
    for name, p in fit.poses.items() if pose is None else [(pose, fit.poses[pose])]:
        if not len(p.s):
            continue
        order = np.argsort(p.s)
        before: np.ndarray | None = getattr(p, "residual_before", None)
        if pose is not None and before is not None and np.all(np.isfinite(before)):
            ax.plot(p.s[order], 1e3 * np.linalg.norm(before[order], axis=1), color=_BEFORE, label="before", **_PALE)
        if np.isfinite(p.rms):
            colour = None if pose is None else _MODELLED
            label = _named(name, f" ({p.role})") if pose is None else "modelled" if before is None else "after"
            style = "-" if p.role == "fit" or pose is not None else "--"
            ax.plot(p.s[order], 1e3 * np.linalg.norm(p.residual, axis=1)[order], style, lw=1.4, label=label, color=colour)
    ax.set(xlabel="arc length s (m)", ylabel="distance (mm)", ylim=(0, 1.05 * ax.dataLim.y1))
    if pose is not None:
        ax.set_title(_named(pose, f" ({p.role})"), fontsize=10, pad=22)
    _legend(ax)
    return ax


def overview(fit: "Fit | Explanation") -> Figure:
    """A figure with every pose and the errors along the cable: one panel, or one panel per pose if lines would tangle."""
    names = list(fit.poses)
    columns, together = _columns(len(names)), len(names) <= _TANGLE
    rows = -(-len(names) // columns)
    figure = plt.figure(figsize=(4.2 * columns, 3.8 * (rows + (1 if together else rows))), layout="constrained")
    grid = figure.add_gridspec(rows + (1 if together else rows), columns)
    for i, name in enumerate(names):
        shapes(fit, name, figure.add_subplot(grid[i // columns, i % columns]))
    if together:
        errors(fit, ax=figure.add_subplot(grid[rows, :]))
    panels = [] if together else [figure.add_subplot(grid[rows + i // columns, i % columns]) for i in range(len(names))]
    top = max((errors(fit, name, ax).get_ylim()[1] for name, ax in zip(names, panels, strict=False)), default=None)
    for ax in panels:  # one scale, so that poses can be compared
        ax.set_ylim(0, top)
    _titled(figure, fit.study.title)
    return figure


def _columns(panels):
    """Columns of a grid of panels: four make a square."""
    return 2 if panels == 4 else min(_COLUMNS, panels)


def _titled(figure, title):
    """The title of a figure, in lines that fit its width."""
    figure.suptitle(drawn(textwrap.fill(title, int(_TITLE * figure.get_figwidth()))), fontsize=11)
    figure.get_layout_engine().set(h_pad=_BETWEEN)


def save(figure: Figure, file: str | Path, dpi: float = 150, write: Callable[[Path, bytes], object] = write_file) -> None:
    """Write a figure in one step, in the format of the file's extension: a reader sees the old file or the new one, complete.

    A study's own files are refused. ``write(path, bytes)`` writes the picture.
    """
    path, picture = Path(file), io.BytesIO()
    kinds = figure.canvas.get_supported_filetypes()
    kind = path.suffix.lstrip(".").lower() or "png"
    if kind not in kinds:
        raise Scan2FlexError(f"{path.name} is not a picture: name a file that ends in .png, .svg or .pdf")
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
    """Residual along s (mm), before and after: for one pose both normal components over the 95 % band of the noise, for all
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
    ax.fill_between([s[0], s[-1]], -band, band, color=BAND, lw=0, label="95 % of the noise")
    for k, style in enumerate(("-", (0, (2, 1)))):
        wide = {**_PALE, "ls": style} if k == 0 else {**_PALE, "ls": style, "lw": 2.5}
        ax.plot(s, 1e3 * p.residual_before[order, k], color=_BEFORE, label=f"before, normal {k + 1}", **wide)
    for k, style in enumerate(("-", "--")):
        ax.plot(s, 1e3 * p.residual[order, k], style, color=_MODELLED, lw=1.2, label=f"after, normal {k + 1}")
    ax.set(xlabel="arc length s (m)", ylabel="residual (mm)")
    title = _named(pose, f" ({p.role}): {1e3 * p.rms_before:.3g} to {1e3 * p.rms:.3g} mm")
    ax.set_title(title, fontsize=10, pad=46)
    _legend(ax)
    return ax


def _residuals(explanation, ax):
    """Distances of all poses along s (mm): broad and pale before, thin after."""
    for i, (name, p) in enumerate(explanation.poses.items()):
        order, style = np.argsort(p.s), "-" if p.role == "fit" else "--"
        was, now = (1e3 * np.linalg.norm(values[order], axis=1) for values in (p.residual_before, p.residual))
        ax.plot(p.s[order], was, color=f"C{i % 10}", **{**_PALE, "alpha": 0.3})
        ax.plot(p.s[order], now, style, lw=1.4, color=f"C{i % 10}", label=_named(name, f" ({p.role})"))
    ax.set(xlabel="arc length s (m)", ylabel="distance (mm), pale before", ylim=(0, None))
    _legend(ax)
    return ax


def along(values: Mapping[str, tuple[np.ndarray, np.ndarray]], label: str, ax: Axes | None = None) -> Axes:
    """One quantity along the cable, one line per pose: ``values`` are ``(s, quantity)`` by pose, ``label`` name and unit."""
    ax = plt.subplots()[1] if ax is None else ax
    for i, (name, (s, quantity)) in enumerate(values.items()):
        ax.plot(s, quantity, color=f"C{i % 10}", lw=1.4, label=_named(name))
    ax.set(xlabel="arc length s (m)", ylabel=label)
    _legend(ax)
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
    names = [h.name if h.variant == "as stated" else f"{h.name} ({h.variant})" for h in rows] + [_spaced(r.kind) for r in rest]
    for i, (h, x) in enumerate(zip(rows, gain, strict=True)):
        colour = {"best": _MODELLED, "tied": "#e5989b"}.get(h.relation, MEASURED)
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
        _legend(ax)
    return ax


def _spaced(kind):
    return kind.replace("_", " ")


def expected(expectation: "Expectation", ax: Axes | None = None) -> Axes:
    """The smallest effects that poses would find, over their usual size: what lies left of 1 is worth looking for."""
    ax = plt.subplots(figsize=(6.4, 5.6), layout="constrained")[1] if ax is None else ax
    sizes = [min(v.size, _HARDLY_SEEN) for v in expectation.effects]
    colours = [_MODELLED if size <= 1.0 else MEASURED for size in sizes]
    ax.hlines(range(len(sizes)), min(sizes), sizes, color=colours, lw=1.0, alpha=0.4)
    ax.scatter(sizes, range(len(sizes)), color=colours, s=28, zorder=3)
    ax.axvline(1.0, color="k", lw=0.8)
    ax.set_yticks(range(len(sizes)), [_spaced(v.kind) for v in expectation.effects], fontsize=8)
    ax.set(xscale="log", xlabel="smallest effect that would be found, over its usual size", ylim=(len(sizes) - 0.3, -0.7))
    return ax


def law(fit: "Fit | Explanation", kind: str | None = None, ax: Axes | None = None) -> Axes:
    """Moment (N m) of a law over its strain (1/m) with its 95 % band, full where poses reached the strain and pale where they
    did not; with the linear law of the stiffness at zero strain. Of the fit of a study that declares a law, or of an
    explanation that added one; without a ``kind``, the first."""
    ax = plt.subplots()[1] if ax is None else ax
    found = next((x for x in fit.laws if kind in (None, x.kind)), None)
    if found is None:
        what = f"no {kind}" if fit.laws else "no bending_law and no torsion_law"
        raise Scan2FlexError(f"the study declares {what}: there is no law to draw")
    q, moments = found.at, np.where(found.reached, found.moment, np.nan)
    for reached, alpha, label in ((True, 0.3, "95 % band"), (False, 0.1, "not reached by a pose")):
        inside = found.reached == reached
        if np.any(inside):
            wide = inside | np.r_[inside[1:], False] | np.r_[False, inside[:-1]]  # so that the two parts meet
            ax.fill_between(q, found.low, found.high, where=wide, color=_MODELLED, alpha=alpha, lw=0, label=label)
    ax.plot(q, found.moment, "--", color=_MODELLED, lw=1.0)
    ax.plot(q, moments, color=_MODELLED, lw=1.5, label="law")
    top = min(ax.get_ylim()[1], 2.0 * float(np.max(found.moment)))  # a band that is open at small strains would hide the law
    ax.plot(q, found.stiffness * q, color="#999999", lw=0.8, label="linear")
    ax.set(xlabel=f"{found.strain} (1/m)", ylabel="moment (N m)", xlim=(0.0, q[-1]), ylim=(0.0, top))
    _legend(ax)
    return ax


def stiffness(fit: "Fit | Explanation", ax: Axes | None = None, beside: Beside | None = None) -> Axes:
    """EI along the cable (N m^2) with its 95 % band, of a fit or an explanation with an effect that lets it vary.

    ``beside``: EI (N m^2) at arc lengths (m) by other means, under its name.
    """
    ax = plt.subplots()[1] if ax is None else ax
    found = fit.along
    if found is None:
        raise Scan2FlexError(_EVEN)
    if np.all(np.isfinite(found.high)):
        ax.fill_between(found.s, found.low, found.high, color=_MODELLED, alpha=0.25, lw=0, label="95 % band")
    ax.plot(found.s, found.bending, color=_MODELLED, lw=1.5, label="EI from the shapes")
    for name, (s, EI) in (beside or {}).items():
        ax.plot(s, EI, ls="", marker="o", ms=5, mfc="white", mec="k", mew=1.2, label=name)
    if np.max(found.bending) > _DECADES * np.min(found.bending):
        ax.set(yscale="log", ylim=(0.3 * np.min(found.bending), 3.0 * np.max(found.bending)))
    ax.set(xlabel="arc length s (m)", ylabel="bending stiffness (N m$^2$)")
    _legend(ax)
    return ax


def varied(explanation: "Explanation", beside: Beside | None = None) -> Figure:
    """A figure of a cable whose stiffness varies: the poses that were never fitted (all, where none is held out), measured,
    before and after, with lines as broad as the cable is stiff, and the stiffness along it, ``beside`` what is known."""
    if explanation.along is None:
        raise Scan2FlexError(_EVEN)
    figure = plt.figure(figsize=(11.5, 4.4), layout="constrained")
    ax, right = figure.subplots(1, 2, width_ratios=(1.35, 1.0))
    poses = explanation.poses
    unseen = [name for name, p in poses.items() if p.role == "validate" and p.stable] or list(poses)
    axes, labels = _plane(np.concatenate([_seen(explanation, name) for name in poses]), np.asarray(explanation.study.gravity))
    rms = [1e3 * explanation.rms(poses[unseen[0]].role, after) for after in (False, True)]
    for i, name in enumerate(unseen):
        said = ("measured", f"as declared: {rms[0]:.1f} mm off", f"as found: {rms[1]:.1f} mm off") if i == 0 else (None,) * 3
        before = None if explanation.fit is None else explanation.fit.poses[name].modelled
        if before is not None:
            ax.plot(*(before @ axes.T).T, color=_BEFORE, label=said[1], lw=2.0, alpha=0.8)
        _as_broad(ax, poses[name].modelled @ axes.T, explanation.along, said[2])
        points = {"ls": "", "marker": "o", "ms": 4.5, "mfc": "white", "mec": "k", "mew": 1.0, "zorder": 5}
        ax.plot(*(_seen(explanation, name) @ axes.T).T, **points, label=said[0])
    ax.set_aspect("equal", adjustable="datalim")
    ax.set(xlabel=labels[0], ylabel=labels[1])
    held_out = poses[unseen[0]].role == "validate"
    ax.set_title(f"{len(unseen)} poses{' that were never fitted' if held_out else ''}", fontsize=10, pad=36)
    _legend(ax)
    stiffness(explanation, right, beside).set_title("stiffness along the cable", fontsize=10, pad=36)
    _titled(figure, explanation.study.title)
    return figure


def _as_broad(ax, curve, along, label):
    """A curve as broad as it is stiff: with the fourth root, as the diameter of a solid section."""
    at = np.linspace(0.0, 2.0 * along.s[-1] - along.s[-2], len(curve))
    root = along.at(0.5 * (at[1:] + at[:-1]))[0] ** 0.25
    steps = list(np.stack([curve[:-1], curve[1:]], axis=1))
    pieces = LineCollection(steps, linewidths=_BROADEST * root / root.max(), colors=_MODELLED)
    pieces.set(label=label, capstyle="round")
    ax.add_collection(pieces)


def load(explanation: "Explanation", ax: Axes | None = None) -> Axes:
    """Equivalent load (N/m, scan frame) common to all poses, with its 95 % band: where a cause acts, not which one."""
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
    _legend(ax)
    return ax


def explained(explanation: "Explanation") -> Figure:
    """A figure with the comparison of hypotheses, what was found where it sits (the stiffness along the cable where it varies;
    without an effect, the equivalent load), and the residual of every pose before and after."""
    names = list(explanation.poses)
    columns = max(2, _columns(len(names)))
    rows = -(-len(names) // columns) + 1
    figure = plt.figure(figsize=(4.6 * columns, 3.6 * rows), layout="constrained")
    grid = figure.add_gridspec(rows, columns)
    comparison(explanation, figure.add_subplot(grid[0, : columns - 1]))
    beside = figure.add_subplot(grid[0, columns - 1])
    if explanation.along is not None:
        stiffness(explanation, beside)
    elif explanation.chosen:
        shapes(explanation, max(names, key=lambda name: np.nan_to_num(explanation.poses[name].rms_before)), beside)
    else:
        load(explanation, beside)
    for i, name in enumerate(names):
        residual(explanation, name, figure.add_subplot(grid[1 + i // columns, i % columns]))
    _titled(figure, f"{explanation.study.title}: {explanation.verdict}")
    return figure


def basins(sweep: "xarray.Dataset", ax: Axes | None = None, most: int = 5, within: float = 0.01) -> Axes:
    """Basins of attraction of a sweep of fits over two guesses: one colour per solution (estimates equal to within the fraction
    ``within``), ordered by cost, at most ``most``; crosses mark failed fits, and fits not yet run are blank."""
    ax = plt.subplots()[1] if ax is None else ax
    across, up = map(str, sweep["code"].dims[::-1])
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
