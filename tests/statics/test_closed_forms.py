"""Closed forms and certified values of static rods, approached at fourth order when the mesh is refined.

Closed forms of inextensible rods have a floor, what shear and stretch add: an order is read only well above it.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from reference import helix
from reference.cantilever import chain

from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.cable import Cable

from . import cases

RIGID = 1.0e8  # N, beside EI = 1 N m^2 and L = 1 m; under large loads in proportion, so that no strain exceeds 1e-7
FLOOR = 3.0e-8  # three times what shear and stretch of such a rod leave (1e-8 L, measured with 80 elements)
ORDER = 3.5
# P L^2/EI: drop/L, way back/L, tip slope (rad). Elliptic integrals to 30 digits; K. Mattiasson, Int. J. Numer. Methods Eng. 17
# (1981) 145-153, prints the same five digits.
TIP_LOADED = {
    1: (0.301720773800, 0.056433236283, 0.461351949712),
    10: (0.810609024880, 0.554995597754, 1.430285538804),
    100: (0.941421350862, 0.858578644563, 1.570645884660),
}
# q L^3/EI: drop/L, x/L, tip slope (rad), by shooting EI theta'' = -q (L - s) cos theta to 1e-13.
HEAVY = {
    1: (0.12347140198, 0.99124639535, 0.16511556050),
    10: (0.70019971551, 0.65635376124, 1.05264311720),
    100: (0.93752393540, 0.15922338263, 1.56410732058),
}
# The bend of K.-J. Bathe, S. Bolourchi, Int. J. Numer. Methods Eng. 14 (1979) 961-986, with shear and stretch, by shooting to
# 1e-12: an eighth of a circle of radius 100, clamped along +x, its centre at +y; section 1 x 1, E = 1e7, G = 5e6; 600 along +z.
# Torsion constant: tip. 1/6 is the polar moment of area, 0.141 Saint-Venant's value: apart by 0.5 % of the length at the tip.
BEND45 = {1 / 6: (47.150438574, 15.684800534, 53.474858792), 0.141: (46.896769597, 15.560325404, 53.604858457)}
BEND45_FRAME = np.array([[0.0, 0, 1], [1.0, 0, 0], [0.0, 1, 0]])  # columns d1 = +y, d2 = +z, d3 = +x


def tip(cable, boundary=None, **loads):
    """Tip ``(x, z, slope below x)`` on each mesh, every solve required to be a stable equilibrium."""
    rows = []
    for n in cases.MESHES:
        answer = cases.solved(cases.model(cable, **loads), boundary or cases.cantilever(), n)
        assert answer.verdict.solved, answer.verdict.sentence()
        d3 = answer.configuration.R[-1, :, 2]
        rows.append([*np.asarray(answer.points[-1])[[0, 2]], np.arctan2(-d3[2], d3[0])])
    return np.array(rows)


@pytest.mark.parametrize("load", TIP_LOADED)
def test_tip_loaded_cantilever(load):
    drop, back, slope = TIP_LOADED[load]
    rigid = RIGID * max(1.0, load)
    got = tip(Cable(1.0, 0.0, 1.0, 1.0, rigid, rigid), gravity=cases.WEIGHTLESS, force=(0.0, 0.0, -load))
    errors = np.abs(got - [1 - back, -drop, slope])
    assert np.all(errors[-1] < 1.5e-8 * (1.0 + load))
    orders = cases.order(np.linalg.norm(errors[:, :2], axis=1), FLOOR)
    assert np.all(orders > ORDER)
    assert len(orders) >= (load >= 10)  # smaller loads reach the floor


@pytest.mark.parametrize("weight", HEAVY)
def test_heavy_cantilever(weight):
    """A horizontal cantilever under its own weight q, q L^3/EI from small to large."""
    drop, x, slope = HEAVY[weight]
    got = tip(Cable(1.0, weight / 9.81, 1.0, 1.0, RIGID * weight, RIGID * weight))
    errors = np.abs(got - [x, -drop, slope])
    assert np.all(errors[-1] < 2.2e-8 * weight)
    orders = cases.order(np.linalg.norm(errors[:, :2], axis=1), FLOOR)
    assert np.all(orders > ORDER)
    assert len(orders) >= (weight >= 10)  # smaller weights reach the floor


def test_small_weight_bends_by_the_linear_formula():
    """Tip deflection q L^4/(8 EI): the 1/2 of the strain energy. The next term is of order (q L^3/EI)^2 = 1e-6."""
    got = tip(Cable(1.0, 1e-3 / 9.81, 1.0, 1.0))
    np.testing.assert_allclose(-got[:, 1], 1e-3 / 8, rtol=1e-4)  # 4e-5 of it is shear: 4 EI / (GA L^2) with GA = 1e5 N


@pytest.mark.parametrize("J", BEND45)
def test_bend45(J):
    length = 25 * np.pi
    cable = Cable(length, 0.0, 1e7 / 12, 5e6 * J, 5e6, 1e7, np.array([0.0, 0.01, 0.0]))
    model = cases.model(cable, cases.WEIGHTLESS, (0.0, 0.0, 600.0))
    answers = [cases.solved(model, cases.cantilever(BEND45_FRAME), n) for n in cases.MESHES]
    assert all(a.verdict.solved for a in answers)
    errors = np.array([np.linalg.norm(np.asarray(a.points[-1]) - BEND45[J]) for a in answers]) / length
    assert errors[-1] < 5e-8
    assert np.all(cases.order(errors) > ORDER)


@pytest.mark.parametrize("turns", [0.25, 2.0])
def test_natural_curvature_rolls_up(turns):
    """An end moment M bends a cantilever as natural curvature M/EI does: an arc, exact on any mesh."""
    curvature = 2 * np.pi * turns
    cable = Cable(1.0, 0.0, 1.0, 1.0, natural_curvature=(0.0, curvature, 0.0))
    answer = cases.solved(cases.model(cable, cases.WEIGHTLESS), cases.cantilever(), 40)
    assert answer.verdict.solved
    x, across = helix.rolled_up(answer.s, 1.0, 1.0, turns)
    # curvature about d2 = -y turns d3 = +x towards +z
    np.testing.assert_allclose(answer.points, np.stack([x, 0 * x, across], axis=1), atol=1e-9)


@pytest.mark.parametrize("EA", [1e4, 1e8])
def test_straight_rod_becomes_a_helix(EA):
    """The body moment (0, EI kappa, GJ tau) on the end, as natural strains: an exact helix of two coils (cardillo).

    The more slender the rod (EA L^2/EI), the more steps: 51 and 157.
    """
    case = helix.helix_case()
    frame, shrink = cases.START_FRAME, case.length  # the same helix at unit length
    strain = shrink * np.array([0.0, case.curvature, case.torsion])
    boundary = cases.cantilever(frame)
    model = cases.model(Cable(1.0, 0.0, 1.0, 1.0, EA, EA, strain), cases.WEIGHTLESS)
    answer = cases.solved(model, boundary)
    assert answer.verdict.solved, answer.verdict.sentence()
    r, R = helix.under_end_moment(
        shrink * np.asarray(answer.s), helix.helix_moment(case, frame), case.stiffness, case.stiffness, frame
    )
    np.testing.assert_allclose(answer.points, r / shrink, atol=1e-8)
    np.testing.assert_allclose(answer.configuration.R, R, atol=1e-7)


def test_helix_between_clamps_carries_a_constant_moment():
    """EI and GJ apart, ends clamped where the closed form ends: no force, and the moment of the closed form.

    Shapes and reactions are of fourth order. The moment of a section is that of the element's mean strain: second order.
    There is no force, so it does not matter how rigid the rod is; with 1e8 N rounding would leave forces of 1e-7 N.
    """
    frame, moment, EI, GJ = cases.START_FRAME, np.array([0.5, 1.5, 0.8]), 1.0, 0.6
    end, end_frame = (x[0] for x in helix.under_end_moment([1.0], moment, EI, GJ, frame))
    model = cases.model(Cable(1.0, 0.0, EI, GJ, 1e6, 1e6), cases.WEIGHTLESS)
    errors = []
    for n in cases.MESHES:
        answer = cases.solved(model, cases.clamped(end, end_frame), n)
        assert answer.verdict.solved
        _, (_, f, m), (force, couple) = cases.loads_of(answer)
        r, _ = helix.under_end_moment(answer.s, moment, EI, GJ, frame)
        distances = np.linalg.norm(np.asarray(answer.points) - r, axis=1)
        turned = np.abs(couple[1] - moment).max()
        errors.append([distances.max(), np.abs(m - moment).max(), np.abs(f).max(), np.abs(force).max(), turned])
    assert np.all(np.array(errors[-1]) < [5e-9, 6e-5, 6e-7, 6e-7, 1.5e-7])
    orders = np.log2(np.array(errors)[:-1] / errors[1:])
    assert np.all(orders > [ORDER, 1.95, ORDER, ORDER, ORDER])


@pytest.mark.parametrize("turns", [-1, 0, 1])
def test_pure_torsion(turns):
    """A straight rod twisted by phi + 2 pi turns between its clamps: M = GJ angle/L, energy GJ angle^2/(2 L)."""
    GJ, phi = 0.6, 1.2
    turn = cases.clamped_cases.rotations.about(cases.clamped_cases.X, phi)
    model = cases.model(Cable(1.0, 0.0, 1.0, GJ), cases.WEIGHTLESS)
    answer = cases.solved(model, cases.clamped((1.0, 0.0, 0.0), turn @ cases.START_FRAME), turns=turns)
    moment, energy = helix.pure_torsion(1.0, GJ, phi + 2 * np.pi * turns)
    assert answer.verdict.solved
    got_energy, (_, _, m), (_, reaction) = cases.loads_of(answer)
    np.testing.assert_allclose(got_energy, energy, rtol=1e-10)
    np.testing.assert_allclose(m, np.tile([moment, 0, 0], (40, 1)), atol=1e-8)
    np.testing.assert_allclose(reaction, [[-moment, 0, 0], [moment, 0, 0]], atol=1e-8)


def test_hanging_cable_stretches_under_its_weight():
    """Hung from a clamp, the elongation to the section s is w (L s - s^2/2)/EA; exact at the nodes."""
    w, EA = 0.2 * 9.81, 100.0
    down = np.stack([[1.0, 0, 0], [0.0, -1, 0], [0.0, 0, -1]], axis=1)
    answer = cases.solved(cases.model(Cable(1.0, 0.2, 0.1, 0.25, 1e3, EA)), cases.cantilever(down))
    s = np.asarray(answer.s)
    np.testing.assert_allclose(answer.points[:, 2], -(s + w * (s - s**2 / 2) / EA), atol=1e-12)


@pytest.mark.parametrize("EI", [1e-3, 4e-4])
def test_soft_cable_between_ball_joints_is_a_catenary(EI):
    """Ball joints bend nothing, so bending stiffness moves the chain by an amount proportional to EI/(H L^2) only.

    A cable free to spin about its own axis has a motion without stiffness, which the solve leaves alone.
    """
    span = 0.7
    ends = Boundary.of((jnp.zeros(3), None), (jnp.array([span, 0.0, 0.0]), None))
    errors = []
    for stiffness in (EI, EI / 4):
        answer = cases.solved(cases.model(Cable(1.0, 0.2, stiffness, stiffness)), ends)
        assert answer.verdict.solved, answer.verdict.sentence()
        errors.append(np.abs(np.asarray(answer.points) - chain(1.0, span, np.asarray(answer.s))).max())
        _, _, (force, moment) = cases.loads_of(answer)
        np.testing.assert_allclose(moment, 0, atol=1e-9)
        np.testing.assert_allclose(force.sum(0), [0, 0, 0.2 * 9.81], atol=1e-6)
    assert errors[0] < 1.5 * EI  # m, beside a horizontal pull of 0.7 N
    assert errors[1] < 0.5 * errors[0]
