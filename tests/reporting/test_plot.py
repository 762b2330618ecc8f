"""Figures from Python: they draw on the axes they are given and return them, and show what the fit says."""

from dataclasses import replace

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest

from scan2flex_jax import plot
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.inference import Explanation
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


def test_four_poses_make_a_square(fitted):
    four = dict(list({f"{name} {k}": p for k in range(4) for name, p in fitted.poses.items()}.items())[:4])
    figure = plot.overview(replace(fitted, poses=four))
    assert {ax.get_subplotspec().colspan.start for ax in figure.axes[:4]} == {0, 1}


@pytest.mark.parametrize("name", [name for name in DRAWN if name != "comparison"])
def test_legends_hide_no_data(fitted, name):
    draw, subject, options = DRAWN[name]
    figure, ax = plt.subplots(layout="constrained")
    draw(subject(fitted), ax=ax, **options)
    figure.canvas.draw()
    assert ax.get_legend().get_window_extent().y0 >= ax.get_window_extent().y1


def test_what_was_before_lies_broad_under_what_is_after(fitted):
    found = explained(fitted)
    for ax in (plot.shapes(found, "twist-90"), plot.errors(found, "twist-90"), plot.residual(found, "twist-90")):
        labels = [line.get_label() for line in ax.lines]
        before, after = (next(i for i, label in enumerate(labels) if label.startswith(w)) for w in ("before", "after"))
        assert before < after  # drawn first
        assert ax.lines[before].get_linewidth() > 2 * ax.lines[after].get_linewidth()
        assert ax.lines[before].get_alpha() < 1
    np.testing.assert_allclose(
        plot.shapes(found, "twist-90").lines[0].get_xdata(), plot.shapes(fitted, "twist-90").lines[1].get_xdata()
    )  # "before" is the baseline fit's


def test_poses_whose_lines_would_tangle_have_a_panel_each(fitted):
    many = {f"{name} {k}": p for k in range(2) for name, p in fitted.poses.items()}
    figure = plot.overview(replace(fitted, poses=many))
    assert len(figure.axes) == 2 * len(many)
    of_errors = figure.axes[len(many) :]
    assert all(len(ax.lines) == 1 for ax in of_errors)
    assert len({ax.get_ylim() for ax in of_errors}) == 1


def test_a_measured_shape_alone(fitted):
    shown = plot.measured(fitted.study, "twist-90")
    assert len(shown.lines) == 1 and len(shown.lines[0].get_xdata()) == len(fitted.study.pose("twist-90").curve.points)


def test_quantities_along_and_correlations(fitted):
    s = np.linspace(0, 1, 5)
    assert [line.get_label() for line in plot.along({"a": (s, s), "b": (s, 2 * s)}, "torque (N m)").lines] == ["a", "b"]
    texts = [text.get_text() for text in plot.correlations(fitted).texts]
    assert texts == [f"{v:+.2f}" for v in fitted.correlation.ravel()]
