"""Estimates of effects that exceed their usual size come from the data, not from the prior of that size."""

import numpy as np
import pytest
from reference import clamped_cases

from scan2flex_jax.diagnosis.refit import freed, refit
from scan2flex_jax.diagnosis.residual import Law
from scan2flex_jax.diagnosis.sensitivity import Bench, Component
from scan2flex_jax.fitting import fit
from scan2flex_jax.fitting.noise import Noise

from . import scenes

pytestmark = pytest.mark.slow
TILT = np.radians(60.0)  # between the gravity that is declared and the true one: a uniform load as large as the weight


def test_a_strong_effect_does_not_draw_the_stiffness_to_its_usual_size():
    """Shapes under a uniform load give its sum with the weight over EI, and no more. The prior of a load of usual size makes
    half of EI and of the sum out of that, with a narrow interval; without it nothing is known of EI."""
    declared = 9.81 * np.array([np.sin(TILT), 0.0, -np.cos(TILT)])
    fitted = fit(scenes.study(gravity=tuple(declared)))
    bench = Bench(fitted.problem, fitted.minimum)
    vector = np.r_[fitted.minimum.shared, np.asarray(fitted.minimum.local).ravel()]
    load = 0.2 * (np.array([0.0, 0.0, -9.81]) - declared)
    law = Law(Noise(scenes.NOISE, 0.1 * scenes.NOISE, 0.05))
    drawn = refit(bench, [Component("uniform_load", {})], law, vector, [load])
    free = freed(bench, drawn)
    truth = np.log(clamped_cases.POSE_K[0])
    off, spread = ((r.vector[0] - truth, np.sqrt(r.covariance[0, 0])) for r in (drawn, free))
    assert abs(off[0]) > 1.96 * off[1]
    assert abs(spread[0]) < 1.96 * spread[1]
    assert spread[1] > 1.0
    assert free.log_evidence is drawn.log_evidence
    weak = refit(bench, [Component("uniform_load", {})], law, vector, [np.zeros(3)], most=0)
    assert freed(bench, weak) is weak
