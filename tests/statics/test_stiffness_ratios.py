"""Cables whose bending and torsional stiffnesses differ: as accurate as others, against collocation of the continuous rod."""

import jax.numpy as jnp
import numpy as np
import pytest
from reference import clamped_cases

from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.model import Configuration

from . import cases

MESHES = (20, 40)
RIGID = 1.0e8  # N: stretches cables that the reference has inextensible by 2e-8
RATIOS = {"GJ/EI": (0.1, 0.1, 5.0), "EI/GJ": (0.1, 0.1, 0.002), "EI2/EI1": (0.1, 5.0, 0.1)}


def solved(K, answer, n, start=None):
    """P2 with stiffnesses K on n elements: from the reference's frames, or from a start."""
    rod = answer.rod
    model = cases.model(Cable(rod.length, rod.weight / 9.81, K[:2], K[2], RIGID, RIGID))
    nodes = np.linspace(0.0, rod.length, n + 1)
    exact = Configuration(jnp.array(answer.positions(nodes)), jnp.array(answer.frames(nodes)))
    boundary = cases.clamped(rod.end, rod.end_frame, rod.start_frame)
    return cases.solved(model, boundary, n, start or exact), exact


@pytest.fixture(scope="module", params=RATIOS)
def reference(request):
    """Stiffnesses (N m^2), and the equilibrium of P2 with them."""
    return RATIOS[request.param], clamped_cases.with_ratios("P2", [(0.1, 0.1, 0.1), RATIOS[request.param]], steps=8)[-1]


def test_fourth_order_at_ratios_of_fifty(reference):
    """A law that fades out where one stiffness is far below the others is of second order, with errors up to 1e-3 at 40."""
    errors = []
    for n in MESHES:
        found, exact = solved(*reference, n)
        assert found.verdict.solved, found.verdict.sentence()
        errors.append(np.max(np.linalg.norm(found.points - exact.r, axis=1)))
    assert np.all(cases.order(errors) > 3.5), errors
    assert errors[-1] < 2e-5


def test_a_start_at_the_solution_keeps_the_law_of_the_elements(reference):
    """Stiffened elements would lead away from the solution, and back."""
    found, _ = solved(*reference, 40)
    again, _ = solved(*reference, 40, found.configuration)
    assert int(again.verdict.steps) == 2
