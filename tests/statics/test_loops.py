"""Clamps in one point with opposite tangents: the loop is in one plane and has no twist, with turns = 0."""

import jax
import numpy as np
import pytest
from reference import cantilever

from scan2flex_jax import Boundary, Cable, CableModel, equilibrium
from scan2flex_jax.effects import AnisotropicBending

L, EI = 0.3, 2e-5
UP, DOWN = [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]  # half a turn about y
GRAVITY = [0.0, 0.0, -9.81]


def elastica():
    """Height of the loop without weight over its length."""
    ends = (np.pi / 2, -np.pi / 2)
    loop = cantilever.between_clamps(1.0, 1.0, 0.0, *ends, 0.0, lambda s: np.pi / 2 - np.pi * s + np.sin(4 * np.pi * s))
    return loop(0.5)[1]


@jax.jit
def strip(gap, turns, weight, ratio):
    """Status and nodes of a cable that is ``ratio`` times as stiff to bending out of the plane of the loop."""
    ends = Boundary.of((np.zeros(3), UP), (np.zeros(3), DOWN))
    ends = Boundary(ends.position.at[1, 0].set(-gap), ends.rotation, ends.held)
    model = CableModel(Cable(L, 0.02, EI, 1.6e-5), weight * np.array(GRAVITY), AnisotropicBending(ratio, np.pi / 2))
    e = equilibrium(model, ends, turns=turns)
    return e.verdict.code, e.points


@pytest.mark.parametrize("gap", [0.0, 1e-4, 2e-4])
def test_a_weightless_loop_has_the_height_of_the_elastica(gap):
    code, points = strip(gap, 0, 0.0, 1000.0)
    assert code == 0
    assert np.abs(points[:, 1]).max() < 1e-9
    assert float(points[20, 2]) == pytest.approx(elastica() * L, abs=2e-6 * L + 0.1 * gap)


def test_a_hanging_heart_is_plane_with_no_turns_and_twisted_with_one():
    """A strip that hangs from its clamp as a heart; gaps to zero change it with their size."""
    shapes = []
    for gap in (0.0, 1e-4, 2e-4):
        code, points = strip(gap, 0, 1.0, 1000.0)
        assert code == 0
        assert np.abs(points[:, 1]).max() < 1e-9
        shapes.append(float(points[20, 2]))
    assert shapes[0] == pytest.approx(-0.0727, abs=1e-4)  # of a study whose strip was solved as a plane boundary value problem
    assert shapes[1] - shapes[0] == pytest.approx(shapes[2] - shapes[1], rel=0.05)
    code, points = strip(0.0, 1, 1.0, 1000.0)
    assert code == 0 and np.abs(points[:, 1]).max() > 0.01
