"""`scan2flex report` and `scan2flex export` write what they say, and refuse in one sentence."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.examples import example_path
from scan2flex_jax.study import load_study, save_study
from tests.outputs.scenes import run
from tests.reporting.scenes import explained


def test_report_of_the_fit_alone(fitted, tmp_path, monkeypatch):
    monkeypatch.setattr(sys.modules["scan2flex_jax.inference"], "fit", lambda study, **options: fitted)
    found = run(
        "report", example_path("simulated-cable"), "-o", tmp_path / "r.html", "--no-explain", "--json", tmp_path / "r.json"
    )
    assert found.exit_code == 0, found.exception
    text = (tmp_path / "r.html").read_text("utf-8")
    assert "yes: validate poses are predicted to within the noise" in text
    assert f"reliable?     {fitted.answer.belief}" in " ".join(found.output.split()).replace("reliable? ", "reliable?     ")
    assert "--no-explain" in text
    assert json.loads((tmp_path / "r.json").read_text())["estimates"]["bending_stiffness"]["value"] == pytest.approx(
        0.1, rel=1e-3
    )


def test_a_report_of_scans_explains_the_scans_themselves(fitted, tmp_path, monkeypatch):
    """Centre curves that were extracted first would be pulled towards the sensor: `explain` knows what to do with scans."""
    study, seen = load_study(example_path("simulated-cable")), []
    for pose in study.poses:
        np.savetxt(tmp_path / f"{pose.name}.xyz", pose.curve.points)
    save_study(replace(study, cable={**study.cable, "radius": 0.01}), tmp_path / "scans")
    text = (tmp_path / "scans" / "study.toml").read_text()
    for pose in study.poses:
        curve = next(line for line in text.splitlines() if line.startswith("centre_curve") and pose.name in line)
        text = text.replace(curve, f'scan = "{pose.name}.xyz"')
        (tmp_path / "scans" / f"{pose.name}.xyz").write_bytes((tmp_path / f"{pose.name}.xyz").read_bytes())
    (tmp_path / "scans" / "study.toml").write_text(text)

    def explain(study, **options):
        seen.append(study)
        return explained(fitted)

    monkeypatch.setattr(sys.modules["scan2flex_jax.inference"], "explain", explain)
    found = run("report", tmp_path / "scans", "-o", tmp_path / "r.html")
    assert found.exit_code == 0, found.exception
    assert all(pose.curve is None and pose.scan is not None for pose in seen[0].poses)


def test_a_pose_that_is_not_solved_ends_with_three(fitted, tmp_path, monkeypatch):
    name = "twist-90"
    lost = replace(fitted, poses={**fitted.poses, name: replace(fitted.poses[name], stable=False, verdict="lost")})
    monkeypatch.setattr(sys.modules["scan2flex_jax.inference"], "fit", lambda study, **options: lost)
    found = run("report", example_path("simulated-cable"), "-o", tmp_path / "r.html", "--no-explain")
    assert found.exit_code == 3
    assert "no: twist-90 could not be solved (lost)" in (tmp_path / "r.html").read_text("utf-8")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "verdict", "code"),
    [("explain", "no missing effect", 3), ("report", "no missing effect", 3), ("explain", "partly explained", 0)],
)
def test_an_explanation_that_leaves_a_pose_far_from_its_curve_ends_with_three(
    fitted, tmp_path, monkeypatch, command, verdict, code
):
    """Unless its effects explain most of the error, and it says itself that more than noise remains."""
    found = explained(fitted, verdict)
    far = {name: replace(p, rms=0.02 if p.role == "fit" else p.rms) for name, p in found.poses.items()}
    monkeypatch.setattr(sys.modules["scan2flex_jax.inference"], "explain", lambda study, **options: replace(found, poses=far))
    ended = run(command, example_path("simulated-cable"), *(["-o", tmp_path / "r.html"] if command == "report" else []))
    assert ended.exit_code == code, ended.output
    assert ("off its measured curve" in " ".join(ended.output.split())) is (code == 3)


def test_export_writes_the_cable_of_the_named_pose(fitted, tmp_path):
    save_study(replace(fitted.calibrated, poses=load_study(example_path("simulated-cable")).poses), tmp_path / "cable")
    found = run("export", tmp_path / "cable", "--to", "json", "-o", tmp_path / "cable.json", "--pose", "twist-90")
    assert found.exit_code == 0, found.exception
    cable = json.loads((tmp_path / "cable.json").read_text("utf-8"))
    assert cable["pose"]["name"] == "twist-90"
    assert cable["elements"]["stiffness"][0][3][3] == pytest.approx(0.1, rel=1e-3)
    for words in (["--to", "catia"], ["--to", "json", "--pose", "nowhere"]):
        refused = run("export", tmp_path / "cable", *words, "-o", tmp_path / "no.json")
        assert isinstance(refused.exception, Scan2FlexError)
        assert not (tmp_path / "no.json").exists()
