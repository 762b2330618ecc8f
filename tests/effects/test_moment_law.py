"""Moment laws of any form: moment and energy are the integrals of the given slope, whatever that is, with all derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.optimize import brentq

from scan2flex_jax.effects import BendingLaw, TorsionLaw
from scan2flex_jax.effects.moment_law import WALK, excess_energy, excess_moment, tangent
from scan2flex_jax.fitting.parameters import layout_of
from scan2flex_jax.study import EffectDeclaration, Unknown
from tests.fitting.scenes import BOTH, study_of

from . import scene

L, EI, GJ = 1.0, 0.02, 0.015
AT, FACTOR = jnp.array([1.0, 2.0, 4.5]), jnp.array([0.5, 0.2, 1.7])
DRAWN = np.random.default_rng(3)
ANY = [(np.sort(DRAWN.uniform(0.1, 9.0, n)), np.exp(DRAWN.normal(0.0, 2.0, n))) for n in (8,)]
STIFFNESS = jnp.diag(jnp.array([1e5, 1e5, 1e4, EI, EI, GJ]))


def slope(q):
    """The law as its docstring has it, over EI."""
    return np.interp(q**2, np.r_[0.0, AT] ** 2, np.r_[1.0, FACTOR])


def moment(q):
    return quad(slope, 0.0, q, points=[x for x in map(float, AT) if x < q] or None, epsabs=1e-12)[0]


@pytest.mark.parametrize("q", [0.0, 1.0, 1.7, 8.0])
def test_moment_and_energy_are_integrals_of_the_slope(q):
    breaks = [x for x in map(float, AT) if x < q] or None
    energy = quad(lambda x: (q - x) * slope(x), 0.0, q, points=breaks, epsabs=1e-12)[0]
    assert float(tangent(jnp.array(q), AT, FACTOR)) == pytest.approx(slope(q))
    assert q + float(excess_moment(jnp.array(q), AT, FACTOR)) == pytest.approx(moment(q), abs=1e-12)
    assert q**2 / 2 + float(excess_energy(jnp.array(q**2), AT, FACTOR)) == pytest.approx(energy, abs=1e-12)


@pytest.mark.parametrize(("at", "factor"), ANY)
def test_whatever_the_factors_the_moment_grows_and_the_energy_is_convex(at, factor):
    at, factor = jnp.asarray(at), jnp.asarray(factor)
    q = jnp.linspace(0.0, 12.0, 400)
    assert np.all(np.diff(q + excess_moment(q, at, factor)) > 0)
    law = BendingLaw(at, factor)

    def energy(k):
        strain = jnp.zeros(6).at[3:5].set(k)
        return 0.5 * EI * k @ k + law.strain_energy(strain, STIFFNESS)

    ways = jnp.array([[0.6, 0.8], [-1.0, 0.0]])
    strains = (q[1::20, None, None] * ways).reshape(-1, 2)
    assert np.all(np.linalg.eigvalsh(jax.jit(jax.vmap(jax.hessian(energy)))(strains)) > 0)


@pytest.mark.parametrize("law", [BendingLaw(AT, FACTOR), TorsionLaw(AT, FACTOR)])
def test_derivatives_at_zero_strain_are_zero_and_not_nan(law):
    """The square root of a curvature has none there."""
    at = jnp.zeros(6)
    slopes = jax.jit(lambda e, x: [f(e.strain_energy)(x, STIFFNESS) for f in (jax.grad, jax.hessian)])(law, at)
    for slope in slopes:
        np.testing.assert_array_equal(slope, np.zeros(slope.shape))
    by_law = jax.jit(jax.grad(lambda x: x.strain_energy(at, STIFFNESS)))(law)
    assert all(np.all(np.isfinite(leaf)) for leaf in jax.tree.leaves(by_law))


def test_two_bending_stiffnesses_share_one_law():
    """Along either axis the moment is the axis' stiffness times the law of ``sqrt(k'Kk/EI)``."""
    K = STIFFNESS.at[3, 3].set(0.5 * EI).at[4, 4].set(1.5 * EI)
    law, k = BendingLaw(AT, FACTOR), 3.0
    for axis, part in ((3, 0.5), (4, 1.5)):
        found = jax.grad(law.strain_energy)(jnp.zeros(6).at[axis].set(k), K)[axis] + K[axis, axis] * k
        q = np.sqrt(part) * k
        assert float(found) == pytest.approx(part * EI * k / q * moment(q))


@pytest.mark.parametrize(
    ("kind", "grid", "axis", "stiffness"),
    [("bending_law", "curvature", [0.0, 1.0, 0.0], EI), ("torsion_law", "twist", [0.0, 0.0, 1.0], GJ)],
)
def test_pure_bending_and_pure_twist(kind, grid, axis, stiffness):
    """A turned end alone gives a uniform strain ``turn/L``: the end moment is the law itself."""
    turn, law = 4.8, scene.effect(kind, **{grid: AT, "factor": FACTOR})
    _, _, found = scene.solved(law, gravity=jnp.zeros(3), loaded=False, **scene.turned_end(axis, turn))
    np.testing.assert_allclose(np.linalg.norm(scene.reactions(found)[1], axis=1), stiffness * moment(turn / L), rtol=1e-7)


def sagging_tip(weight):
    """Tip (across, down) in m of a level cantilever of this weight (N/m) by shooting: ``m' = -weight (L - s) cos theta``."""

    q = np.linspace(0.0, 40.0, 40_001)
    m_of_q = EI * np.concatenate([[0.0], np.cumsum(0.5 * (slope(q[1:]) + slope(q[:-1])) * np.diff(q))])

    def rhs(s, y):
        theta, m = y[:2]
        return [np.sign(m) * np.interp(abs(m), m_of_q, q), -weight * (L - s) * np.cos(theta), np.cos(theta), np.sin(theta)]

    def end(m0):
        return solve_ivp(rhs, (0.0, L), [0.0, m0, 0.0, 0.0], rtol=1e-8, atol=1e-10).y[:, -1]

    trial = weight * L**2 * np.linspace(0.2, 0.5, 13)  # the first root belongs to a cable that hangs down without a turn
    above = next(i for i, m in enumerate(trial) if end(m)[1] > 0)
    m0 = brentq(lambda m: end(m)[1], trial[above - 1], trial[above], xtol=1e-9)
    return end(m0)[2:]


