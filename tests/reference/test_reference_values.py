"""The reference solutions against certified figures, and against a second derivation of their own.

Certified figures are literals with their source; "continuum" marks figures found by another implementation of the same
equations (shooting at 1e-12, collocation, Richardson extrapolation of discrete energies).
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from . import bend45, chain, clamped_cases, cosserat_bvp, elastica, helix, rotations, stability, write_values

# P L^2/EI: w/L, u/L, tip slope (rad). Elliptic integrals to 30 digits; Mattiasson (1981) prints the same five digits.
ELASTICA = {
    0.2: (0.06636448214, 0.002646548341, 0.09963616304),
    0.5: (0.1621435757, 0.01591896247, 0.2445336471),
    1: (0.3017207738, 0.05643323628, 0.4613519497),
    2: (0.4934574804, 0.1606417208, 0.7817498316),
    3: (0.6032534411, 0.2544201846, 0.9860169467),
    4: (0.6699641813, 0.3289412422, 1.121239347),
    5: (0.7137915236, 0.3876283607, 1.215368118),
    6: (0.7445711489, 0.4345888287, 1.283697286),
    7: (0.7673690997, 0.4729274284, 1.334959857),
    8: (0.7849823750, 0.5048277321, 1.374431507),
    9: (0.7990555275, 0.5318205627, 1.405465334),
    10: (0.8106090249, 0.5549955978, 1.430285539),
    20: (0.8686958983, 0.6838855676, 1.532934956),
    100: (0.9414213509, 0.8585786446, 1.570645885),
}
# q L^3/EI: drop/L, x/L, tip slope (rad); continuum.
HEAVY_CANTILEVER = {
    1: (0.12347140, 0.99124640, 0.16511556),
    2: (0.23850658, 0.96689295, 0.32159380),
    5: (0.49590504, 0.84665718, 0.69700478),
    10: (0.70019972, 0.65635376, 1.05264312),
    20: (0.82988144, 0.44523205, 1.33950154),
    50: (0.90791712, 0.24501476, 1.52645315),
    100: (0.93752394, 0.15922338, 1.56410732),
}
# (model, torsion constant): tips under P = 300, 450, 600; continuum.
BEND45 = {
    ("kirchhoff", bend45.POLAR_J): (
        (58.779685, 22.245035, 40.188284),
        (52.239298, 18.508464, 48.497983),
        (47.151294, 15.685078, 53.468598),
    ),
    ("simo-reissner", bend45.POLAR_J): (
        (58.779122, 22.244781, 40.191892),
        (52.238558, 18.508179, 48.502927),
        (47.150439, 15.684801, 53.474859),
    ),
    ("simo-reissner", bend45.SAINT_VENANT_J): (
        (58.540513, 22.115240, 40.474795),
        (51.974762, 18.372043, 48.700967),
        (46.896770, 15.560325, 53.604858),
    ),
    ("kirchhoff", bend45.SAINT_VENANT_J): (
        (58.541072, 22.115492, 40.471199),
        (51.975495, 18.372325, 48.696032),
        (46.897616, 15.560600, 53.598603),
    ),
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
TWIST = {0: 8.986818916, 1: 9.134730, 10: 10.428856, 30: 13.113500, 100: 20.983501}
NEUTRAL = 1e-8  # N m; smaller eigenvalues are rounding, the others here are above 1e-3
# GJ/EI: critical total twist (rad) of a ring, 2 pi sqrt(3) EI/GJ (Michell 1889).
RING = {0.75: 14.510, 1.0: 10.883, 3.0: 3.628}


@pytest.mark.parametrize("load", ELASTICA)
def test_tip_loaded_cantilever_has_mattiassons_figures(load):
    np.testing.assert_allclose(elastica.tip_loaded_cantilever(load), ELASTICA[load], rtol=0, atol=6e-10)


@pytest.mark.parametrize("load", [0.2, 1, 5, 20])
def test_elliptic_integrals_agree_with_shooting(load):
    drop, x, slope = elastica.shoot_cantilever(lambda sigma: load)
    np.testing.assert_allclose((drop, 1 - x, slope), elastica.tip_loaded_cantilever(load), rtol=0, atol=1e-12)


@pytest.mark.parametrize("weight", HEAVY_CANTILEVER)
def test_heavy_cantilever_has_the_certified_figures(weight):
    np.testing.assert_allclose(elastica.heavy_cantilever(weight), HEAVY_CANTILEVER[weight], rtol=0, atol=6e-9)


def test_a_light_cantilever_bends_as_the_linear_beam():
    """Drop q L^3/(8 EI) and tip slope q L^2/(6 EI), up to the square of the load."""
    drop, _, slope = elastica.heavy_cantilever(1e-3)
    np.testing.assert_allclose((drop, slope), (1e-3 / 8, 1e-3 / 6), rtol=1e-6)


@pytest.mark.parametrize(("model", "J"), BEND45)
def test_bend_has_the_certified_tip(model, J):
    tip = bend45.tip_position(600, J, *BEND45_STIFFNESS[model])
    np.testing.assert_allclose(tip, BEND45[model, J][2], rtol=0, atol=1e-6)


def test_bend_under_a_small_force_obeys_castigliano():
    """Tip z = P int (M_b^2/EI + M_t^2/GJ) ds for an eighth of a circle, M_b = R sin a, M_t = R (1 - cos a)."""
    a, weights = np.polynomial.legendre.leggauss(12)
    a, weights = np.pi / 8 * (a + 1), np.pi / 8 * weights * bend45.RADIUS
    GJ = bend45.SHEAR_MODULUS * bend45.POLAR_J
    arms = bend45.RADIUS**2 * (np.sin(a) ** 2 / bend45.EI + (1 - np.cos(a)) ** 2 / GJ)
    assert bend45.tip_position(1e-2, bend45.POLAR_J)[2] == pytest.approx(1e-2 * weights @ arms, rel=1e-6)


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


@pytest.mark.parametrize("name", ["H4", "P2"])
def test_recorded_branch_is_a_minimum_and_the_chain_converges_to_it(solved, name):
    """Second order in the positions; the energy by Richardson, less the compliance, whose share is 1/2 n.C n."""
    answer, rod = solved[name], clamped_cases.CASES[name]
    chains = [chain.of_solution(answer, links) for links in (64, 128)]
    assert min(len(c.frames) * c.eigenvalues[0] for c in chains) / np.mean(rod.K) > 0.5
    assert max(c.residual for c in chains) < chain.BALANCED
    errors = [np.abs(c.positions - answer.positions(np.linspace(0, 1, len(c.positions)))).max() for c in chains]
    assert errors[0] / errors[1] > 3.6
    forces = answer.forces(np.linspace(0, 1, 401))
    give = np.mean(np.sum(forces**2, axis=1)) / 2 * rod.compliance[0]
    assert (4 * chains[1].energy - chains[0].energy) / 3 - give == pytest.approx(answer.energy(), rel=1e-6)


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
    assert recorded["smallest_eigenvalue"] > 0


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


def _lowest_when_twisted(bend, twist, GJ, end, links=64):
    """Two smallest reduced eigenvalues of a weightless unit rod, EI = 1, of constant curvature and twist rate."""
    s = np.linspace(0, 1, links + 1)
    frames = rotations.exp(np.outer(s * bend, [0, 1.0, 0])) @ rotations.exp(np.outer(s * twist, [0, 0, 1.0]))
    rod = cosserat_bvp.Clamped(1.0, np.array([1.0, 1.0, GJ]), 0.0, np.array(end), frames[-1], frames[0])
    force = np.array([0, -GJ * twist * bend, 0])  # n of the twisted ring; its bend is about +y
    answer = chain.equilibrium(rod, frames, -force)
    assert answer.residual < chain.BALANCED
    return answer.eigenvalues[:2]


@pytest.mark.parametrize("GJ", [0.75, 3.0])
def test_discrete_rods_lose_stability_at_the_critical_twists(GJ):
    """A ring held at one place may turn about its tangent there at no cost: one eigenvalue is zero at any twist."""
    straight, ring = stability.twisted_straight_rod() / GJ, stability.ring_twist_angle(1 / GJ)
    for bend, critical, end, free in ((0.0, straight, (0, 0, 1), 0), (2 * np.pi, ring, (0, 0, 0), 1)):
        below, above = (_lowest_when_twisted(bend, share * critical, GJ, end) for share in (0.995, 1.005))
        assert below[free] > NEUTRAL > -NEUTRAL > above[0]
        assert free == 0 or abs(below[0]) < NEUTRAL


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


def test_helix_case_has_its_radius_height_and_coils():
    """cardillo, 02_helix: R0 = 10, height 50, 2 coils; the axis is the direction of the moment when EI = GJ."""
    case = helix.helix_case()
    assert case.length == pytest.approx(np.hypot(2 * 2 * np.pi * 10, 50), rel=1e-14)
    moment = helix.helix_moment(case, clamped_cases.START_FRAME)
    s = np.linspace(0, case.length, 201)
    r, _ = helix.under_end_moment(s, moment, case.stiffness, case.stiffness, clamped_cases.START_FRAME)
    axis = moment / np.linalg.norm(moment)
    assert (r[-1] - r[0]) @ axis == pytest.approx(50, rel=1e-12)
    assert np.linalg.norm(r[-1] - r[0]) == pytest.approx(50, rel=1e-12)  # whole coils end above their start
    across = r - np.outer(r @ axis, axis)
    assert np.linalg.norm(across - across[50] / 2 - across[0] / 2, axis=1) == pytest.approx(10, rel=1e-12)


def test_roll_up_is_the_end_moment_shape_in_the_plane():
    s = np.linspace(0, 3, 7)
    x, z = helix.rolled_up(s, 3.0, 0.2, 1)
    frame = np.array([[0, 0.0, 1], [0, -1.0, 0], [1.0, 0, 0]]).T
    r, _ = helix.under_end_moment(s, [0, -2 * np.pi * 0.2 / 3, 0], 0.2, 0.1, frame)
    np.testing.assert_allclose(r, np.stack([x, 0 * x, z], axis=1), atol=1e-12)
    assert np.hypot(x[-1], z[-1]) < 1e-12


def test_pure_torsion_is_the_end_moment_shape_along_the_axis():
    moment, energy = helix.pure_torsion(2.0, 0.25, 1.2)
    frame = clamped_cases.START_FRAME
    r, R = helix.under_end_moment([2.0], moment * frame[:, 2], 0.1, 0.25, frame)
    np.testing.assert_allclose(r[0], 2 * frame[:, 2], atol=1e-14)
    np.testing.assert_allclose(R[0], frame @ rotations.exp([0, 0, 1.2]), atol=1e-14)
    assert energy == pytest.approx(moment * 1.2 / 2)
