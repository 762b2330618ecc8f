"""Effects with memory: closed forms of one slider, of the standard linear solid, and of what laboratories print."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from scan2flex_jax.effects import Dahl, Friction, MemorySet, Relaxation, TorsionFriction
from scan2flex_jax.effects.dahl import ROUNDING
from scan2flex_jax.effects.sliders import SPREAD
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.geometry import lie
from scan2flex_jax.posterior.loops import cycles, loops_of
from scan2flex_jax.rod.model import CableModel
from scan2flex_jax.statics.solve import equilibrium

from . import scene

EI, GJ, SHARE, SLIP = 0.02, 0.015, 0.6, 1.0
LOOP_SLIP, MOST = 1.5, 4.0  # 1/m, of the loops
STIFFNESS = jnp.diag(jnp.array([1e5, 1e5, 1e4, EI, EI, GJ]))
SHARP = 1e-9  # rounding of a knee that closed forms do not have


def one_slider(cls=Friction, rounding=SHARP):
    return cls(SHARE, SLIP, spread=(1.0,), rounding=rounding)


@jax.jit
def driven(effect, strains, held=0.0):
    """Forces (m, 6) along a path of strains (m, 6), each after the one before it."""

    def pose(left, strain):
        extra = jax.grad(effect.energy_given)(strain, STIFFNESS, left)
        return effect.leaves(strain, STIFFNESS, left, jnp.asarray(held)), STIFFNESS @ strain + extra

    return jax.lax.scan(pose, effect.at_first(1)[0], strains)[1]


def bent(effect, curvatures, axis=4):
    """Moments over EI (m,) along a path of curvatures about one axis."""
    strains = jnp.zeros((len(curvatures), 6)).at[:, axis].set(jnp.asarray(curvatures))
    return np.asarray(driven(effect, strains))[:, axis] / float(STIFFNESS[axis, axis])


@pytest.mark.parametrize(("cls", "axis"), [(Friction, 3), (Friction, 4), (TorsionFriction, 5)])
def test_one_slider_loads_and_unloads_as_its_closed_form(cls, axis):
    """Elastic up to the threshold, then with the stiffness of the rest; back elastically over twice the threshold."""
    rest = 1 - SHARE
    path = [0.5, 2.0, 4.0, 3.0, 1.5, -1.0, -4.0, -3.5, 0.0]
    slider = [0.5, 1.0, 1.0, 0.0, -1.0, -1.0, -1.0, -0.5, 1.0]
    expected = [rest * k + SHARE * s for k, s in zip(path, slider, strict=True)]
    np.testing.assert_allclose(bent(one_slider(cls), path, axis), expected, atol=1e-8)


@pytest.mark.parametrize(("cls", "axis"), [(Friction, 4), (TorsionFriction, 5)])
def test_a_slider_with_a_set_begins_from_it(cls, axis):
    """Loading begins at the set in place of zero, and is forgotten once the slider has slipped."""
    first = jnp.array([0.0, 0.8]) if cls is Friction else jnp.array(0.8)
    effect = cls(SHARE, SLIP, first, spread=(1.0,), rounding=SHARP)
    path, slider = [0.0, 0.5, 2.0, 0.5], [-0.8, -0.3, 1.0, -0.5]
    expected = [(1 - SHARE) * k + SHARE * s for k, s in zip(path, slider, strict=True)]
    np.testing.assert_allclose(bent(effect, path, axis), expected, atol=1e-8)


def test_dashpots_with_a_set_pull_towards_it():
    effect = Relaxation(SHARE, 60.0, jnp.array([0.3, -0.2, 0.5]))
    (still,) = np.asarray(driven(effect, jnp.zeros((1, 6))))
    np.testing.assert_allclose(still[3:], -SHARE * np.array([EI, EI, GJ]) * [0.3, -0.2, 0.5], atol=1e-12)


@pytest.mark.parametrize("spread", [(1.0,), SPREAD])
def test_masings_rule_holds_on_the_return_branch(spread):
    """From a turn at k0 the moment changes along the first loading curve, twice as large: m(k0) - m(k) = 2 m_0((k0 - k)/2)."""
    effect, top = Friction(SHARE, SLIP, spread=spread, rounding=SHARP), 3.0
    for k in (2.9, 2.2, 1.0, 0.1, -1.5, -3.0):
        (first,) = bent(effect, [(top - k) / 2])
        turned, back = bent(effect, [top, k])
        assert turned - back == pytest.approx(2 * first, abs=1e-7)


def test_a_curvature_vector_returns_radially():
    """Bent about d1 and then about d2: the slider follows along the straight line between, and pulls along it."""
    k1, k2 = np.array([3.0, 0.0]), np.array([3.0, 4.0])
    q1 = k1 - SLIP * np.array([1.0, 0.0])
    pull = (k2 - q1) / np.linalg.norm(k2 - q1)
    strains = jnp.zeros((2, 6)).at[:, 3:5].set(jnp.stack([jnp.asarray(k1), jnp.asarray(k2)]))
    found = np.asarray(driven(one_slider(), strains))[1, 3:5] / EI
    np.testing.assert_allclose(found, (1 - SHARE) * k2 + SHARE * SLIP * pull, atol=1e-7)


def integrated(path):
    """Moments over the stiffness (m,) along a path of strains, by Dahl's differential equation slip dz = dx - z |dx|."""
    out, x, z = [], 0.0, 0.0
    for target in path:
        way = np.sign(target - x)
        z = solve_ivp(lambda s, z, w=way: (w - z) / SLIP, (0.0, abs(target - x)), [z], rtol=1e-11, atol=1e-13).y[0, -1]
        out.append((1 - SHARE) * target + SHARE * SLIP * z)
        x = target
    return out


