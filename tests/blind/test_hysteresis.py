"""The generator of cables that remember: its loops in closed form, what a chain remembers between its clamps, and whether it
stays in its plane."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from benchmarks.blind.hysteresis import SEGMENTS, BoucWen, Chain, Dahl, Grip, hanging

GRIP = Grip(0.45, 0.05, 0.5)


@pytest.mark.parametrize("most", [0.5, 2.0, 8.0])
def test_the_area_of_a_steady_loop_is_that_of_dahls_law(most):
    """Over a cycle z goes from -tanh(A/slip) to tanh(A/slip): the area is 4 share EI slip (A - slip tanh(A/slip))."""
    law = Dahl(0.05, 0.6, 1.5)
    expected = 4 * law.share * law.EI * law.slip * (most - law.slip * np.tanh(most / law.slip))
    assert law.loop_area(most) == pytest.approx(expected, rel=2e-3)


def test_without_a_share_there_is_no_loop():
    assert Dahl(0.05, 0.0, 1.5).loop_area(3.0) == pytest.approx(0.0, abs=1e-9)


def test_a_chain_ends_at_its_clamp_in_balance():
    chain = hanging(1.0, 1.0, Dahl(0.05, 0.6, 1.5), GRIP)
    np.testing.assert_allclose(chain.points[-1], [0.45, 0.05], atol=1e-9)
    again = chain.moved(GRIP)
    np.testing.assert_allclose(again.points, chain.points, atol=1e-9)


@pytest.mark.parametrize("most", [0.5, 2.0, 8.0])
def test_the_area_of_a_steady_loop_is_that_of_bouc_and_wens_law(most):
    """From -z0 the state comes back to zero over slip z0, and grows to z0 = 1 - exp(-x/slip) over the rest x = 2A - slip z0."""
    law = BoucWen(0.05, 0.6, 1.5)
    z0 = brentq(lambda z: 1 - np.exp(-(2 * most / law.slip - z)) - z, 0.0, min(1.0, most / law.slip))
    x = 2 * most - law.slip * z0
    way = -0.5 * law.slip * z0**2 + x - law.slip * (1 - np.exp(-x / law.slip))
    assert law.loop_area(most) == pytest.approx(2 * law.share * law.EI * law.slip * way, rel=2e-3)


@pytest.mark.parametrize(("bending", "torsion"), [(1.0, 1.0), (2.0, 0.5)])
def test_a_clamped_strut_leaves_its_plane_at_eulers_force(bending, torsion):
    """4 pi^2 EI/L^2, whatever the torsional stiffness, here to the second order of 120 segments."""
    strut = Chain(1.0, 0.0, Dahl(1.0, 0.0, 1.0), np.zeros(SEGMENTS), np.zeros(2))
    euler = 4 * np.pi**2 * bending
    for part, stays in ((-2.0, True), (0.9, True), (0.998, True), (1.002, False), (2.0, False)):
        assert replace(strut, force=np.array([-part * euler, 0.0])).stays_plane(bending, torsion) is stays


@pytest.mark.parametrize("span", [0.9, 0.6])
def test_a_weightless_arch_turns_about_its_ends_if_it_bends_as_easily_out_of_its_plane(span):
    """It may turn about the line through its clamps, without twist and at no cost, if both bending stiffnesses are equal."""
    arch = hanging(1.0, 0.0, Dahl(0.05, 0.0, 1.5), Grip(span, 0.0, 0.0))
    assert arch.stays_plane(1.002 * 0.05, 1.0)
    assert not arch.stays_plane(0.998 * 0.05, 1.0)
