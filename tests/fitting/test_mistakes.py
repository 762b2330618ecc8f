"""Mistakes of the input that only a refit tells, named before any physics; missing physics is none."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.mistakes import KINDS
from scan2flex_jax.cli.app import app
from scan2flex_jax.inference import explain, fit
from scan2flex_jax.study import EffectDeclaration, save_study
from scan2flex_jax.study.rotations import columns

from . import scenes

NOISE = 3e-4  # m
FEW = ["--elements", str(scenes.ELEMENTS)]
ROLLED = "end rolled by 90 degrees in all poses"
HIDDEN = {
    "first two fitted poses exchanged": "exchange their centre_curve",
    ROLLED: "multiply the end quaternions from the right by [0.7071068, 0, 0, -0.7071068]",
    "sign of the rolls from pose to pose": "turn the roll of the end clamps about d3 the other way",
    "gravity along another axis": "write gravity = [0, 0, -9.81]",
}


def right(effects=()):
    """Four fitted poses with a little noise, as they were measured."""
    study = scenes.to_fit(scenes.study_of(poses=scenes.NAMES, effects=effects))
    return replace(scenes.measured(study, scenes.exact_curves(study, scenes.TRUE), NOISE), effects=())


def made(kind):
    return KINDS[kind][0](right())


@cache
def fitted(kind):
    return fit(made(kind), elements=scenes.ELEMENTS)


def test_a_mistake_is_named_first_with_its_mend_and_the_command_ends_with_code_three(tmp_path):
    kind = "first two fitted poses exchanged"
    save_study(made(kind), tmp_path / "study")
    told = CliRunner().invoke(app, ["fit", str(tmp_path / "study"), "--json", str(tmp_path / "result.json"), *FEW])
    assert told.exit_code == 3, told.output
    title, first, second = told.stdout.splitlines()[:3]
    assert title == made(kind).title
    assert "likely mistake: " in first and HIDDEN[kind] in first
    assert "are not reliable" in second
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["mistakes"][0]["mend"] in result["messages"][0] and result["believable"] is False


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(HIDDEN)[1:])
def test_mistakes_of_all_poses_are_named_with_their_mend(kind):
    f = fitted(kind)
    assert HIDDEN[kind] in str(f.mistakes[0]) and not f.believable
    assert f.mistakes[0].after < 2 * NOISE < f.mistakes[0].before / 2


@pytest.mark.slow
def test_the_mended_study_is_the_one_before_the_mistake():
    mended = fitted(ROLLED).mistakes[0].study
    for pose, own in zip(mended.poses, right().poses, strict=True):
        np.testing.assert_allclose(columns(pose.end.quaternion), columns(own.end.quaternion), atol=1e-9)
    f = fit(mended, elements=scenes.ELEMENTS)
    assert f.mistakes == () and f.believable
    assert f.estimates["torsional_stiffness"].value == pytest.approx(scenes.GJ, rel=0.02)


@pytest.mark.slow
def test_missing_physics_is_no_mistake():
    f = fit(right((EffectDeclaration("point_mass", {"position": 0.3, "mass": 0.1}),)), elements=scenes.ELEMENTS)
    assert f.rms() > 0.004 * f.problem.length
    assert f.mistakes == ()


@pytest.mark.slow
def test_explain_names_no_physics_over_a_mistake():
    """The search for physics is not begun: the corrected study leaves nothing to explain."""
    said = []
    found = explain(made(ROLLED), elements=scenes.ELEMENTS, mesh=False, progress=said.append)
    assert not any("first order" in s for s in said)
    assert found.verdict == "unexplained" and not found.believable
    assert HIDDEN[ROLLED] in found.sentences[0]
    assert found.chosen == found.ranking == ()
    assert found.fit is None
    assert found.to_json()["mistakes"][0]["mend"] == found.mistakes[0].mend
