"""The generator of cables that remember: its loops in closed form, what a chain remembers between its clamps, and whether it
stays in its plane."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.blind.hysteresis import SEGMENTS, Chain, Dahl, Grip, hanging

GRIP = Grip(0.45, 0.05, 0.5)


@pytest.mark.parametrize("most", [0.5, 8.0])
def test_the_area_of_a_steady_loop_is_that_of_dahls_law(most):
    """Over a cycle z goes from -tanh(A/slip) to tanh(A/slip): the area is 4 share EI slip (A - slip tanh(A/slip))."""
    law = Dahl(0.05, 0.6, 1.5)
    expected = 4 * law.share * law.EI * law.slip * (most - law.slip * np.tanh(most / law.slip))
    assert law.loop_area(most) == pytest.approx(expected, rel=2e-3)


def test_a_chain_ends_at_its_clamp_in_balance():
    chain = hanging(1.0, 1.0, Dahl(0.05, 0.6, 1.5), GRIP)
    np.testing.assert_allclose(chain.points[-1], [0.45, 0.05], atol=1e-9)
    again = chain.moved(GRIP)
    np.testing.assert_allclose(again.points, chain.points, atol=1e-9)


@pytest.mark.parametrize(("bending", "torsion"), [(1.0, 1.0), (2.0, 0.5)])
def test_a_clamped_strut_leaves_its_plane_at_eulers_force(bending, torsion):
    """4 pi^2 EI/L^2, whatever the torsional stiffness, here to the second order of 120 segments."""
    strut = Chain(1.0, 0.0, Dahl(1.0, 0.0, 1.0), np.zeros(SEGMENTS), np.zeros(2))
    euler = 4 * np.pi**2 * bending
    for part, stays in ((-2.0, True), (0.9, True), (0.998, True), (1.002, False), (2.0, False)):
        assert replace(strut, force=np.array([-part * euler, 0.0])).stays_plane(bending, torsion) is stays
