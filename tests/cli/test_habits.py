"""What a user takes for granted of a program: its version, results on standard output, refusals before work, an interrupt."""

import json
import os
import subprocess
import sys

import pytest
from typer.testing import CliRunner

import scan2flex_jax
from scan2flex_jax.cli.app import app
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.examples import example_path
from scan2flex_jax.study import load_study
from tests.cli.test_guidance import flanges, folder, run  # noqa: F401  (a fixture)

WIRE = example_path("black-wire")


def program(*words, **options):
    command = [sys.executable, "-m", "scan2flex_jax", *map(str, words)]
    options = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True} | options
    return subprocess.Popen(command, env={**os.environ, "SCAN2FLEX_CACHE": "off"}, **options)


def test_the_module_is_the_program_and_knows_its_version():
    found = program("--version")
    assert found.communicate(timeout=60) == (f"scan2flex_jax {scan2flex_jax.__version__}\n", "")
    assert found.returncode == 0


def test_json_on_standard_output_stands_there_alone(tmp_path):
    run_in = program("check", WIRE, "--json", "-", cwd=tmp_path)
    out, said = run_in.communicate(timeout=60)
    found = json.loads(out)
    assert found["scan2flex_jax"] == scan2flex_jax.__version__
    assert found["poses"].keys() == {"turn-0", "turn-360"} and "Poses: 1 to fit" in said
    assert list(tmp_path.iterdir()) == []
    assert "Poses: 1 to fit" in CliRunner().invoke(app, ["check", str(WIRE)]).stdout  # the next command prints as ever


def test_other_documents_on_standard_output_stand_there_alone():
    for words in (("schema", "-o", "-"), ("pose", "--matrix", "1 0 0 0 0 1 0 0 0 0 1 0", "--json", "-")):
        out, said = program(*words).communicate(timeout=60)
        assert scan2flex_jax.__version__ in json.dumps(json.loads(out)) and said


def test_a_reader_of_standard_output_may_leave():
    reading, writing = os.pipe()
    os.close(reading)
    found = program("check", WIRE, "--json", "-", stdout=writing)
    os.close(writing)
    found.communicate(timeout=60)
    assert found.returncode == 0


def test_one_file_cannot_take_the_results_of_several_studies():
    found = CliRunner().invoke(app, ["fit", "a", "b", "--json", "-"])
    assert isinstance(found.exception, Scan2FlexError) and "--json -" in str(found.exception)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("fit", "nowhere", "--method", "newton"), "least-squares, bfgs, nelder-mead"),
        (("fit", "nowhere", "--distance", "near"), "normal, integrated, hausdorff"),
        (("export", "nowhere", "--to", "catia", "-o", "x"), "mujoco, pyelastica, usd"),
        (("new", "nowhere", "--gravity", "down"), "is not 3 numbers"),
        (("new", "nowhere", "--mass", "1 g", "--density", "1"), "leave one of --mass and --density out"),
    ],
)
def test_options_that_cannot_be_used_are_refused_before_anything_is_read(words, said):
    found = CliRunner().invoke(app, words)
    assert isinstance(found.exception, Scan2FlexError) and said in str(found.exception)


def test_an_interrupt_at_a_prompt_is_one(folder, monkeypatch):  # noqa: F811
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("scan2flex_jax.cli.options.interactive", lambda: True)
    monkeypatch.setattr("typer._click.termui.visible_prompt_func", interrupted, raising=False)
    monkeypatch.setattr("click.termui.visible_prompt_func", interrupted, raising=False)
    assert CliRunner().invoke(app, ["new", str(folder)]).exit_code == 130


def test_files_keep_the_order_in_which_they_are_given(folder, tmp_path):  # noqa: F811
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


def test_a_file_that_is_no_measurement_is_refused(folder, tmp_path):  # noqa: F811
    (tmp_path / "notes.md").write_text("")
    for path, said in ((tmp_path / "notes.md", "no scan or centre curve"), (tmp_path / "none.csv", "is no file")):
        found = run("new", folder / "plane.txt", path, "--length", "1 m", "--mass", "200 g")
        assert isinstance(found.exception, Scan2FlexError) and said in str(found.exception)
