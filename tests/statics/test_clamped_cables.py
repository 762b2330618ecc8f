"""Cables between two clamps under gravity: certified cases, collocation of the continuous rod, and hard starts.

The references (`reference.clamped_cases`, scipy's `solve_bvp`) share no code with the package. A twisted clamped cable
has several stable equilibria, so each test says which start it uses and which branch it expects.
"""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import optimistix as optx
import pytest
from reference import clamped_cases, rotations, write_values

from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.statics.solve import equilibrium
from scan2flex_jax.statics.starts import curve_start
from scan2flex_jax.statics.verdict import SOLVED

from . import cases

HOUSE, POSES = ("H1", "H2", "H3", "H4"), ("P1", "P2", "P3")
STIFF = 1.0e7  # N: stretches the house cases, which the reference has inextensible, by less than 1e-7
ORDER = 3.5
curve_start = eqx.filter_jit(curve_start)


def pinned(name, n):
    """The case solved from the reference's own positions, and the reference."""
    model, boundary = cases.reference_case(name, STIFF)
    reference = write_values.load(name)
    start = curve_start(jnp.array(reference["positions"]), boundary, 0, n)
    values = {key: np.array(reference[key]) for key in ("positions", "forces", "moments", "energy")}
    return cases.solved(model, boundary, n, start), values


def distance(answer, reference):
    """Largest distance (m) at 11 stations, every other one of the reference's."""
    return np.linalg.norm(cases.at_stations(answer.points) - reference["positions"][::2], axis=1).max()


@pytest.fixture(scope="module")
def refined():
    """Each case on each mesh: ``(answer, reference, loads)``."""
    table = {}
    for name in HOUSE + POSES:
        rows = [pinned(name, n) for n in cases.MESHES]
        table[name] = [(answer, reference, cases.loads_of(answer)) for answer, reference in rows]
    return table


@pytest.mark.parametrize("name", HOUSE + POSES)
def test_positions_energy_and_reactions_at_fourth_order(refined, name):
    """The part after the root section pulls on the clamp with n(0), m(0), so the clamp's reaction is their negative."""
    errors = []
    for answer, reference, (energy, _, (force, moment)) in refined[name]:
        assert answer.verdict.solved, answer.verdict.sentence()
        errors.append(
            [
                distance(answer, reference),
                abs(float(energy - reference["energy"])),
                np.abs(force[0] + reference["forces"][0]).max(),
                np.abs(moment[0] + reference["moments"][0]).max(),
                np.abs(force[1] - reference["forces"][-1]).max(),
                np.abs(moment[1] - reference["moments"][-1]).max(),
            ]
        )
    orders = cases.order(errors)
    assert orders.size == 6
    assert np.all(orders > ORDER), orders
    scale = np.abs(reference["forces"]).max()
    assert np.all(np.array(errors[-1])[1:] < 4e-5 * scale)


@pytest.mark.parametrize("name", HOUSE + POSES)
def test_forty_elements_place_the_cable_to_a_hundred_thousandth(refined, name):
    """Measured: at most 1.5e-6 L with 40 and 2.3e-5 with 20 elements; H4, the softest, has 7e-6 and 1.1e-4."""
    assert distance(*refined[name][1][:2]) < (1.5e-5 if name == "H4" else 3e-6)
    assert distance(*refined[name][0][:2]) < (2.5e-4 if name == "H4" else 5e-5)


@pytest.mark.parametrize("name", HOUSE + POSES)
def test_section_forces_along_the_cable(refined, name):
    """At the nodes, the mean of the two elements beside: second order, unlike the reactions and the shapes."""
    errors = []
    for _, reference, (_, (_, f, m), _) in refined[name]:
        stride = len(f) // 10
        for_, mom = ((np.asarray(x)[stride - 1 : -1 : stride] + np.asarray(x)[stride::stride]) / 2 for x in (f, m))
        inner = slice(2, -2, 2)
        off = (for_ - reference["forces"][inner], mom - reference["moments"][inner])
        errors.append([np.abs(x).max() for x in off])
    assert np.all(cases.order(errors) > 1.9)


