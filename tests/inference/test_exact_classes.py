"""Effects that shapes alone cannot distinguish are tied or inconclusive, never named.

The scale of all stiffnesses with the density is in `tests/fitting/test_identifiability.py`.
"""

import numpy as np
import pytest

from scan2flex_jax.inference import explain

from . import scenes

pytestmark = pytest.mark.slow


def tied(found):
    return {r.kind for r in found.ranking if r.verdict == "tied"}


def test_wind_and_a_tilt_of_gravity():
    """The study's gravity is off by four degrees: exactly a uniform load of 9.81 * 0.2 * 0.07 N/m across."""
    tilt = np.deg2rad(4.0)
    found = explain(scenes.study(gravity=(9.81 * np.sin(tilt), 0.0, -9.81 * np.cos(tilt))), mesh=False)
    assert found.significant
    assert found.verdict == "tied"
    best = found.ranking[0]
    assert best.kind == "uniform_load"
    assert best.tied_with == () and "uniform load or something outside the catalogue" in found.answer.belief
    assert best.parameters["force"][0] == pytest.approx(-9.81 * 0.2 * np.sin(tilt), rel=0.05)
    assert any("cannot tell uniform load from an error of the gravity" in s for s in found.sentences)


def test_natural_twist_and_a_roll_of_a_clamp():
    found = explain(scenes.study(natural_curvature=(0.0, 0.0, 0.3)), mesh=False)
    assert found.significant
    assert found.verdict == "tied"
    assert {"natural_curvature", "clamp_rotation"} <= tied(found)
    assert found.settle


def test_a_constant_curvature_in_the_plane_of_plane_clamped_poses():
    """1.5 1/m, a quarter of the largest curvature, and nothing to be seen of it."""
    found = explain(scenes.study(plane=True, natural_curvature=(0.0, 1.5, 0.0)), mesh=False)
    assert found.verdict == "no missing effect"
    curvature = next(r for r in found.ranking if r.kind == "natural_curvature")
    assert curvature.verdict in ("absent", "inconclusive")
