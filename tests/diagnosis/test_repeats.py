"""Scans of one pose again: what they share is no noise, whatever it is."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.diagnosis import stage
from scan2flex_jax.diagnosis.sensitivity import Bench
from scan2flex_jax.fitting import fit
from scan2flex_jax.study import MeasuredCurve

from . import scenes

pytestmark = pytest.mark.slow


def noise_of(study):
    fitted = fit(study, elements=40)
    problem, minimum = fitted.problem, fitted.minimum
    return stage.signatures(Bench(problem, minimum), minimum, None)[1].estimate


def test_repeats_determine_the_noise_given_a_misfit_of_no_effect_type():
    """A wave of 1 mm in every pose, alike in its repeat: five times the noise, and shorter than anything a rod does."""
    first, again = (replace(s, poses=s.poses[1:3]) for s in (scenes.study(seed=1), scenes.study(seed=2)))
    poses = []
    for i, (a, b) in enumerate(zip(first.poses, again.poses, strict=True)):
        wave = 1e-3 * np.outer(np.sin(np.linspace(0, (9 + 2 * i) * np.pi, scenes.POINTS)), [0, 1, 0])
        poses.append(replace(a, curve=MeasuredCurve(a.curve.points + wave)))
        poses.append(replace(b, name=f"{b.name} again", repeat_of=b.name, curve=MeasuredCurve(b.curve.points + wave)))
    repeated = replace(first, poses=tuple(poses))
    assert stage.repeated(repeated) == ([0, 1], [2, 3])
    assert noise_of(repeated).total == pytest.approx(scenes.NOISE, rel=0.15)
    unsaid = replace(repeated, poses=tuple(replace(p, repeat_of=None) for p in poses))
    assert stage.repeated(unsaid) == ([0, 1], [2, 3])  # by their clamps
    assert noise_of(replace(first, poses=tuple(poses[::2]))).total > 2 * scenes.NOISE