@pytest.mark.parametrize("name", HOUSE + POSES)
def test_reactions_balance_the_weight(refined, name):
    """Forces sum to minus the weight and moments about the origin to minus that of the weight, on any mesh."""
    for answer, _, (_, _, (force, moment)) in refined[name]:
        weight = clamped_cases.CASES[name].weight
        np.testing.assert_allclose(force.sum(0), [0, 0, weight], atol=1e-7)
        load = answer.rod.load
        turned = np.cross(answer.points, load.force) + np.cross(answer.configuration.R[:, :, 2], load.lever)
        got = moment.sum(0) + np.cross(answer.points[-1], force[1])
        np.testing.assert_allclose(got, -turned.sum(0), atol=1e-7)


def test_a_loop_as_start_gives_another_branch():
    """H1's clamps also hold a full turn of twist or a loop; a start with a turn leads there, and it is stable too."""
    model, boundary = cases.reference_case("H1", STIFF)
    answer = cases.solved(model, boundary, turns=1)
    assert answer.verdict.solved
    assert float(answer.energy) > 0.2


SWEEP = [(EI, GJ) for EI in (0.01, 1.0, 100.0) for GJ in (0.01, 1.0, 100.0)]


def test_four_poses_over_four_decades_of_stiffness():
    """Generic starts, twists of 0, +-90 and 45 degrees: stable or an honest code, at least 35 of 36 solved.

    Its nodes, without their frames and forces, are a start from which an equilibrium is found in a few steps.
    """
    codes, again = [], []
    for pose in cases.four_poses():
        boundary = cases.clamped(pose.end, pose.frame)
        for EI, GJ in SWEEP:
            answer = cases.solved(cases.model(Cable(1.0, 0.2, EI, GJ)), boundary)
            assert np.all(np.isfinite(answer.points)), (pose, EI, GJ)
            code = int(answer.verdict.code)
            assert code != SOLVED or (int(answer.verdict.negative) == 0 and answer.verdict.out_of_balance < 1e-6)
            codes.append(code)
            if code == SOLVED:
                found = cases.solved(cases.model(Cable(1.0, 0.2, EI, GJ)), boundary, start=curve_start(answer.points, boundary))
                again.append(int(found.verdict.steps) if found.verdict.solved else 1000)
    assert codes.count(SOLVED) >= 35, np.reshape(codes, (4, 9))
    assert max(again) <= 40, again


def test_a_stiff_rod_is_found_again_from_its_own_nodes():
    """A steel rod of 10 mm bent to 0.6 L: the tension that a start does not know makes its Hessian indefinite at first, which
    is no saddle. A push off it ended nowhere within 200 steps."""
    model = cases.model(Cable(1.0, 0.617, 103.0, 78.5, 1.65e7, 1.65e7))
    boundary = cases.clamped((0.6, 0.0, 0.0), cases.START_FRAME)
    rod = cases.solved(model, boundary)
    again = cases.solved(model, boundary, start=curve_start(rod.points, boundary))
    assert rod.verdict.solved
    assert again.verdict.solved
    assert int(again.verdict.steps) <= 20
    np.testing.assert_allclose(again.points, rod.points, atol=1e-9)


def changed(model, part, share):
    """The model with the stiffness or the density of its cable larger by ``share``."""
    return eqx.tree_at(lambda m: getattr(m.cable, part), model, replace_fn=lambda value: value * (1.0 + share))


@pytest.mark.parametrize("share", [1e-9, 1e-6, 1e-3])
def test_no_part_of_a_short_way_is_missing(share):
    """Against the solution from the generic start, which is far, up to rounding; at the solution, a step and a look."""
    model, boundary = cases.reference_case("P3")
    old = cases.solved(model, boundary)
    assert int(cases.solved(model, boundary, start=old.configuration).verdict.steps) == 2
    for part in ("bending_stiffness", "torsional_stiffness", "length_density"):
        new = cases.solved(changed(model, part, share), boundary, start=old.configuration)
        far = cases.solved(changed(model, part, share), boundary)
        way = np.max(np.abs(np.asarray(far.points - old.points)))
        left = np.max(np.abs(np.asarray(new.points - far.points)))
        assert left < 1e-3 * way + 1e-12, (part, left / way)


