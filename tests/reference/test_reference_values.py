"""The reference solutions against certified figures, and against a second derivation of their own.

Certified figures are literals with their source; "continuum" marks figures found by another implementation of the same
equations (shooting at 1e-12, collocation, Richardson extrapolation of discrete energies).
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from . import clamped_cases, cosserat_bvp, helix, rotations, write_values

# r(L/4), r(L/2), r(3L/4) (m), energy (J), n(0) (N), m(0) (N m), lowest (z, s) (m); continuum.
HOUSE = {
    "H1": (
        ((0.19779431, 0, -0.13701528), (0.4, 0, -0.26728723), (0.60220569, 0, -0.13701528)),
        0.099261061696,
        (-0.73660033, 0, -0.25),
        (0, 0.13415194, 0),
        (-0.267287234, 0.5),
    ),
    "H2": (
        ((0.20374572, -0.10652672, -0.07729172), (0.42352087, -0.13339314, -0.14516911), (0.50765638, 0.04451266, -0.01551921)),
        0.22458887730,
        (-0.6430567, -0.34910245, -0.25821128),
        (0.02381404, 0.07178541, -0.12207193),
        (-0.147882229, 0.4655),
    ),
    "H3": (
        ((0.20191239, -0.09846004, -0.09086393), (0.42265177, -0.12363584, -0.15591843), (0.50982143, 0.04233305, -0.01236754)),
        0.20450083749,
        (-0.61997155, -0.33072322, -0.24625852),
        (0.00058365, 0.0752272, -0.14245733),
        (-0.161732518, 0.4515),
    ),
    "H4": (
        ((0.21661089, -0.07037393, -0.092098), (0.44563846, -0.14202562, -0.0940327), (0.54540904, 0.01961781, 0.03159497)),
        0.15833474325,
        (-0.41763665, -0.23049945, -0.26446626),
        (0.00140902, 0.05665258, -0.1084834),
        (-0.116878082, 0.3805),
    ),
}


@pytest.fixture(scope="module")
def solved():
    return {name: clamped_cases.solve_case(name) for name in clamped_cases.CASES}


@pytest.mark.parametrize("name", HOUSE)
def test_house_case_has_the_certified_figures(solved, name):
    places, energy, force, moment, (z, s) = HOUSE[name]
    answer = solved[name]
    np.testing.assert_allclose(answer.positions([0.25, 0.5, 0.75]), places, rtol=0, atol=1.1e-8)
    assert answer.energy() == pytest.approx(energy, abs=2e-11)
    np.testing.assert_allclose(answer.forces([0.0])[0], force, rtol=0, atol=1.1e-8)
    np.testing.assert_allclose(answer.moments([0.0])[0], moment, rtol=0, atol=1.1e-8)
    lowest = answer.lowest()
    assert lowest[0] == pytest.approx(z, abs=2e-8)
    assert lowest[1] == pytest.approx(s, abs=2e-4)


@pytest.mark.parametrize("name", clamped_cases.CASES)
def test_collocation_agrees_with_an_initial_value_problem(solved, name):
    assert solved[name].shooting_error() < 1e-9


@pytest.mark.parametrize("name", clamped_cases.CASES)
def test_recorded_values_are_the_recomputed_ones(solved, name):
    recorded, answer = write_values.load(name), solved[name]
    rod = cosserat_bvp.Clamped(*[np.array(x) for x in recorded["case"].values()])
    for key, value in clamped_cases.CASES[name]._asdict().items():
        np.testing.assert_allclose(getattr(rod, key), value, rtol=0, atol=1e-11)
    s = np.array(recorded["s"])
    for field in ("positions", "frames", "forces", "moments"):
        np.testing.assert_allclose(getattr(answer, field)(s), recorded[field], rtol=0, atol=1e-9)
    assert answer.energy() == pytest.approx(recorded["energy"], abs=1e-10)
    assert answer.lowest()[0] == pytest.approx(recorded["lowest"]["z"], abs=1e-9)


def test_equilibrium_balances_its_weight(solved):
    for name, answer in solved.items():
        rod = clamped_cases.CASES[name]
        n, m, r = answer.forces([0.0, 1.0]), answer.moments([0.0, 1.0]), answer.positions([1.0])[0]
        s, weights = np.polynomial.legendre.leggauss(40)
        centre = weights / 2 @ answer.positions((s + 1) / 2)
        weight = np.array([0, 0, -rod.weight])
        np.testing.assert_allclose(n[1] - n[0] + weight, 0, atol=1e-9)
        np.testing.assert_allclose(m[1] - m[0] + np.cross(r, n[1]) + np.cross(centre, weight), 0, atol=1e-8)


def _integrated(moment, EI, GJ, frame, s):
    """Positions (n, 3) and frames (n, 3, 3) of a rod under a constant moment, from R' = R hat(K^-1 R^T m)."""

    def rhs(_, y):
        R = y[3:].reshape(3, 3)
        return np.concatenate([R[:, 2], (R @ rotations.hat(R.T @ moment / [EI, EI, GJ])).ravel()])

    start = np.concatenate([np.zeros(3), frame.ravel()])
    y = solve_ivp(rhs, (0, s[-1]), start, t_eval=s, method="DOP853", rtol=1e-12, atol=1e-12).y.T
    return y[:, :3], y[:, 3:].reshape(-1, 3, 3)


@pytest.mark.parametrize("GJ", [0.3, 1.0, 2.5])
def test_shape_under_an_end_moment_solves_the_equations(GJ):
    s, moment = np.linspace(0, 2, 9), np.array([3.0, -1.0, 2.0])
    for found, expected in zip(
        helix.under_end_moment(s, moment, 1.0, GJ, clamped_cases.START_FRAME),
        _integrated(moment, 1.0, GJ, clamped_cases.START_FRAME, s),
        strict=True,
    ):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)