@pytest.mark.parametrize("axis", [3, 4, 5])
def test_dahls_law_is_its_differential_equation_on_the_first_way_and_back(axis):
    path = [0.5, 2.0, 4.0, 3.9, 3.0, 1.5, -1.0, -4.0, -3.5, 0.0]
    np.testing.assert_allclose(bent(Dahl(SHARE, SLIP, rounding=1e-6), path, axis), integrated(path), atol=1e-5)
    np.testing.assert_allclose(bent(Dahl(SHARE, SLIP), path, axis), integrated(path), atol=0.5 * ROUNDING * SHARE * SLIP)


def test_dahl_acts_about_each_axis_by_itself():
    """As Newton has it: a bend about d1 leaves the friction about d2 as it was."""
    effect = Dahl(SHARE, SLIP, rounding=1e-9)
    strains = jnp.zeros((3, 6)).at[:, 3].set(jnp.array([1.0, 3.0, -1.0])).at[:, 4].set(0.7)
    both, alone = np.asarray(driven(effect, strains)), integrated([1.0, 3.0, -1.0])
    np.testing.assert_allclose(both[:, 3] / EI, alone, atol=1e-5)
    np.testing.assert_allclose(both[:, 4] / EI, integrated([0.7])[0], atol=1e-5)


def test_the_stiffness_at_a_turn_is_more_than_the_first_one():
    """dm/dk = B (1 - share + share (1 + z)) on the way back from z: Masing's rule would give B."""
    k0, step = 6.0, 1e-3
    first, back = bent(Dahl(SHARE, SLIP, rounding=1e-5), [k0, k0 - step])
    z = 1.0 - np.exp(-k0 / SLIP)
    assert (first - back) / step == pytest.approx(1 + SHARE * z, rel=1e-3)


def test_a_turn_is_rounded_so_that_the_stiffness_is_continuous():
    """The tangent stiffness about a turn, over B: it jumps by 2 share z without the rounding, and by nothing with it."""
    effect = Dahl(SHARE, SLIP)
    left = effect.leaves(jnp.zeros(6).at[4].set(3.0), STIFFNESS, effect.without_history(1)[0], jnp.array(0.0))
    at = jnp.asarray(3.0 + ROUNDING * SLIP * np.linspace(-1.5, 1.5, 301))

    @jax.jit
    @jax.vmap
    def tangent(k):
        return jax.hessian(lambda k: effect.energy_given(jnp.zeros(6).at[4].set(k), STIFFNESS, left))(k) / EI

    slopes = np.asarray(tangent(at))
    assert slopes.max() - slopes.min() == pytest.approx(2 * SHARE * (1 - np.exp(-3.0 / SLIP)), rel=0.05)
    assert np.abs(np.diff(slopes)).max() < 0.02


