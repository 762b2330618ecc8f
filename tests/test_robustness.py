"""Cables far from what the package is made for are solved, or refused with a reason: some of those of docs/robustness.md."""

import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax import Boundary, Cable, CableModel, equilibrium
from scan2flex_jax.prediction import touching

ALONG = (0.5, 0.5, 0.5, 0.5)  # d3 = +x
CASES = {  # length (m), density (kg/m), EI and GJ (N m^2), distance of the clamps (m), whether it is solved
    "50 m, EI 10": (50.0, 1.0, 10.0, 10.0, 30.0, False),
    "clamps 3 L apart": (1.0, 0.2, 0.1, 0.25, 3.0, True),
    "GJ/EI = 1e4": (1.0, 0.2, 0.1, 1e3, 0.6, True),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_solved_or_refused_with_a_reason(name):
    length, density, EI, GJ, distance, solved = CASES[name]
    model = CableModel(Cable(length, density, EI, GJ, 1e5, 1e5), jnp.array([0.0, 0.0, -9.81]))
    e = equilibrium(model, Boundary.of(([0.0] * 3, ALONG), ([distance, 0.0, 0.0], ALONG)))
    assert bool(e.verdict.solved) == solved, e.verdict.sentence()
    if solved:
        points, forces = np.asarray(e.points), np.linalg.norm(e.section_forces()[1], axis=1)
        stretch = np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1)) / length - 1.0
        assert stretch < 0.01 + 2.0 * np.max(forces) / 1e5  # no longer than its forces make it; false for NaN
    else:
        assert e.verdict.sentence()


def test_a_cable_that_passes_through_itself_says_so():
    """A helix of four turns with a pitch of 2.1 radii is free of itself, one of 1.9 radii is not."""
    t, radius = np.linspace(0.0, 8.0 * np.pi, 400), 0.01
    for pitch, found in ((2.1, False), (1.9, True)):
        helix = np.column_stack([0.05 * np.cos(t), 0.05 * np.sin(t), pitch * radius * t / (2 * np.pi)])
        assert (touching(helix, radius) is not None) == found
    a, b = touching(helix, radius)
    assert abs(b - a) == pytest.approx(2 * np.pi * 0.05, rel=0.02)
    assert touching(np.array([[0.0, 0.0, 0.0], [0.03, 0.0, 0.0]]), radius) is None
