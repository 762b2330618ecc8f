"""Cables far from what the package is made for are solved, or refused with a reason: a part of `benchmarks/robustness.py`."""

import json

import numpy as np
import pytest

from benchmarks import robustness
from scan2flex_jax.prediction import touching

SOME = (
    "chain: EI = GJ = 1e-6", "50 m, EI 10", "20 turns of twist, 40 elements", "clamps at distance L", "clamps 1.05 L apart",
    "clamps 3 L apart", "clamps in one place", "GJ/EI = 1e-4", "GJ/EI = 1e4",
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", SOME)
def test_solved_or_refused_with_a_reason(name, tmp_path):
    rows = robustness.run(robustness.cases()[name], tmp_path, fits=False)
    for way, row in rows.items():
        assert row["outcome"] in (robustness.SOLVED, robustness.REFUSED), (way, row)
        assert row["outcome"] == robustness.SOLVED or row["says"]
    if (tmp_path / "out.json").exists():
        json.loads((tmp_path / "out.json").read_text(), parse_constant=pytest.fail)


@pytest.mark.slow
def test_a_steel_rod_and_a_short_cable_are_solved():
    for name in ("steel rod of 10 mm, bent to 0.6 L", "5 cm, EI 1e-4"):
        assert robustness.solved(robustness.cases()[name])["outcome"] == robustness.SOLVED


def test_a_cable_that_passes_through_itself_says_so():
    """A helix of four turns with a pitch of 2.1 radii is free of itself, one of 1.9 radii is not."""
    t, radius = np.linspace(0.0, 8.0 * np.pi, 400), 0.01
    for pitch, found in ((2.1, False), (1.9, True)):
        helix = np.column_stack([0.05 * np.cos(t), 0.05 * np.sin(t), pitch * radius * t / (2 * np.pi)])
        assert (touching(helix, radius) is not None) == found
    a, b = touching(helix, radius)
    assert abs(b - a) == pytest.approx(2 * np.pi * 0.05, rel=0.02)
    assert touching(np.array([[0.0, 0.0, 0.0], [0.03, 0.0, 0.0]]), radius) is None