@pytest.mark.parametrize("effect", [Friction(SHARE, SLIP), Dahl(SHARE, SLIP), Relaxation(SHARE, 60.0)])
def test_without_history_and_strain_there_is_no_force_and_no_nan(effect):
    left, still = effect.without_history(1)[0], jnp.zeros(6)

    @jax.jit
    def slopes(effect, strain):
        force, by_effect = jax.grad(lambda x, e: e.energy_given(x, STIFFNESS, left), argnums=(0, 1))(strain, effect)
        return force, by_effect, jax.jacfwd(effect.leaves, argnums=(0, 2))(strain, STIFFNESS, left, jnp.array(1.0))[0]

    force, *others = slopes(effect, still)
    np.testing.assert_array_equal(force, np.zeros(6))
    assert all(np.all(np.isfinite(x)) for x in jax.tree.leaves(others))


@pytest.mark.parametrize("cls", [Friction, Dahl])
def test_the_energy_stays_convex_however_the_cable_was_bent(cls):
    effect, rng = cls(SHARE, SLIP), np.random.default_rng(0)
    left = jnp.asarray(rng.normal(0.0, 2.0, (4, 2)) if cls is Friction else [rng.normal(0.0, 2.0, 3), rng.uniform(-1, 1, 3)])

    def energy(k):
        strain = jnp.zeros(6).at[3:5].set(k)
        return 0.5 * EI * k @ k + effect.energy_given(strain, STIFFNESS, left)

    strains = jnp.asarray(np.random.default_rng(1).normal(0.0, 3.0, (200, 2)))
    least = np.linalg.eigvalsh(jax.jit(jax.vmap(jax.hessian(energy)))(strains))[:, 0]
    assert np.all(least > 0.99 * (1 - SHARE) * EI)


def test_a_held_pose_relaxes_as_a_standard_linear_solid():
    """The moment of a pose that is taken again falls from EI k to (1 - share) EI k, exponentially."""
    for held in (0.0, 20.0, 300.0, 1e5):
        effect = Relaxation(SHARE, 60.0)
        strains = jnp.zeros((2, 6)).at[:, 4].set(2.0)
        m = np.asarray(driven(effect, strains, held))[:, 4] / EI
        np.testing.assert_allclose(m, [2.0, 2.0 * (1 - SHARE + SHARE * np.exp(-held / 60.0))])


def test_memory_set_is_the_relaxation_that_is_complete_between_poses():
    """`memory_set` keeps a part of the pose before, whatever was before that. A relaxation that is complete between poses is
    the same set: both pull towards the last curvature with share times EI k. Friction remembers poses before that too."""
    last, now = 2.0, 0.5
    strains = jnp.zeros((2, 6)).at[:, 4].set(jnp.array([last, now]))
    m = np.asarray(driven(Relaxation(SHARE, 1.0), strains, 1e6))[:, 4] / EI
    kept = MemorySet(SHARE, jnp.array([[0.0, last, 0.0]]))
    assert m[1] == pytest.approx(now - float(kept.memory) * float(kept.previous[0, 1]))
    once = jnp.zeros((3, 6)).at[:, 4].set(jnp.array([last, 0.0, now]))
    assert np.asarray(driven(Relaxation(SHARE, 1.0), once, 1e6))[2, 4] / EI == pytest.approx(now)  # forgot the pose before
    assert bent(one_slider(), [last, 0.0, now])[2] != pytest.approx(bent(one_slider(), [0.0, now])[1])  # friction has not


