"""Likely mistakes of the input beside missing effects: which of the two explains the shapes."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.inference import explain
from scan2flex_jax.study import Clamp, EffectDeclaration
from tests.fitting.test_mistakes import NOISE, right

pytestmark = pytest.mark.slow


def stated(study):
    return replace(study, poses=tuple(replace(p, noise=NOISE) for p in study.poses))


@pytest.mark.xfail(run=False, reason="open: a natural twist of nearly half a turn is not reached from zero (in 5 minutes)")
def test_an_effect_that_explains_more_than_a_correction_is_named_over_it():
    """A natural twist is nearly a roll of every end clamp by half a turn, which leaves 1 mm where the noise is 0.4 mm."""
    study = stated(right((EffectDeclaration("natural_curvature", {"curvature": [0.0, 0.0, 3.0]}),)))
    found = explain(study, elements=40, mesh=False)
    assert [m.sentence for m in found.fit.mistakes] == ["the end clamp of every pose is rolled by half a turn about d3"]
    assert found.mistakes == () and found.verdict in ("explained", "tied") and found.believable
    assert "natural_curvature" in {found.chosen[0].kind, *found.chosen[0].tied_with}
    assert any(s.startswith("a mistake of the input explains less: the end clamp") for s in found.sentences)
    assert found.rms() < 0.5 * found.rms(after=False)


def test_a_pose_that_alone_does_not_fit_stands_as_a_mistake():
    """Its end clamp was moved aside and tilted: no effect of the cable does that to one pose alone."""
    study = stated(right())
    pose = study.poses[2]
    tilted = pose.end.quaternion + np.array([0.0, 0.25, -0.15, 0.2])
    moved = Clamp(pose.end.position + np.array([0.02, -0.06, 0.05]), tilted / np.linalg.norm(tilted))
    poses = (*study.poses[:2], replace(pose, end=moved), study.poses[3])
    found = explain(replace(study, poses=poses), elements=40, mesh=False)
    assert found.verdict == "unexplained" and not found.believable and found.chosen == ()
    assert [m.sentence for m in found.mistakes] == [f"pose {pose.name} does not fit, and the others fit without it"]
    assert "the input is likely mistaken" in found.answer.belief
    assert found.to_json()["mistakes"] and not found.estimates
