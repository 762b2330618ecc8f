"""Mistakes of the input that only a refit tells, named before any physics; missing physics is none."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.mistakes import KINDS
from scan2flex_jax.cli.app import app
from scan2flex_jax.errors import NotSettledError
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.inference import explain, fit, mistakes
from scan2flex_jax.study import Clamp, EffectDeclaration, save_study
from scan2flex_jax.study.rotations import columns

from . import scenes

TRUE = {"bending_stiffness": scenes.EI, "torsional_stiffness": scenes.GJ}
NAMES, NOISE = ("plane", "twist-90", "aside-45", "unseen"), 3e-4  # m
ROLLED = "end rolled by 90 degrees in all poses"
HIDDEN = {
    "first two fitted poses exchanged": "exchange their centre_curve",
    ROLLED: "multiply the end quaternions from the right by [0.7071068, 0, 0, -0.7071068]",
    "sign of the rolls from pose to pose": "turn the roll of the end clamps about d3 the other way",
    "gravity along another axis": "write gravity = [0, 0, -9.81]",
}
MISSING = {
    "weight": EffectDeclaration("point_mass", {"position": 0.3, "mass": 0.1}),
    "curvature": EffectDeclaration("natural_curvature", {"curvature": [0.0, 1.5, 0.0]}),
}


def right(effects=()):
    """Four fitted poses with a little noise, as they were measured."""
    study = scenes.study_of(poses=NAMES, effects=effects)
    study = replace(study, poses=tuple(replace(pose, role="fit") for pose in study.poses))
    return replace(scenes.measured(study, scenes.exact_curves(study, TRUE), NOISE), effects=())


def made(kind):
    return KINDS[kind][0](right())


@cache
def fitted(kind):
    return fit(made(kind))


LONG = ("gravity along another axis", "sign of the rolls from pose to pose", ROLLED)  # many refits


@pytest.mark.parametrize("kind", [pytest.param(k, marks=pytest.mark.slow if k in LONG else ()) for k in HIDDEN])
def test_a_mistake_is_named_first_with_its_mend(kind):
    f = fitted(kind)
    assert HIDDEN[kind] in str(f.mistakes[0])
    title, first, second = f.summary().splitlines()[:3]
    assert f.study.title in title
    assert str(f.mistakes[0]) in first
    assert "are not to be believed" in second
    assert not f.believable
    assert f.mistakes[0].after < 2 * NOISE < f.mistakes[0].before / 2


@pytest.mark.slow
def test_the_mended_study_is_the_one_before_the_mistake():
    mended = fitted(ROLLED).mistakes[0].study
    for pose, own in zip(mended.poses, right().poses, strict=True):
        np.testing.assert_allclose(columns(pose.end.quaternion), columns(own.end.quaternion), atol=1e-9)
    f = fit(mended)
    assert f.mistakes == () and f.believable
    assert f.estimates["torsional_stiffness"].value == pytest.approx(scenes.GJ, rel=0.02)


def test_a_good_fit_solves_nothing_more():
    study = right()
    f = fit(study)
    assert f.mistakes == ()
    solved = f.problem.evaluator.equilibria
    assert mistakes.before_branches(f.problem, "least-squares", print) == (None, ())
    assert mistakes.hidden(study, f.problem, f.minimum, print) == ()
    assert f.problem.evaluator.equilibria == solved


@pytest.mark.slow
@pytest.mark.parametrize("name", MISSING)
def test_missing_physics_is_no_mistake(name):
    f = fit(right((MISSING[name],)))
    assert f.rms() > 0.004 * f.problem.length
    assert f.mistakes == ()


def test_a_pose_that_alone_does_not_fit_is_named_without_a_mend():
    """Its end clamp was moved aside and tilted, and no likely mistake does that."""
    study = right()
    pose = study.poses[2]
    tilted = pose.end.quaternion + np.array([0.0, 0.25, -0.15, 0.2])
    moved = Clamp(pose.end.position + np.array([0.02, -0.06, 0.05]), tilted / np.linalg.norm(tilted))
    f = fit(replace(study, poses=(*study.poses[:2], replace(pose, end=moved), study.poses[3])))
    (found,) = f.mistakes
    assert found.sentence == f"pose {pose.name} does not fit, and the others fit without it"
    assert [p.name for p in found.study.fit_poses] == [p.name for p in study.poses if p is not pose]


def test_a_study_that_cannot_settle_says_why(monkeypatch):
    def unsettled(*args, **kwargs):
        raise NotSettledError("nothing settles", "look", {"plane": "no equilibrium"})

    monkeypatch.setattr(Problem, "minimise", unsettled)
    words = r"nothing settles \(plane: no equilibrium\): .* the length looks like centimetres: write length = 1\b"
    with pytest.raises(NotSettledError, match=words):
        fit(made("length in cm"))


@pytest.mark.slow
def test_explain_names_no_physics_over_a_mistake():
    """The search for physics is not begun: the corrected study leaves nothing to explain."""
    said = []
    found = explain(made(ROLLED), progress=said.append)
    assert not any("first order" in s for s in said)
    assert found.verdict == "unexplained" and not found.believable
    assert HIDDEN[ROLLED] in found.sentences[0]
    assert found.chosen == found.ranking == ()
    assert found.fit is None
    assert found.to_json()["mistakes"][0]["mend"] == found.mistakes[0].mend


def test_command_ends_with_the_code_of_what_is_not_to_be_believed(tmp_path):
    save_study(made(ROLLED), tmp_path / "study")
    found = CliRunner().invoke(app, ["fit", str(tmp_path / "study"), "--json", str(tmp_path / "result.json")])
    assert found.exit_code == 3, found.output
    assert "likely mistake: the end clamp of every pose is rolled" in found.stdout.splitlines()[1]
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["mistakes"][0]["mend"] in result["messages"][0]
