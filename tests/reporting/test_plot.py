"""Figures from Python: they draw on the axes they are given and return them, and show what the fit says."""

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pytest

from scan2flex_jax import plot
from scan2flex_jax.diagnosis import Explanation
from scan2flex_jax.errors import Scan2FlexError
from tests.reporting.scenes import EVIL, explained

mpl.use("Agg")
DRAWN = {
    "shapes": (plot.shapes, lambda fitted: fitted, {}),
    "shapes of one pose": (plot.shapes, lambda fitted: fitted, {"pose": "twist-90"}),
    "errors": (plot.errors, lambda fitted: fitted, {}),
    "residual": (plot.residual, explained, {}),
    "residual of one pose": (plot.residual, explained, {"pose": EVIL}),
    "evidence": (plot.evidence, explained, {}),
    "load": (plot.load, explained, {}),
}


@pytest.fixture(autouse=True)
def closed():
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
