"""The generator of cables that remember: Dahl's loop in closed form, and what a chain of it remembers between its clamps."""

import numpy as np
import pytest

from benchmarks.blind.hysteresis import Grip, Law, hanging, posed, without_memory

GRIPS = [Grip(0.7, 0.0, 0.0), Grip(0.45, 0.05, 0.5), Grip(0.7, 0.0, 0.0)]


@pytest.mark.parametrize("most", [0.5, 2.0, 8.0])
def test_the_area_of_a_steady_loop_is_that_of_dahls_law(most):
    """Over a cycle z goes from -tanh(A/slip) to tanh(A/slip): the area is 4 share EI slip (A - slip tanh(A/slip))."""
    law = Law(0.05, 0.6, 1.5)
    expected = 4 * law.share * law.EI * law.slip * (most - law.slip * np.tanh(most / law.slip))
    assert law.loop_area(most) == pytest.approx(expected, rel=2e-3)


def test_without_a_share_there_is_no_loop_and_no_past():
    law = Law(0.05, 0.0, 1.5)
    assert law.loop_area(3.0) == pytest.approx(0.0, abs=1e-9)
    ordered, fresh = (run(1.0, 1.0, law, GRIPS) for run in (posed, without_memory))
    for a, b in zip(ordered, fresh, strict=True):
        np.testing.assert_allclose(a.points, b.points, atol=1e-9)


def test_the_same_clamps_hold_two_shapes_where_it_slips():
    first, _, again = posed(1.0, 1.0, Law(0.05, 0.6, 1.5), GRIPS)
    assert np.abs(first.points - again.points).max() > 1e-3


def test_a_chain_ends_at_its_clamp_in_balance():
    chain = hanging(1.0, 1.0, Law(0.05, 0.6, 1.5), GRIPS[1])
    np.testing.assert_allclose(chain.points[-1], [0.45, 0.05], atol=1e-9)
    again = chain.moved(GRIPS[1])
    np.testing.assert_allclose(again.points, chain.points, atol=1e-9)
