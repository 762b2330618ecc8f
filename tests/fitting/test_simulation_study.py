"""The paper's simulation study (its Section 6.2): EI 0.1 and GJ 0.25 N m^2 from three shapes of the continuous equations.

The shapes come from an independent solver, so the mesh counts: the fit's own number of elements must leave less than 0.1 %.
"""

import jax
import numpy as np
import pytest

from scan2flex_jax.fitting.least_squares import levenberg_marquardt
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.inference import fit
from scan2flex_jax.posterior import branches

from . import scenes

FARTHEST = (0.01, 100.0)  # N m^2, of the paper's guesses of both stiffnesses
COMPILED = "/jax/core/compile/backend_compile_duration"


def recovered(f, within=1e-3):
    return all(abs(f.estimates[name].value / value - 1) < within for name, value in scenes.TRUE.items())


@pytest.fixture(scope="module")
def unguessed():
    return fit(scenes.example())


def test_no_guess(unguessed):
    f = unguessed
    assert recovered(f), f.summary()
    assert f.converged and f.valid is True
    assert all(e.identifiable and not e.at_bound for e in f.estimates.values())
    assert f.poses["unseen"].role == "validate" and f.poses["unseen"].rms < 3e-5  # m, never fitted; the mesh leaves 1e-5
    assert f.rms() < 3e-5
    assert np.isnan(f.rms("none"))


def test_a_stiffness_that_is_left_out_is_told_in_the_result():
    """The shapes are those of 1e5 N, which moves them by less than the mesh."""
    study = scenes.example()
    known = {k: v for k, v in study.cable.items() if k not in ("shear_stiffness", "axial_stiffness")}
    f = fit(scenes.replace(study, cable=known))
    assert recovered(f), f.summary()
    assert "the cable is assumed inextensible and unshearable" in scenes.summary_of(f)
    assert f.calibrated.assumptions and not study.assumptions


@pytest.mark.parametrize("EI", FARTHEST)
def test_every_guess(EI):
    """The corners of the paper's 25: a bad guess costs only time, since the package's own start stands beside it."""
    fits = {GJ: fit(scenes.guessed(scenes.example(), bending_stiffness=EI, torsional_stiffness=GJ)) for GJ in FARTHEST}
    assert [GJ for GJ, f in fits.items() if not recovered(f)] == []


def test_near_guesses_suffice_without_the_own_start():
    """Within a decade of the truth a guess is all that the minimisation needs."""
    problem = Problem(scenes.example())
    goal = problem.goal(np.full(problem.poses.count, 1e-3))
    for guess in ((0.03, 0.08), (0.3, 0.08), (0.03, 0.8), (1.0, 2.0)):
        found = levenberg_marquardt(goal, np.log(guess))
        np.testing.assert_allclose(np.exp(found.shared), [scenes.EI, scenes.GJ], rtol=1e-3)


@pytest.mark.parametrize("method", ["bfgs", "nelder-mead"])
def test_other_methods_reach_the_same_minimum(method, unguessed):
    f = fit(scenes.guessed(scenes.example(), bending_stiffness=0.2, torsional_stiffness=0.2), method)
    assert f.converged and f.method == method
    for name, e in unguessed.estimates.items():
        np.testing.assert_allclose(f.estimates[name].value, e.value, rtol=1e-4)
    np.testing.assert_allclose(f.cost, unguessed.cost, rtol=1e-3)


def test_integrated_distance_recovers_too():
    """The paper's own distance (Eq. 10): its arc lengths are those of the measured polygon, hence 0.5 %."""
    f = fit(scenes.example(), distance="integrated", elements=scenes.ELEMENTS)
    assert recovered(f, 5e-3), f.summary()
    assert f.distance == "integrated"


@pytest.mark.slow
def test_the_hausdorff_distance_brings_the_largest_distance_down():
    """On noisy shapes the fit to the largest distance has a smaller one. It rests on a point or two: a poor estimator, off by
    some per cent where least squares are off by tenths of one."""
    study = scenes.study_of([scenes.BOTH[0]], poses=("plane",))
    noisy = scenes.measured(study, scenes.exact_curves(study, scenes.TRUE), 2e-4)
    least, worst = (fit(noisy, "nelder-mead", distance=d, elements=scenes.ELEMENTS) for d in ("normal", "hausdorff"))
    assert worst.poses["plane"].worst < least.poses["plane"].worst
    assert worst.poses["plane"].rms > least.poses["plane"].rms
    assert worst.estimates["bending_stiffness"].value == pytest.approx(scenes.EI, rel=0.1)
    assert np.isfinite(worst.estimates["bending_stiffness"].std)
    assert any("about the values of this method and distance" in s for s in worst.sentences)


def test_progress_says_which_descent_it_is_of():
    """The costs of the search for other turns are in units of another noise: its lines begin with what they are."""
    lines, study = [], scenes.example()
    fit(branches.with_turns(study, {study.fit_poses[-1].name: 1}), progress=lines.append)
    costs = [float(line.rsplit("cost ", 1)[1]) for line in lines if line.startswith("iteration")]
    assert len(costs) >= 2 and costs == sorted(costs, reverse=True)
    *other, last = [line for line in lines if not line.startswith("iteration")]
    assert last == "noise, discrepancy and parameters together"
    assert other and all(line.startswith("other turns: iteration ") for line in other)


def test_new_values_compile_nothing():
    """Another guess, range, density, gravity, length and shape, on the same way through a fit: the same compiled functions."""
    study, events = scenes.study_of(), []
    curves = scenes.exact_curves(study, scenes.TRUE)

    def fitted(guess, density, length, gravity, seed):
        ranged = [scenes.Unknown(u.name, guess=guess, low=0.1 * guess, high=100 * guess) for u in study.unknowns]
        other = scenes.study_of(ranged, length_density=density, length=length)
        other = scenes.measured(scenes.replace(other, gravity=np.array([gravity, 0.0, -9.8])), curves, 3e-4, seed=seed)
        return fit(other, elements=scenes.ELEMENTS)

    def listen(event, duration, **more):
        if event == COMPILED and listening:
            events.append(more)

    fitted(0.2, 0.21, 1.001, 0.1, 0)
    listening = True
    jax.monitoring.register_event_duration_secs_listener(listen)
    fitted(0.21, 0.2105, 1.0011, 0.11, 1)
    jax.jit(lambda x: x * 3.25 + 1)(1.0)  # the listener hears what is compiled
    listening = False
    assert len(events) == 1, events
