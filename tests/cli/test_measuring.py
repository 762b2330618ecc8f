"""The commands before a fit: `new`, `pose`, `curve`, `check`, with answers, with options, and with nobody to ask."""

import json
import shlex

import numpy as np
import pytest
from typer.testing import CliRunner

from scan2flex_jax.cli import making, options
from scan2flex_jax.cli.app import app
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.examples import example_path
from scan2flex_jax.study import load_study, save_study
from tests.study.samples import curve, write_sample

T = np.linspace(0, 1, 30)
SAG = 1e3 * np.column_stack([0.6 * T, 0 * T, -0.35 * np.sin(np.pi * T) ** 2])  # mm


@pytest.fixture
def folder(tmp_path):
    tmp_path = tmp_path / "mein Kabel \N{LATIN SMALL LETTER U WITH DIAERESIS}"
    tmp_path.mkdir()
    for name in ("sag-1", "sag-2"):
        np.savetxt(tmp_path / f"{name}.txt", SAG, fmt="%.4f")
    return tmp_path


def run(*words, answers=None):
    return CliRunner().invoke(app, [str(word) for word in words], input=answers)


def test_new_with_options_alone(folder):
    clamps = "name,x,y,z,a,b,c\n" + "".join(f"{n} start,0,0,0,0,90,0\n{n} end,600,0,0,0,90,0\n" for n in ("sag-1", "sag-2"))
    (folder / "clamps.csv").write_text(clamps)
    found = run("new", folder, "--units", "mm", "--length", "1000 mm", "--mass", "200 g", "--clamps", folder / "clamps.csv",
                "--convention", "rpy", "--validate", "sag-2", "--title", "mine")  # fmt: skip
    assert found.exit_code == 0, found.exception
    study = load_study(folder)
    assert (study.title, study.cable) == ("mine", {"length": 1.0, "length_density": pytest.approx(0.2)})
    assert [p.role for p in study.poses] == ["fit", "validate"]
    np.testing.assert_allclose(study.poses[0].end.position, [0.6, 0, 0])
    np.testing.assert_allclose(study.poses[0].end.tangent, [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(study.poses[1].curve.points, 1e-3 * SAG, atol=1e-7)
    assert f"scan2flex fit {shlex.quote(str(folder))}" in found.output


def test_new_asks_until_it_has_an_answer(folder, monkeypatch):
    for module in (options, making):
        monkeypatch.setattr(module, "interactive", lambda: True)
    answers = ["long", "1000 mm", "-3", "200 g/m", "n"]
    answers += ["0 0 0 0 90 0", "600 0 0", "0 0", "0 0 0", "free", "sag-2", "0.3 kg", "0.3 mm"]
    found = run("new", folder, "--units", "mm", "--convention", "rpy", answers="\n".join(answers) + "\n")
    assert found.exit_code == 0, (found.exception, found.output)
    study = load_study(folder)
    first, second = study.poses
    np.testing.assert_allclose(first.start.tangent, [1, 0, 0], atol=1e-12)
    assert first.end.quaternion is None  # a position alone is a ball joint
    assert second.end is None
    assert second.role == "validate"
    assert "'long' is no length" in found.output and "'0.3 kg' is no length" in found.output
    assert first.noise == second.noise == pytest.approx(3e-4)
    assert "depth cameras 2 to 5 mm" in found.output


@pytest.mark.parametrize(
    ("given", "option"),
    [
        ([], "--length"),
        (["--length", "1"], "--density (or --mass)"),
        (["--length", "1", "--density", "0.2"], "--clamps FILE (or --clamps-from-curves)"),
        (["--length", "1", "--density", "0.2", "--mass", "1"], "--mass and --density"),
        (["--length", "1", "--density", "0.2", "--clamps-from-curves", "--validate", "x"], "'x'"),
        (["--length", "1 kg"], "no length"),
        (["--length", "1", "--density", "0.2", "--clamps-from-curves", "--gravity", "down"], "gravity"),
    ],
)
def test_with_nobody_to_ask_the_option_is_named(folder, given, option):
    found = run("new", folder, "--units", "mm", *given)
    assert isinstance(found.exception, Scan2FlexError)
    assert option in str(found.exception)
    assert not (folder / "study.toml").exists()


def test_clamps_from_curves_are_said_to_be_a_guess(folder):
    found = run("new", folder, "--units", "mm", "--length", "1", "--density", "0.2", "--clamps-from-curves")
    assert found.exit_code == 0, found.exception
    assert "without twist" in found.output
    study = load_study(folder)
    np.testing.assert_allclose(study.poses[0].start.position, [0, 0, 0], atol=study.tolerance.clamp_position)
    assert 0 < study.tolerance.clamp_rotation < 0.3 and 0 < study.tolerance.clamp_position < 1e-3
    assert "# noise left out: " in (folder / "study.toml").read_text()


def test_new_asks_whether_ends_of_curves_hang_free(folder, monkeypatch):
    for module in (options, making):
        monkeypatch.setattr(module, "interactive", lambda: True)
    known = "--units", "mm", "--length", "1", "--density", "0.2", "--noise", "0.3 mm", "--validate", "sag-2"
    found = run("new", folder, *known, answers="y\nperhaps\nfree\n")
    assert found.exit_code == 0, (found.exception, found.output)
    assert [pose.end for pose in load_study(folder).poses] == [None, None]
    assert "'perhaps' is neither held nor free" in found.output
    (folder / "study.toml").unlink()
    found = run("new", folder, *known, "--clamps-from-curves", answers="\n")
    assert found.exit_code == 0 and all(pose.end is not None for pose in load_study(folder).poses)


def test_noise_is_written(folder):
    known = "new", folder, "--units", "mm", "--length", "1", "--density", "0.2", "--clamps-from-curves"
    assert "no length" in str(run(*known, "--noise", "0.4 g").exception)
    assert "use one of held, free" in str(run(*known, "--ends", "loose").exception)
    found = run(*known, "--noise", "0.4 mm", "--ends", "held")
    assert found.exit_code == 0, found.exception
    assert [pose.noise for pose in load_study(folder).poses] == [4e-4, 4e-4]
    assert "noise left out" not in (folder / "study.toml").read_text()


def test_pose_converts_matrices_and_angles(tmp_path):
    M = np.eye(4)
    M[:3, :3] = [[0, 0, 1], [0, 1, 0], [-1, 0, 0]]
    M[:3, 3] = [500, 0, 300]
    numbers = ",".join(map(str, M.ravel()))
    by_matrix = run("pose", "--matrix", numbers, "--units", "mm", "--json", tmp_path / "pose.json")
    by_angles = run("pose", "--position", "500,0,300", "--angles", "0,90,0", "--convention", "rpy", "--units", "mm")
    assert by_matrix.exit_code == by_angles.exit_code == 0, by_angles.exception
    assert by_matrix.output == by_angles.output
    assert by_matrix.output.startswith("{ position = [0.5, 0, 0.3], quaternion = [0.70710678118")
    [found] = json.loads((tmp_path / "pose.json").read_text()).values()
    np.testing.assert_allclose(found["quaternion"], [0.5**0.5, 0, 0.5**0.5, 0])


@pytest.mark.parametrize(
    "words", [[], ["--matrix", "1 2 3"], ["--position", "1,2,3"], ["--matrix", "1", "--position", "1,2,3"], ["nowhere.csv"]]
)
def test_pose_refuses_in_one_sentence(words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = run("pose", *words)
    assert isinstance(found.exception, Scan2FlexError)
    assert "\n" not in str(found.exception)


def test_curve_writes_what_a_study_reads(tmp_path):
    (tmp_path / "export.txt").write_text(
        "X [mm];Y [mm];Z [mm]\n" + "\n".join(";".join(f"{v:.3f}".replace(".", ",") for v in p) for p in SAG)
    )
    found = run("curve", tmp_path / "export.txt", "-o", tmp_path / "sag.csv", "--json", tmp_path / "sag.json")
    assert found.exit_code == 0, found.exception
    assert "30 points in mm" in found.output
    table = np.loadtxt(tmp_path / "sag.csv", delimiter=",", skiprows=1)
    np.testing.assert_allclose(table, 1e-3 * SAG, atol=1e-6)
    assert (tmp_path / "sag.csv").read_text().startswith("x,y,z\n")
    said = json.loads((tmp_path / "sag.json").read_text())
    long = np.sum(np.linalg.norm(np.diff(table, axis=0), axis=1))
    assert (said["points"], said["arc_length"]) == (30, pytest.approx(long, rel=1e-6))


def test_check_writes_its_warnings(tmp_path):
    found = run("check", example_path("red-wire"), "--json", tmp_path / "check.json")
    assert found.exit_code == 0
    said = json.loads((tmp_path / "check.json").read_text())
    assert said["unknown"] == ["bending_stiffness", "torsional_stiffness"]
    assert any("no validate pose" in warning for warning in said["warnings"])


def test_check_reads_the_scans(tmp_path):
    write_sample(tmp_path)
    np.savetxt(tmp_path / "sag.xyz", curve())
    found = run("check", tmp_path, "--json", tmp_path / "check.json")
    assert found.exit_code == 0, found.exception
    assert "sag.xyz, " in found.output and " points in a box of " in found.output
    held = json.loads((tmp_path / "check.json").read_text())["poses"]["sag"]["scan"]
    np.savetxt(tmp_path / "sag.xyz", 1e3 * np.loadtxt(tmp_path / "sag.xyz"))
    found = run("check", tmp_path, "--json", tmp_path / "again.json")
    assert "looks like millimetres" in found.output
    again = json.loads((tmp_path / "again.json").read_text())["poses"]["sag"]["scan"]
    assert again["points"] == held["points"]
    np.testing.assert_allclose(again["size"], 1e3 * np.array(held["size"]))
    (tmp_path / "sag.xyz").write_text("hello\n")
    found = run("check", tmp_path)
    assert isinstance(found.exception, Scan2FlexError)
    assert "sag.xyz" in str(found.exception)


@pytest.mark.slow
def test_extract_writes_the_curve_and_says_whether_it_is_sure(tmp_path):
    """Of the virtual PTFE cable, one scan from two sides, as a user would have it on disk."""
    from benchmarks import virtual_experiments as virtual

    (tmp_path / "scans").mkdir()
    folder = save_study(virtual.study_of(virtual.PTFE, tmp_path / "scans", 1), tmp_path / "study").parent
    found = run("extract", folder, "--save", tmp_path / "s", "--json", tmp_path / "c.json")
    assert found.exit_code == 0, found.output
    (one,) = json.loads((tmp_path / "c.json").read_text()).values()
    assert one["sure"] and abs(one["arc_length"] / virtual.PTFE.length - 1.0) < 0.02
    written = load_study(tmp_path / "s").poses[0].curve
    assert written is not None and load_study(folder).poses[0].curve is None  # the study itself is as it was
    assert f"-> {written.path}" in found.output and f"written: {tmp_path / 's' / 'study.toml'}" in found.output