@pytest.mark.parametrize(("first", "expected"), [(0.2, SHARE * 0.2), (5.0, SHARE / (1 - SHARE) * SLIP)])
def test_a_cable_from_a_drum_without_loads_keeps_the_bend_that_its_sliders_hold(first, expected):
    """Its moment is zero: (1 - share) k = share (set - k) while nothing slips, and share slip once all have slipped."""
    drum = scene.effect("friction", share=SHARE, slip_curvature=SLIP, initial_set=jnp.array([0.0, first]))
    _, _, free = scene.solved(drum, gravity=jnp.zeros(3), loaded=False, **scene.level())
    turned = np.asarray(lie.so3_log(free.configuration.R[0].T @ free.configuration.R[-1]))
    np.testing.assert_allclose(turned, [0.0, expected * float(scene.CABLE.length), 0.0], atol=1e-6)


def test_a_pose_after_another_model_is_refused():
    free = scene.solved()[2]
    with pytest.raises(Scan2FlexError, match="after is an equilibrium of another model or mesh"):
        equilibrium(CableModel(scene.CABLE, jnp.zeros(3), Friction(0.3, 1.0)), scene.straight(), elements=16, after=free)


@pytest.mark.parametrize(("axis", "B"), [(4, EI), (5, GJ)])
def test_the_cycles_of_dahl(axis, B):
    """Following: 4 share B slip (A - slip tanh(A/slip)). First: slip z integrated over the three ways, z(0) = 0."""
    first, following = cycles(Dahl(SHARE, LOOP_SLIP), STIFFNESS, axis, MOST)
    scale = SHARE * B * LOOP_SLIP
    assert following == pytest.approx(4 * scale * (MOST - LOOP_SLIP * np.tanh(MOST / LOOP_SLIP)), rel=2e-3)
    work, z = 0.0, 0.0
    for way, length in ((1, MOST), (-1, 2 * MOST), (1, MOST)):
        gone = 1 - np.exp(-length / LOOP_SLIP)
        work += way * scale * (way * length - (way - z) * LOOP_SLIP * gone)
        z += (way - z) * gone
    assert first == pytest.approx(work, rel=2e-3)
    assert first != pytest.approx(following, rel=0.05)


def test_the_cycles_of_one_slider():
    """A following cycle dissipates 4 share EI slip (A - slip); a first one slips less, and keeps what its slider stores."""
    first, following = cycles(Friction(SHARE, LOOP_SLIP, spread=(1.0,), rounding=1e-9), STIFFNESS, 4, MOST)
    assert following == pytest.approx(4 * SHARE * EI * LOOP_SLIP * (MOST - LOOP_SLIP), rel=1e-6)
    slipped = 3 * (MOST - LOOP_SLIP) + (MOST - 2 * LOOP_SLIP)  # the last way, from -A to 0, sticks over 2 slip
    assert first == pytest.approx(SHARE * EI * LOOP_SLIP * slipped + 0.5 * SHARE * EI * LOOP_SLIP**2, rel=1e-6)


def test_readings_name_stick_and_slip_and_the_standard_linear_solid():
    cable = scene.CABLE
    effects = (Friction(SHARE, LOOP_SLIP), TorsionFriction(0.4, 0.5), Relaxation(0.3, 60.0))
    found = []
    for effect in effects:
        e = equilibrium(CableModel(cable, scene.DOWN, effect), scene.pose(), elements=12)
        (*first, last) = loops_of([(e.rod, e.configuration)])
        found.append({loop.of: loop.values for loop in (*first, last)})
    B, G = float(np.mean(cable.bending_stiffness)), float(cable.torsional_stiffness)
    assert found[0]["bending"]["stick stiffness"] == (pytest.approx(B), "N m^2")
    assert found[0]["bending"]["slip stiffness"] == (pytest.approx(0.4 * B), "N m^2")
    assert found[0]["bending"]["critical strain"] == (pytest.approx(LOOP_SLIP), "1/m")
    assert found[1]["twist"]["slip stiffness"] == (pytest.approx(0.6 * G), "N m^2")
    assert found[2]["bending"]["K_inf"] == (pytest.approx(0.7 * B), "N m^2")
    assert found[2]["twist"]["K_1"] == (pytest.approx(0.3 * G), "N m^2")
    assert found[2]["twist"]["tau"] == (60.0, "s")


def test_a_rod_without_memory_has_no_loop():
    e = equilibrium(CableModel(scene.CABLE, scene.DOWN), scene.pose(), elements=12)
    assert loops_of([(e.rod, e.configuration)]) == ()
