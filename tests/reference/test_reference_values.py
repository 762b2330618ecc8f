"""The reference solutions against certified figures, and against a second derivation of their own.

Certified figures are literals with their source; "continuum" marks figures found by another implementation of the same
equations (shooting at 1e-12, collocation, Richardson extrapolation of discrete energies).
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from . import bend45, clamped_cases, cosserat_bvp, elastica, helix, rotations, stability, write_values

# P L^2/EI: w/L, u/L, tip slope (rad). Elliptic integrals to 30 digits; Mattiasson (1981) prints the same five digits.
ELASTICA = {
    0.2: (0.06636448214, 0.002646548341, 0.09963616304),
    1: (0.3017207738, 0.05643323628, 0.4613519497),
    5: (0.7137915236, 0.3876283607, 1.215368118),
    10: (0.8106090249, 0.5549955978, 1.430285539),
    100: (0.9414213509, 0.8585786446, 1.570645885),
}
# q L^3/EI: drop/L, x/L, tip slope (rad); continuum.
HEAVY_CANTILEVER = {
    1: (0.12347140, 0.99124640, 0.16511556),
    10: (0.70019972, 0.65635376, 1.05264312),
    100: (0.93752394, 0.15922338, 1.56410732),
}
# (model, torsion constant): tip under P = 600; continuum.
BEND45 = {
    ("kirchhoff", bend45.POLAR_J): (47.151294, 15.685078, 53.468598),
    ("simo-reissner", bend45.POLAR_J): (47.150439, 15.684801, 53.474859),
    ("simo-reissner", bend45.SAINT_VENANT_J): (46.896770, 15.560325, 53.604858),
    ("kirchhoff", bend45.SAINT_VENANT_J): (46.897616, 15.560600, 53.598603),
}
BEND45_STIFFNESS = {
    "kirchhoff": (np.inf, np.inf),
    "simo-reissner": (bend45.GA, bend45.EA),
}
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
        (
            (0.20374572, -0.10652672, -0.07729172),
            (0.42352087, -0.13339314, -0.14516911),
            (0.50765638, 0.04451266, -0.01551921),
        ),
        0.22458887730,
        (-0.6430567, -0.34910245, -0.25821128),
        (0.02381404, 0.07178541, -0.12207193),
        (-0.147882229, 0.4655),
    ),
    "H3": (
        (
            (0.20191239, -0.09846004, -0.09086393),
            (0.42265177, -0.12363584, -0.15591843),
            (0.50982143, 0.04233305, -0.01236754),
        ),
        0.20450083749,
        (-0.61997155, -0.33072322, -0.24625852),
        (0.00058365, 0.0752272, -0.14245733),
        (-0.161732518, 0.4515),
    ),
    "H4": (
        (
            (0.21661089, -0.07037393, -0.092098),
            (0.44563846, -0.14202562, -0.0940327),
            (0.54540904, 0.01961781, 0.03159497),
        ),
        0.15833474325,
        (-0.41763665, -0.23049945, -0.26446626),
        (0.00140902, 0.05665258, -0.1084834),
        (-0.116878082, 0.3805),
    ),
}
# T L^2/EI: M L/EI at which a straight clamped-clamped rod buckles under twist; continuum (Greenhill's equation).
TWIST = {0: 8.986818916, 10: 10.428856, 100: 20.983501}
# GJ/EI: critical total twist (rad) of a ring, 2 pi sqrt(3) EI/GJ (Michell 1889).
RING = {0.75: 14.510, 1.0: 10.883, 3.0: 3.628}


@pytest.mark.parametrize("load", ELASTICA)
def test_tip_loaded_cantilever_has_mattiassons_figures(load):
    np.testing.assert_allclose(elastica.tip_loaded_cantilever(load), ELASTICA[load], rtol=0, atol=6e-10)


@pytest.mark.parametrize("weight", HEAVY_CANTILEVER)
def test_heavy_cantilever_has_the_certified_figures(weight):
    np.testing.assert_allclose(elastica.heavy_cantilever(weight), HEAVY_CANTILEVER[weight], rtol=0, atol=6e-9)


@pytest.mark.parametrize(("model", "J"), BEND45)
def test_bend_has_the_certified_tip(model, J):
    tip = bend45.tip_position(600, J, *BEND45_STIFFNESS[model])
    np.testing.assert_allclose(tip, BEND45[model, J], rtol=0, atol=1e-6)


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


def test_heavy_column_has_greenhills_figure():
    assert stability.heavy_column() == pytest.approx(7.83734743894, abs=1e-11)
    assert stability.heavy_column_by_integration() == pytest.approx(stability.heavy_column(), abs=1e-10)


def test_clamped_clamped_compression_is_eulers():
    assert stability.clamped_clamped_compression() == pytest.approx(4 * np.pi**2, rel=1e-14)


@pytest.mark.parametrize("tension", TWIST)
def test_twisted_straight_rod_has_the_certified_moment(tension):
    critical = stability.twisted_straight_rod(tension)
    assert critical == pytest.approx(TWIST[tension], abs=1e-6)
    # all four clamp conditions of the complex deflection at once: their matrix is singular at the critical moment
    split = np.sqrt(critical**2 / 4 - tension)
    k1, k2 = 1j * (critical / 2 - split), 1j * (critical / 2 + split)
    columns = [[1, 0, 1, 0], [0, 1, 1, 1], [1, k2, np.exp(k2), k2 * np.exp(k2)]]
    columns.append([0, 0, 1, 2] if tension == 0 else [1, k1, np.exp(k1), k1 * np.exp(k1)])  # k1 = 0 gives x^2
    singular = np.linalg.svd(np.array(columns), compute_uv=False)
    assert singular[-1] < 1e-10 * singular[0]


@pytest.mark.parametrize("ratio", RING)
def test_twisted_ring_has_michells_figure(ratio):
    assert stability.ring_twist_angle(1 / ratio) == pytest.approx(RING[ratio], abs=6e-4)
    assert stability.twisted_ring() == pytest.approx(np.sqrt(3), rel=1e-13)


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
