"""Whole figures: every pose of a fit, what an explanation found, and a cable whose stiffness varies."""

import textwrap
from typing import TYPE_CHECKING

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.names import drawn
from scan2flex_jax.plot.in_space import IN_SPACE, as_broad, plane, seen_points, shapes
from scan2flex_jax.plot.over_length import EVEN, Beside, errors, load, residual, stiffness
from scan2flex_jax.plot.scores import comparison
from scan2flex_jax.plot.style import BEFORE, COLUMNS, legend

if TYPE_CHECKING:  # for annotations only: drawing needs no import of these types
    from scan2flex_jax.inference import Explanation, Fit

_TANGLE = 4  # largest number of poses whose lines can be distinguished in one panel
_BETWEEN = 0.12  # inches above and below a panel: a panel's title is not taken for the label of the axis above it
_TITLE = 10  # characters of a figure's title per inch of its width


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


def varied(explanation: "Explanation", beside: Beside | None = None) -> Figure:
    """A figure of a cable whose stiffness varies: the poses that were never fitted (all, where none is held out), measured,
    before and after, with lines as broad as the cable is stiff, and the stiffness along it, ``beside`` what is known."""
    if explanation.along is None:
        raise Scan2FlexError(EVEN)
    figure = plt.figure(figsize=(11.5, 4.4), layout="constrained")
    ax, right = figure.subplots(1, 2, width_ratios=(1.35, 1.0))
    poses = explanation.poses
    unseen = [name for name, p in poses.items() if p.role == "validate" and p.stable] or list(poses)
    axes = plane(np.concatenate([seen_points(explanation, name) for name in poses]), explanation.study)
    rms = [1e3 * explanation.rms(poses[unseen[0]].role, after) for after in (False, True)]
    for i, name in enumerate(unseen):
        said = ("measured", f"as declared: {rms[0]:.1f} mm off", f"as found: {rms[1]:.1f} mm off") if i == 0 else (None,) * 3
        before = None if explanation.fit is None else explanation.fit.poses[name].modelled
        if before is not None:
            ax.plot(*(before @ axes.T).T, color=BEFORE, label=said[1], lw=2.0, alpha=0.8)
        as_broad(ax, poses[name].modelled @ axes.T, explanation.along, said[2])
        points = {"ls": "", "marker": "o", "ms": 4.5, "mfc": "white", "mec": "k", "mew": 1.0, "zorder": 5}
        ax.plot(*(seen_points(explanation, name) @ axes.T).T, **points, label=said[0])
    ax.set(**IN_SPACE)
    held_out = poses[unseen[0]].role == "validate"
    ax.set_title(f"{len(unseen)} poses{' that were never fitted' if held_out else ''}", fontsize=10, pad=36)
    legend(ax)
    stiffness(explanation, right, beside).set_title("stiffness along the cable", fontsize=10, pad=36)
    _titled(figure, explanation.study.title)
    return figure


def _columns(panels):
    """Columns of a grid of panels: four make a square."""
    return 2 if panels == 4 else min(COLUMNS, panels)


def _titled(figure, title):
    """The title of a figure, in lines that fit its width."""
    figure.suptitle(drawn(textwrap.fill(title, int(_TITLE * figure.get_figwidth()))), fontsize=11)
    figure.get_layout_engine().set(h_pad=_BETWEEN)
