"""What is said while a study is made: the mend that is meant, what was assumed, how much was scanned, in which order."""

import re
from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.convert import measured, other_tangent
from scan2flex_jax.convert.frames import clamp_of_matrix
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.examples import example_path
from scan2flex_jax.study import Tolerance, load_study, save_study, study_warnings
from scan2flex_jax.study.check import assumptions
from scan2flex_jax.study.rotations import columns
from tests.outputs.scenes import run

AXES = ("x", "y", "z", "-x", "-y", "-z")


def flanges(tangent):
    """Frames of robots whose axis ``tangent`` points along the cable, as matrices under the names of the poses' ends."""
    rows = []
    for pose in load_study(example_path("simulated-cable")).poses:
        for end in ("start", "end"):
            clamp = getattr(pose, end)
            M = np.eye(4)
            along = columns(clamp_of_matrix(np.eye(4), tangent=tangent).quaternion)
            M[:3, :3] = columns(clamp.quaternion) @ along.T
            M[:3, 3] = clamp.position
            rows += [f"{pose.name} {end}", *(" ".join(f"{v:.12g}" for v in row) for row in M)]
    return "\n".join(rows) + "\n"


@pytest.fixture
def folder(tmp_path):
    made = tmp_path / "scans"
    made.mkdir()
    for pose in load_study(example_path("simulated-cable")).poses:
        np.savetxt(made / f"{pose.name}.txt", pose.curve.points, fmt="%.9f")
    return made


def new(folder, frames, *more):
    (folder.parent / "frames.txt").write_text(frames)
    given = ("--length", "1000 +- 2 mm", "--mass", "200 +- 1 g", "--clamps", folder.parent / "frames.txt")
    return run("new", folder, "--units", "m", *given, *more)


@pytest.mark.parametrize(("meant", "given"), [("x", "z"), ("-z", "z"), ("y", "-x")])
def test_the_axis_that_was_meant_is_proposed(folder, meant, given):
    found = new(folder, flanges(meant), f"--tangent={given}")
    assert found.exit_code == 0, found.exception
    said = re.search(r"the tangents are off by (\d+) degrees at every clamp: did you mean --tangent (\S+)\?", found.output)
    assert said[2] == meant
    assert float(said[1]) == pytest.approx(180 if meant.strip("-") == given.strip("-") else 90, abs=3)
    assert "--tangent" in "".join(study_warnings(load_study(folder)))  # `check` says it too
    (folder / "study.toml").unlink()
    again = new(folder, flanges(meant), f"--tangent={meant}")
    assert "did you mean" not in again.output
    assert not [w for w in study_warnings(load_study(folder)) if "tangent" in w]


@pytest.mark.parametrize("tangent", AXES)
def test_axes_of_frames(tangent):
    """The axis that leads along the cable, as the clamps made with another tangent have it, is the one that was meant."""
    made = columns(clamp_of_matrix(np.eye(4), tangent=tangent).quaternion)
    for k, name in enumerate("xyz"):
        for sign in ("", "-"):
            d = (-1.0 if sign else 1.0) * made[:, k]
            meant = other_tangent(sign + name, tangent)
            np.testing.assert_allclose(d, clamp_of_matrix(np.eye(4), tangent=meant).tangent, atol=1e-12)


def test_what_was_assumed_is_said_and_what_was_measured_is_written(folder):
    found = new(folder, flanges("z"))
    assert "assumed: gravity is 0, 0, -9.81 m/s^2" in found.output
    assert "assumed: the cable leaves each frame along its z axis" in found.output
    study = load_study(folder)
    assert study.tolerance == Tolerance(length=0.002, length_density=0.001)
    for said in assumptions(study):
        assert said in found.output
    assert any("straight when nothing bends it" in said for said in assumptions(study))
    exact = next(said for said in assumptions(study) if "as exact" in said)
    assert "clamp_position, clamp_rotation" in exact and "length" not in exact
    curved = replace(study, cable={**study.cable, "natural_curvature": np.zeros(3)})
    assert not any("straight when" in said for said in assumptions(curved))


@pytest.mark.parametrize(
    ("text", "what", "value", "std"),
    [("302 +- 1 g", "mass", 0.302, 0.001), ("302 g+-2", "mass", 0.302, 0.002), ("0.9 \u00b1 0.001", "length", 0.9, 0.001),
     ("900 mm +- 0.1 cm", "length", 0.9, 0.001), ("336 g/m", "length density", 0.336, 0.0),
     ("336 g/m +/- 2 g/m", "length density", 0.336, 0.002), ("336 g/m +/- 1 %", "length density", 0.336, 0.00336),
     ("3 ft 3 in +- 1", "length", 0.9906, 0.0254)],
)  # fmt: skip
def test_quantities_with_their_uncertainty(text, what, value, std):
    assert measured(text, what) == (pytest.approx(value), pytest.approx(std))


@pytest.mark.parametrize("text", ["0.9 +- much", "+- 1 mm", "0.9 +- 1 g", "0.9 +- -1"])
def test_an_uncertainty_that_is_none_is_refused(text):
    with pytest.raises(Scan2FlexError, match="is no length"):
        measured(text, "length")


