"""Wrong input beside missing effects: which of the two explains the shapes. Turns that the fit changes are said, and the study
with its own turns is a variant that pays nothing for them."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.fitting.least_squares import silent
from scan2flex_jax.inference import explain
from scan2flex_jax.inference.variants import stated_turns
from scan2flex_jax.study import Clamp
from tests.fitting.scenes import measured
from tests.fitting.test_branches import with_turns
from tests.fitting.test_mistakes import NOISE, right

from .scenes import variant_of

pytestmark = pytest.mark.slow
WRONG = {"twist-90": 1}


def stated(study):
    return replace(study, poses=tuple(replace(p, noise=NOISE) for p in study.poses))


def test_a_pose_that_alone_does_not_fit_stands_as_a_mistake():
    """Its end clamp was moved aside and tilted: no effect of the cable does that to one pose alone."""
    study = stated(right())
    pose = study.poses[2]
    tilted = pose.end.quaternion + np.array([0.0, 0.25, -0.15, 0.2])
    moved = Clamp(pose.end.position + np.array([0.02, -0.06, 0.05]), tilted / np.linalg.norm(tilted))
    poses = (*study.poses[:2], replace(pose, end=moved), study.poses[3])
    found = explain(replace(study, poses=poses), elements=20, mesh=False)
    assert found.verdict == "unexplained" and not found.believable and found.chosen == ()
    assert [m.sentence for m in found.mistakes] == [f"pose {pose.name} does not fit, and the others fit without it"]
    assert [p.name for p in found.mistakes[0].study.fit_poses] == [p.name for p in study.poses if p is not pose]
    assert "the input is likely mistaken" in found.answer.belief
    assert found.to_json()["mistakes"] and not found.estimates


def test_corrected_turns_are_no_missing_effect():
    """With noise beyond the error of the mesh, which would pass for an effect."""
    study = with_turns(WRONG)
    found = explain(measured(study, [p.curve.points for p in study.poses], 3e-4), elements=20, mesh=False)
    assert found.verdict == "no missing effect" and found.believable
    assert any("pose twist-90 was solved with turns =" in s for s in found.sentences)


def test_the_turns_of_the_study_are_less_likely_where_they_are_wrong():
    study = with_turns(WRONG)
    first = variant_of(study)
    before, settings = first.empty.score, first.settings
    stated = stated_turns(study, first, silent)
    assert first.log_prior == -settings.turn and first.empty.score == pytest.approx(before - settings.turn)
    assert stated is None or stated.empty.score < first.empty.score - settings.found