def test_a_cantilever_under_its_weight_is_that_of_a_shooting_solution():
    gravity = 1.0
    law = scene.effect("bending_law", curvature=AT, factor=FACTOR)
    tip = scene.solved(law, gravity=jnp.array([0.0, 0.0, -gravity]), **scene.level())[0][-1]
    np.testing.assert_allclose([tip[0], -tip[2]], sagging_tip(0.1 * gravity), atol=1e-3 * L)


def test_the_prior_of_a_fit_is_a_random_walk_about_the_linear_law():
    study = study_of(
        (*BOTH, Unknown("bending_law.factor")), effects=[EffectDeclaration("bending_law", {"curvature": [1.0, 2.0, 4.0, 8.0]})]
    )
    layout = layout_of(study)
    slot, prior = layout.slots[2], layout.prior
    assert prior.at.tolist() == [2, 3, 4, 5]
    np.testing.assert_array_equal(slot.value(np.zeros(4)), np.ones(4))
    drawn = prior.std * np.random.default_rng(0).standard_normal((20_000, 4))
    logs = np.log([slot.value(x) for x in drawn])
    np.testing.assert_allclose(logs.std(axis=0), WALK * np.sqrt(np.arange(1, 5) / 4), rtol=0.03)
    np.testing.assert_allclose(slot.numbers(slot.value(drawn[0])), drawn[0])
