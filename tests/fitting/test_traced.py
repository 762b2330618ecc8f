"""The traced fit takes the steps of the ordinary one, in one compiled program for many guesses, noises and poses."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax import Scan2FlexError, Tolerance, Unknown
from scan2flex_jax.fitting import minimise, traced_problem
from scan2flex_jax.fitting.least_squares import levenberg_marquardt
from scan2flex_jax.fitting.problem import Problem

from . import scenes

NEAR, SEVERAL = (0.05, 0.5), ((0.05, 0.5), (0.3, 0.1), (100.0, 0.01))  # guesses of EI and GJ (N m^2); the last leads nowhere
ELEMENTS = scenes.ELEMENTS
POSES = ("plane", "twist-90")


@pytest.fixture(scope="module")
def study():
    return scenes.study_of(poses=POSES)


@pytest.fixture(scope="module")
def ready(study):
    return traced_problem(study, elements=ELEMENTS)


def alone(study, guess, noise=None, **numbers):
    """The ordinary descent from a guess alone."""
    problem = Problem(study, ELEMENTS)
    sigma = problem.first_scale() if noise is None else np.full(problem.poses.count, noise)
    rest = problem.layout.shared - problem.layout.unknowns
    return levenberg_marquardt(problem.goal(sigma), np.r_[np.log(guess), np.zeros(rest)], **numbers)


def same(traced, host):
    x = np.r_[host.shared, host.local.ravel()]
    np.testing.assert_allclose(traced.x, x, atol=1e-8)
    np.testing.assert_allclose(traced.cost, host.cost, rtol=1e-8)
    assert int(traced.iterations) == host.iterations


@pytest.mark.slow
def test_it_takes_the_steps_of_the_ordinary_descent_for_many_guesses(study, ready):
    """And stalls where that does."""
    problem, _ = ready
    starts = jnp.log(jnp.array(SEVERAL))[:, None]
    many = jax.vmap(minimise, in_axes=(None, 0))(problem, starts)
    assert np.asarray(many.converged).tolist() == [True, True, False]
    assert np.asarray(many.verdict.code).tolist() == [0, 0, 0]  # its poses are solved: it is the descent that is stuck
    host = alone(study, SEVERAL[2])
    assert host.stalled and not host.converged and np.isfinite(host.cost)
    for k in range(2):
        single = minimise(problem, starts[k])
        np.testing.assert_allclose(many.x[k], single.x, atol=1e-9)
        assert int(many.iterations[k]) == int(single.iterations)
        same(single, alone(study, SEVERAL[k]))


@pytest.mark.slow
def test_poses_and_noise_are_vmapped(study):
    """Curves with noise, and clamps that are nearly known under their priors: each sample is the descent alone."""
    near = replace(study, tolerance=Tolerance(length=2e-3, clamp_rotation=0.02))
    curves = [p.curve.points for p in near.poses]
    studies = [scenes.measured(near, curves, 1e-3, seed, stated=s) for seed, s in ((1, 1e-3), (2, 2e-3))]
    problems = [traced_problem(s, elements=ELEMENTS)[0] for s in studies]
    arrays, fixed = zip(*(eqx.partition(p, eqx.is_array_like) for p in problems), strict=True)
    start = np.r_[np.log(NEAR), np.zeros(len(problems[0].logs) - 2)][None]
    many = jax.jit(jax.vmap(lambda a: minimise(eqx.combine(a, fixed[0]), start)))(jax.tree.map(lambda *x: np.stack(x), *arrays))
    for k, (s, noise) in enumerate(zip(studies, (1e-3, 2e-3), strict=True)):
        host = alone(s, NEAR, noise)
        assert bool(many.converged[k]) == host.converged and np.any(host.local != 0)
        same(jax.tree.map(lambda x, k=k: x[k], many), host)


@pytest.mark.slow
def test_parameters_pushed_outwards_stay_at_their_bounds(study):
    """EI is 0.1: with a range from 0.2 on it ends there, and GJ is the best given that EI."""
    narrow = replace(study, unknowns=(Unknown("bending_stiffness", low=0.2, high=1.0), study.unknowns[1]))
    problem, _ = traced_problem(narrow, elements=ELEMENTS)
    found, host = minimise(problem, np.log([[0.4, 0.5]])), alone(narrow, (0.4, 0.5))
    assert float(found.x[0]) == pytest.approx(np.log(0.2), abs=1e-12)
    np.testing.assert_allclose(found.x, host.shared, atol=1e-8)


@pytest.mark.parametrize(
    ("change", "options", "sentence"),
    [
        ({"tolerance": Tolerance(length=1e-3)}, {}, "states no noise to weigh them against: give noise in m"),
        ({}, {"noise": 0.0}, "noise is 0.0: give a positive number in m, or None"),
        ({}, {"distance": "hausdorff"}, "distance is 'hausdorff': give one of normal, integrated"),
        ({"unknowns": (), "cable": {**scenes.example().cable, **scenes.TRUE}}, {}, "nothing to fit"),
    ],
)
def test_wrong_arguments_are_one_sentence(study, change, options, sentence):
    with pytest.raises(Scan2FlexError, match=sentence):
        traced_problem(replace(study, **change), **options)