@pytest.mark.slow
def test_newton_and_bfgs_agree():
    """To 1e-8 L, from the equilibrium displaced by 1 % of the length. BFGS sees the energy alone, which a cable that does not
    stretch ill-conditions."""
    model, boundary = cases.reference_case("P1")
    newton = cases.solved(model, boundary, 20)
    bump = 0.01 * np.sin(np.pi * np.linspace(0.0, 1.0, 21))[:, None] * np.array([0.3, 0.8, 0.5])
    start = newton.configuration._replace(r=newton.configuration.r + jnp.array(bump))
    bfgs = equilibrium(model, boundary, start=start, elements=20, solver=optx.BFGS(1e-8, 1e-8))
    assert bfgs.verdict.solved, (bfgs.verdict.sentence(), float(bfgs.verdict.out_of_balance))
    np.testing.assert_allclose(bfgs.points, newton.points, atol=1e-8)


SADDLES = [(1e-3, 0.0, (0.1, 0.1)), (0.1, 0.0, (0.1, 0.12)), (0.1, 4.0, (0.1, 0.1))]  # shortening, twist (rad), EI


@pytest.mark.parametrize(("shortening", "twist", "EI"), SADDLES)
def test_a_saddle_is_left(shortening, twist, EI):
    """Exactly straight and compressed far beyond Euler's load, which shortens it by 4e-5 only, without gravity.

    With one bending stiffness the plane of buckling is free: the answer has a motion that costs no energy.
    """
    length = 1.0 - shortening
    boundary = cases.clamped((length, 0.0, 0.0), rotations.about(np.eye(3)[0], twist) @ cases.START_FRAME)
    model = cases.model(Cable(1.0, 0.0, EI, 0.25), cases.WEIGHTLESS)
    start = cases.straight(boundary, length, 40, twist)
    negative, _, _ = cases.stability(model, boundary, start, 3)
    assert int(negative) > 0
    answer = cases.solved(model, boundary, start=start)
    assert answer.verdict.solved, answer.verdict.sentence()
    assert np.abs(answer.points[:, 1:]).max() > 0.3 * np.sqrt(shortening)


@pytest.mark.parametrize("apart", [1.001, 1.2, 3.0])
def test_clamps_out_of_reach(apart):
    """The cable is stretched, or the solve says that it failed; nothing becomes NaN."""
    boundary = cases.clamped((apart, 0.0, 0.0), cases.START_FRAME)
    cable = Cable(1.0, 0.2, 0.1, 0.25)
    answer = cases.solved(cases.model(cable), boundary)
    energy, (_, f, _), (force, _) = cases.loads_of(answer)
    for x in (answer.points, energy, f, force, answer.verdict.out_of_balance):
        assert np.all(np.isfinite(x))
    if answer.verdict.solved:
        np.testing.assert_allclose(f[:, 0], cable.axial_stiffness * (apart - 1), rtol=2e-2)  # it sags by a little more


def test_new_values_of_the_same_shapes_never_retrace():
    boundary = cases.clamped((0.6, 0.1, 0.0), cases.START_FRAME)
    cases.solved(cases.model(Cable(1.0, 0.2, 0.1, 0.25)), boundary)
    before = len(cases.traces)
    for k in range(3):
        cable = Cable(1.0 + 0.1 * k, 0.3, (0.1, 0.2 + k), 0.3, 1e4, 1e5, (0.1 * k, 0.0, 0.0), 1e-3)
        boundary = cases.clamped((0.6, 0.1 * k, 0.0), rotations.about(np.eye(3)[0], 0.1 * k) @ cases.START_FRAME)
        cases.solved(cases.model(cable, (0.1, 0.0, -9.0), (0.0, 0.1, 0.0), 0.3 + 0.1 * k), boundary)
    assert len(cases.traces) == before