def test_points_of_scans_are_counted(folder):
    for pose in load_study(example_path("simulated-cable")).poses:
        (folder / f"{pose.name}.txt").unlink()
        np.savetxt(folder / f"{pose.name}.xyz", pose.curve.points)
    found = new(folder, flanges("z"), "--radius", "4 mm")
    assert found.exit_code == 0, found.exception
    counts = [len(pose.curve.points) for pose in load_study(example_path("simulated-cable")).poses]
    for said in (found.output, run("check", folder).output):
        assert sorted(map(int, re.findall(r"scan +\S+, (\d+) points in a box of", said))) == sorted(counts)


def test_export_says_that_there_is_no_radius(tmp_path):
    study = load_study(example_path("simulated-cable"))
    known = {**study.cable, "bending_stiffness": 0.1, "torsional_stiffness": 0.25}
    for cable, said in ((known, True), ({**known, "radius": 0.004}, False)):
        save_study(replace(study, cable=cable, unknowns=()), tmp_path / str(said))
        found = run("export", tmp_path / str(said), "--to", "mujoco", "-o", tmp_path / f"cable-{said}")
        assert found.exit_code == 0, found.exception
        assert ("the study has no radius" in found.stderr) == said
        text = (tmp_path / f"cable-{said}").read_text("utf-8")
        assert ("study has no radius" in text) == said


def test_fit_says_what_it_does(monkeypatch):
    def stopped(study, *_, progress, **__):
        raise Scan2FlexError("enough")

    monkeypatch.setattr("scan2flex_jax.inference.fit", stopped)
    found = run("fit", example_path("simulated-cable"))
    assert "bending_stiffness, torsional_stiffness from 3 poses (1 more never fitted)" in found.stderr
    assert "30 elements" in run("fit", example_path("simulated-cable"), "--elements", "30").stderr


@pytest.mark.parametrize("command", ["fit", "explain"])
def test_estimates_are_not_saved_over_the_study_itself(tmp_path, command):
    save_study(load_study(example_path("simulated-cable")), tmp_path / "cable")
    text = (tmp_path / "cable" / "study.toml").read_text() + "# a note of mine\n"
    (tmp_path / "cable" / "study.toml").write_text(text)
    (tmp_path / "link").symlink_to(tmp_path / "cable")
    for place in ("cable", "link"):
        found = run(command, tmp_path / "cable", "--save", tmp_path / place)
        assert isinstance(found.exception, Scan2FlexError)
        assert "the folder of the study itself" in str(found.exception)
    assert (tmp_path / "cable" / "study.toml").read_text() == text
    assert not list((tmp_path / "cable").glob("*.bak"))


def test_a_weight_is_said_to_be_one(folder):
    (folder.parent / "frames.txt").write_text(flanges("z"))
    given = ("--clamps", folder.parent / "frames.txt", "--length", "1 m", "--density", "1.96133 +- 0.02 N/m")
    found = run("new", folder, *given)
    assert found.exit_code == 0, found.exception
    assert "is a weight: divided by 9.80665 m/s^2" in found.output
    study = load_study(folder)
    assert study.cable["length_density"] == pytest.approx(0.2)
    assert study.tolerance.length_density == pytest.approx(0.02 / 9.80665)


def test_an_interrupt_at_a_prompt_is_one(folder, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("scan2flex_jax.cli.options.interactive", lambda: True)
    monkeypatch.setattr("typer._click.termui.visible_prompt_func", interrupted, raising=False)
    monkeypatch.setattr("click.termui.visible_prompt_func", interrupted, raising=False)
    assert run("new", folder).exit_code == 130


def test_files_keep_the_order_in_which_they_are_given(folder, tmp_path):
    (tmp_path / "frames.txt").write_text(flanges("z"))
    given = ["--length", "1 m", "--mass", "200 g", "--clamps", tmp_path / "frames.txt"]
    order = ["twist-90", "unseen", "aside-45", "plane"]
    found = run("new", *(folder / f"{name}.txt" for name in order), *given)
    assert found.exit_code == 0, found.exception
    assert f"4 poses, in the order given: {', '.join(order)}" in found.stdout
    assert [pose.name for pose in load_study(folder).poses] == order
    (folder / "study.toml").unlink()
    found = run("new", folder, *given)
    assert "4 poses, sorted by name" in found.stdout
    assert [pose.name for pose in load_study(folder).poses] == ["aside-45", "plane", "twist-90", "unseen"]


def test_a_file_that_is_no_measurement_is_refused(folder, tmp_path):
    (tmp_path / "notes.md").write_text("")
    for path, said in ((tmp_path / "notes.md", "no scan or centre curve"), (tmp_path / "none.csv", "is no file")):
        found = run("new", folder / "plane.txt", path, "--length", "1 m", "--mass", "200 g")
        assert isinstance(found.exception, Scan2FlexError) and said in str(found.exception)
