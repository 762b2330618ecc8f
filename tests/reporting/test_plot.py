"""Figures from Python: they draw on the axes they are given and return them, and show what the fit says."""

from dataclasses import replace

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest

from scan2flex_jax import plot
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.inference import Explanation
from scan2flex_jax.results.along import StiffnessAlong
from tests.reporting.scenes import EVIL, explained

mpl.use("Agg")
DRAWN = {
    "shapes": (plot.shapes, lambda fitted: fitted, {}),
    "shapes of one pose": (plot.shapes, lambda fitted: fitted, {"pose": "twist-90"}),
    "errors": (plot.errors, lambda fitted: fitted, {}),
    "residual": (plot.residual, explained, {}),
    "residual of one pose": (plot.residual, explained, {"pose": EVIL}),
    "comparison": (plot.comparison, explained, {}),
    "load": (plot.load, explained, {}),
}


@pytest.fixture(autouse=True)
def closed():
    plt.close("all")  # of other tests, where they left any
    yield
    plt.close("all")


@pytest.mark.parametrize("name", DRAWN)
def test_axes_are_taken_and_returned(fitted, name):
    draw, subject, options = DRAWN[name]
    figure, ax = plt.subplots()
    assert draw(subject(fitted), ax=ax, **options) is ax
    assert plt.get_fignums() == [figure.number]
    assert ax.get_xlabel()
    figure.canvas.draw()  # texts with markup and dollar signs are drawn as they are
    alone = draw(subject(fitted), **options)
    assert alone is not ax
    assert len(alone.lines) == len(ax.lines)


def test_all_poses_are_shown_or_one(fitted):
    assert len(plot.shapes(fitted).lines) == 2 * len(fitted.poses)
    assert len(plot.shapes(fitted, "twist-90").lines) == 2
    shown = [line.get_ydata().max() for line in plot.errors(fitted).lines]
    np.testing.assert_allclose(shown, [1e3 * p.worst for p in fitted.poses.values()])
    before_after = [line.get_ydata().max() for line in plot.residual(explained(fitted)).lines]
    np.testing.assert_allclose(before_after[::2], 2 * np.array(shown))
    np.testing.assert_allclose(before_after[1::2], shown)


def test_an_effect_is_drawn_where_it_sits(fitted):
    """A mark or a span of the right place on the curve after; along straight stretches arc length is distance."""
    told = explained(fitted)
    name = "twist-90"
    curve = told.poses[name].modelled
    at = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))]

    def drawn(**parameters):
        ax = plot.shapes(replace(told, chosen=(replace(told.chosen[0], kind="point_load", parameters=parameters),)), name)
        line = next(x for x in ax.lines if x.get_label().startswith("point load at"))
        return line, ax

    line, ax = drawn(position=0.4, force=np.array([0.0, 0.0, -1.0]))
    whole = next(x for x in ax.lines if x.get_label() == "after")
    for mark, full in ((line.get_xdata(), whole.get_xdata()), (line.get_ydata(), whole.get_ydata())):
        assert np.ravel(mark)[0] == pytest.approx(np.interp(0.4, at, full))
    assert any(text.arrow_patch is not None for text in ax.texts)
    span, _ = drawn(position=0.5, width=0.3)
    seen = np.hypot(np.diff(span.get_xdata()), np.diff(span.get_ydata())).sum()
    assert 0.1 < seen <= 0.3 + 1e-9  # of a curve that is seen from one side


def test_an_unknown_pose_is_one_sentence(fitted):
    for draw, subject in ((plot.shapes, fitted), (plot.residual, explained(fitted))):
        with pytest.raises(Scan2FlexError, match="no pose is called 'sag'"):
            draw(subject, "sag")
    bare = Explanation(study=fitted.study, verdict="not in equilibrium")
    with pytest.raises(Scan2FlexError, match="no residual"):
        plot.residual(bare)


def test_whole_figures_hold_every_pose(fitted):
    assert len(plot.overview(fitted).axes) == len(fitted.poses) + 1
    assert len(plot.explained(explained(fitted)).axes) == len(fitted.poses) + 2


def test_a_long_title_stays_inside_the_figure(fitted):
    long = replace(fitted, study=replace(fitted.study, title="Hose between two facing clamps, " * 6))
    for figure in (plot.overview(long), plot.explained(replace(explained(fitted), study=long.study))):
        figure.canvas.draw()
        [title] = [text for text in figure.texts if text.get_text().startswith("Hose")]
        box = title.get_window_extent()
        assert 0.03 * figure.bbox.width < box.x0 and box.x1 < 0.97 * figure.bbox.width
        assert box.y1 < figure.bbox.height and box.y0 > max(ax.title.get_window_extent().y1 for ax in figure.axes)


@pytest.mark.parametrize("name", [name for name in DRAWN if name != "comparison"])
def test_legends_hide_no_data(fitted, name):
    draw, subject, options = DRAWN[name]
    figure, ax = plt.subplots(layout="constrained")
    draw(subject(fitted), ax=ax, **options)
    figure.canvas.draw()
    assert ax.get_legend().get_window_extent().y0 >= ax.get_window_extent().y1


def test_a_measured_shape_alone(fitted):
    shown = plot.measured(fitted.study, "twist-90")
    assert len(shown.lines) == 1 and len(shown.lines[0].get_xdata()) == len(fitted.study.pose("twist-90").curve.points)


def test_a_cable_whose_stiffness_varies_is_as_broad_as_it_is_stiff(fitted):
    """One figure: the poses that were never fitted, and EI beside what is known by other means; no figure without one."""
    told = explained(fitted)
    with pytest.raises(Scan2FlexError, match="nothing lets the stiffness vary"):
        plot.varied(told)
    s = np.linspace(0.05, 0.95, 10)
    EI = np.geomspace(16.0, 1.0, 10)
    figure = plot.varied(replace(told, along=StiffnessAlong(s, EI, 0.9 * EI, 1.1 * EI, EI / 4.0)), {"calipers": (s, EI)})
    left, right = figure.axes
    (curve, *_) = left.collections
    np.testing.assert_allclose(curve.get_linewidths()[0] / curve.get_linewidths()[-1], 2.0, rtol=1e-6)
    assert "calipers" in right.get_legend_handles_labels()[1]
    assert right.get_yscale() == "log"
    plt.close(figure)
