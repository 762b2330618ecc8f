"""Real points, picked by others on a Kinect depth image of three wires of 0.40 m (intrinsics not published)."""

import os
from pathlib import Path

import numpy as np
import pytest

from benchmarks import kinect_picks

FOLDER = Path(os.environ.get("SCAN2FLEX_DATA", "")) / "wires-kinect"
LENGTH, RADIUS = 0.40, 0.002  # m; the radius is a guess: thin wires, and the length hardly depends on it
NOISE = 0.0023  # m: 4 mm in depth and a pixel across, as the root mean square of the three coordinates
SOURCE = (
    "the picked points are public in github.com/qj25/adapteddlo_muj (MIT; Chen, Bretl, Pham, arXiv 2310.00911):"
    " put them into a folder wires-kinect and name its parent in SCAN2FLEX_DATA"
)
needs_data = pytest.mark.skipif(not os.environ.get("SCAN2FLEX_DATA") or not FOLDER.is_dir(), reason=SOURCE)


def test_a_known_curve_comes_back_from_its_picks():
    a = np.linspace(-0.6, 0.6, 14)
    curve = np.stack([0.15 * np.sin(2 * a), 0.10 * np.cos(2 * a), 0.4 + 0.05 * a], axis=1)
    pixels = 504.0 * curve[:, :2] / curve[:, 2:] + [320.0, 288.0]
    picks = np.column_stack([pixels, 1e3 * curve[:, 2]])
    np.testing.assert_allclose(kinect_picks.deproject(picks), curve, atol=1e-12)
    found = kinect_picks.curve_from_picks(picks, RADIUS, 1e-4)
    b = np.linspace(-0.6, 0.6, 4001)
    fine = np.stack([0.15 * np.sin(2 * b), 0.10 * np.cos(2 * b), 0.4 + 0.05 * b], axis=1)
    assert abs(found.length / np.linalg.norm(np.diff(fine, axis=0), axis=1).sum() - 1.0) < 0.02


def picks_of(curve):
    """Pixels and depth (mm) of points in front of the nominal camera."""
    pixels = 504.0 * curve[:, :2] / curve[:, 2:] + [320.0, 288.0]
    return np.column_stack([pixels, 1e3 * curve[:, 2]])


@pytest.mark.slow
@pytest.mark.parametrize("slope", [0.0, 0.5, 1.0])
def test_the_length_follows_the_focal_length_as_far_as_it_runs_across_the_view(slope):
    """An arc across the view goes with 1/f. Tilted by ``slope`` in depth, a line's share is -across^2/length^2: x is z u/f."""
    across = np.linspace(-0.1, 0.1, 15)
    line = np.stack([across, 0.0 * across, 0.5 + slope * across], axis=1)
    found = kinect_picks.length_sensitivity(picks_of(line), RADIUS, 1e-4)
    assert abs(found + 1.0 / (1.0 + slope**2)) < 0.02


@pytest.mark.slow
def test_a_wrong_focal_length_makes_the_length_wrong_by_what_the_sensitivity_says():
    a = np.linspace(-0.6, 0.6, 14)
    picks = picks_of(np.stack([0.15 * np.sin(2 * a), 0.10 * np.cos(2 * a), 0.4 + 0.05 * a], axis=1))
    right = kinect_picks.curve_from_picks(picks, RADIUS, 1e-4).length
    wrong = kinect_picks.curve_from_picks(picks, RADIUS, 1e-4, kinect_picks.Intrinsics(504.0 * 1.05)).length
    slope = kinect_picks.length_sensitivity(picks, RADIUS, 1e-4)
    assert abs((wrong / right - 1.0) / 0.05 - slope) < 0.06  # second order in 5 %
