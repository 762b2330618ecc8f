"""Cables far from what the package is made for are solved, or refused with a reason: a part of `benchmarks/robustness.py`."""

import numpy as np
import pytest

from benchmarks import robustness
from scan2flex_jax.prediction import touching

SOME = ("50 m, EI 10", "clamps 3 L apart", "GJ/EI = 1e4")


@pytest.mark.slow
@pytest.mark.parametrize("name", SOME)
def test_solved_or_refused_with_a_reason(name):
    row = robustness.run(robustness.cases()[name], fits=False)["equilibrium"]
    assert row["outcome"] in (robustness.SOLVED, robustness.REFUSED), row
    assert row["outcome"] == robustness.SOLVED or row["says"]


def test_a_cable_that_passes_through_itself_says_so():
    """A helix of four turns with a pitch of 2.1 radii is free of itself, one of 1.9 radii is not."""
    t, radius = np.linspace(0.0, 8.0 * np.pi, 400), 0.01
    for pitch, found in ((2.1, False), (1.9, True)):
        helix = np.column_stack([0.05 * np.cos(t), 0.05 * np.sin(t), pitch * radius * t / (2 * np.pi)])
        assert (touching(helix, radius) is not None) == found
    a, b = touching(helix, radius)
    assert abs(b - a) == pytest.approx(2 * np.pi * 0.05, rel=0.02)
    assert touching(np.array([[0.0, 0.0, 0.0], [0.03, 0.0, 0.0]]), radius) is None
