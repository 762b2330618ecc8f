"""Validate poses have no part in the scores, and contradict the answer; what one pose alone shows is never established."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.examples import example_path
from scan2flex_jax.inference import explain
from scan2flex_jax.study import Clamp, MeasuredCurve, load_study

from . import scenes

pytestmark = pytest.mark.slow
UNSEEN = {"t001": "p5", "t004": "p7"}
ASIDE = np.array([0.03, -0.04, 0.05])  # m


def curve_aside(pose):
    return replace(pose, curve=MeasuredCurve(pose.curve.points + ASIDE))


def clamp_aside(pose):
    return replace(pose, end=Clamp(pose.end.position - ASIDE, pose.end.quaternion))


def changed(name, change):
    study = scenes.case(name, unseen=(UNSEEN[name],))
    return replace(study, poses=tuple(change(p) if p.role == "validate" else p for p in study.poses))


def test_a_validate_pose_that_is_predicted_surprises_nobody(clip):
    assert clip.surprised == {} and clip.believable
    assert clip.poses["p7"].role == "validate" and clip.poses["p7"].left_out is None


@pytest.mark.parametrize(("name", "change"), [("t004", curve_aside), ("t004", clamp_aside), ("t001", curve_aside)])
def test_a_validate_pose_that_is_off_contradicts_the_answer(name, change, clip):
    found = explain(changed(name, change), elements=40, mesh=False)
    pose = UNSEEN[name]
    assert list(found.surprised) == [pose]
    assert found.surprised[pose] > found.settings.surprise
    assert found.verdict != "explained"
    assert not found.believable and found.answer.tone == "bad"
    assert f"{pose}, which was not fitted," in found.answer.belief
    assert all(e.low is None and e.high is None for e in found.estimates.values())
    assert set(found.to_json()["contradicted_by"]) == {pose}
    if name == "t004":  # and it had no part in the scores
        assert [h.log_evidence for h in found.hypotheses] == pytest.approx([h.log_evidence for h in clip.hypotheses], abs=1e-6)


@pytest.mark.parametrize("hidden", [{}, {"natural_curvature": (1.5, 0.0, 0.0)}], ids=["nothing", "curved"])
def test_a_single_pose_is_never_explained(hidden):
    whole = scenes.study(**hidden)
    found = explain(replace(whole, poses=whole.poses[:1]), elements=40, mesh=False)
    assert found.verdict in ("no missing effect", "unexplained")
    assert found.chosen == ()
    assert (found.verdict == "unexplained") is bool(hidden)
    assert found.believable is not bool(hidden)
    assert any("in a single pose" in s for s in found.sentences) is bool(hidden)
    assert found.significant is bool(hidden)


def test_a_smooth_residual_of_a_single_photograph_is_no_good_answer():
    """13.8 mm on a wire of 1.5 m: physics or a smooth error of the photograph, and no test on another pose."""
    found = explain(load_study(example_path("red-wire")))
    assert found.verdict in ("no missing effect", "unexplained") and found.chosen == ()
    assert found.answer.tone != "good"
    said = any(s.startswith("but only if the measured curves err by") for s in found.sentences)
    assert found.verdict == "unexplained" or said
    assert found.significant is (found.verdict == "unexplained")
    assert found.rms(after=False) == pytest.approx(found.fit.rms(), rel=0.02)
