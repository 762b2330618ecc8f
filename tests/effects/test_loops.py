"""What laboratories print of a cable that remembers, against closed forms."""

import numpy as np
import pytest

from scan2flex_jax import CableModel, equilibrium
from scan2flex_jax.effects import Dahl, Friction, Relaxation, TorsionFriction
from scan2flex_jax.inference.loops import cycles, loops_of

from . import scene

EI, GJ, SHARE, SLIP, MOST = 0.02, 0.015, 0.6, 1.5, 4.0
K = np.diag([1e5, 1e5, 1e4, EI, EI, GJ])


@pytest.mark.parametrize(("axis", "B"), [(4, EI), (5, GJ)])
def test_the_cycles_of_dahl(axis, B):
    """Following: 4 share B slip (A - slip tanh(A/slip)). First: slip z integrated over the three ways, z(0) = 0."""
    first, following = cycles(Dahl(SHARE, SLIP), K, axis, MOST)
    scale = SHARE * B * SLIP
    assert following == pytest.approx(4 * scale * (MOST - SLIP * np.tanh(MOST / SLIP)), rel=2e-3)
    work, z = 0.0, 0.0
    for way, length in ((1, MOST), (-1, 2 * MOST), (1, MOST)):
        gone = 1 - np.exp(-length / SLIP)
        work += way * scale * (way * length - (way - z) * SLIP * gone)
        z += (way - z) * gone
    assert first == pytest.approx(work, rel=2e-3)
    assert first != pytest.approx(following, rel=0.05)


def test_the_cycles_of_one_slider():
    """A following cycle dissipates 4 share EI slip (A - slip); a first one slips less, and keeps what its slider stores."""
    first, following = cycles(Friction(SHARE, SLIP, spread=(1.0,), rounding=1e-9), K, 4, MOST)
    assert following == pytest.approx(4 * SHARE * EI * SLIP * (MOST - SLIP), rel=1e-6)
    slipped = (MOST - SLIP) + 2 * (MOST - SLIP) + (MOST - 2 * SLIP)  # the last way, from -A to 0, sticks over 2 slip
    assert first == pytest.approx(SHARE * EI * SLIP * slipped + 0.5 * SHARE * EI * SLIP**2, rel=1e-6)


def test_readings_name_stick_and_slip_and_the_standard_linear_solid():
    cable = scene.CABLE
    effects = (Friction(SHARE, SLIP), TorsionFriction(0.4, 0.5), Relaxation(0.3, 60.0))
    found = []
    for effect in effects:
        e = equilibrium(CableModel(cable, scene.DOWN, effect), scene.pose(), elements=12)
        (*first, last) = loops_of([(e.rod, e.configuration)])
        found.append({loop.of: loop.values for loop in (*first, last)})
    B, G = float(np.mean(cable.bending_stiffness)), float(cable.torsional_stiffness)
    assert found[0]["bending"]["stick stiffness"] == (pytest.approx(B), "N m^2")
    assert found[0]["bending"]["slip stiffness"] == (pytest.approx(0.4 * B), "N m^2")
    assert found[0]["bending"]["critical strain"] == (pytest.approx(SLIP), "1/m")
    assert found[1]["twist"]["slip stiffness"] == (pytest.approx(0.6 * G), "N m^2")
    assert found[2]["bending"]["K_inf"] == (pytest.approx(0.7 * B), "N m^2")
    assert found[2]["twist"]["K_1"] == (pytest.approx(0.3 * G), "N m^2")
    assert found[2]["twist"]["tau"] == (60.0, "s")


def test_a_rod_without_memory_has_no_loop():
    e = equilibrium(CableModel(scene.CABLE, scene.DOWN), scene.pose(), elements=12)
    assert loops_of([(e.rod, e.configuration)]) == ()
