"""The command line, run as a user runs it: in a process of its own where the exit code and the streams count."""

import io
import json
import subprocess
import sys

import matplotlib.pyplot as plt
import numpy as np
import pytest
from rich.console import Console

import scan2flex_jax
from scan2flex_jax import plot
from scan2flex_jax.cli import setup
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.examples import example_names, example_path
from tests.outputs import scenes

WIRE = example_path("black-wire")


@pytest.fixture
def folder(tmp_path):
    return scenes.write_study(tmp_path)


def _replace(folder, old, new):
    file = folder / "study.toml"
    assert old in file.read_text()
    file.write_text(file.read_text().replace(old, new))


UNKNOWN = "\n[unknown.bending_stiffness]\n[unknown.torsional_stiffness]\n[unknown.length_density]\n"
BROKEN = {
    "no curve": (lambda f: (f / "pose-0.csv").unlink(), "pose-0.csv"),
    "misspelt": (lambda f: _replace(f, "length_density", "lenght_density"), "lenght_density"),
    "no pose to fit": (lambda f: _replace(f, 'role = "fit"', 'role = "validate"'), "fit"),
    "no gravity": (lambda f: (_replace(f, "-9.81", "0.0"), (f / "study.toml").open("a").write(UNKNOWN)), "gravity"),
    "nothing unknown": (lambda f: None, "unknown"),
}


@pytest.mark.parametrize("fault", BROKEN)
def test_bad_input_is_one_sentence(folder, fault):
    break_it, word = BROKEN[fault]
    break_it(folder)
    found = scenes.run("fit", folder)
    assert isinstance(found.exception, Scan2FlexError) and word in str(found.exception)
    assert "\n" not in str(found.exception) and found.stdout == ""


def test_bad_input_ends_the_program_with_code_two(folder):
    (folder / "study.toml").unlink()
    found = scenes.scan2flex("fit", folder)
    assert (found.returncode, found.stdout) == (2, "")
    assert "Traceback" not in found.stderr and "study.toml" in found.stderr


def run(*words):
    found = scenes.run(*words)
    assert found.exit_code == 0, (found.exception, found.output)


def test_fit_and_simulate_write_what_they_say(tmp_path):
    run("fit", example_path("simulated-cable"), "--elements", 40, "--json", tmp_path / "fit.json",
        "--save", tmp_path / "fitted", "--figure", tmp_path / "fit.png")  # fmt: skip
    result = json.loads((tmp_path / "fit.json").read_text())
    assert result["format"] == "scan2flex-result/1"
    estimate = result["estimates"]["bending_stiffness"]
    assert estimate["low"] < estimate["value"] < estimate["high"]
    assert estimate["value"] == pytest.approx(0.1, rel=5e-3)
    assert (tmp_path / "fit.png").stat().st_size > 10_000
    run("simulate", tmp_path / "fitted", "--out", tmp_path / "shapes", "--elements", 40)
    shape = np.loadtxt(tmp_path / "shapes" / "plane.csv", delimiter=",", skiprows=1)
    forces = np.loadtxt(tmp_path / "shapes" / "plane-forces.csv", delimiter=",", skiprows=1)
    assert shape[-1, 0] == pytest.approx(1.0)
    np.testing.assert_allclose(shape[[0, -1], 1:], [[0, 0, 0], [0.6, 0, 0]], atol=1e-9)
    # equilibrium of the part between two sections: the force changes by the weight in between (paper, Eq. 5)
    weight = 0.2 * 9.81 * (forces[-1, 0] - forces[0, 0])
    change = forces[-1, 1:4] - forces[0, 1:4]
    np.testing.assert_allclose(change, [0, 0, weight], atol=4e-3 * weight)  # second order


def test_brackets_in_a_title_are_no_markup(monkeypatch):
    """Markup that is not closed rightly would end the command with an error of the library that draws the line."""
    shown = Console(file=io.StringIO(), force_terminal=True, width=80)
    monkeypatch.setattr(setup, "ERRORS", shown)
    with setup.progress("fitting a [bold cable[/red]") as tell:
        tell("iteration 1 [/]")
    assert "a [bold cable[/red]" in shown.file.getvalue()


def test_progress_that_no_terminal_shows_is_plain_lines(capsys):
    """In a log or a pipe every message is a line of its own, there at once, that cannot move a cursor."""
    with setup.progress("fitting a cable") as tell:
        assert capsys.readouterr().err == ""
        tell("iteration 1: cost 2")
        assert capsys.readouterr().err == "fitting a cable: iteration 1: cost 2\n"
        tell("iteration 2 \x1b[2K\r")
    said = capsys.readouterr()
    assert said.err.count("\n") == 1 and "\x1b" not in said.err and "\r" not in said.err
    assert said.out == ""


def test_progress_may_be_silent(capsys):
    with setup.progress("fitting a cable", quiet=True) as tell:
        tell("iteration 1: cost 2")
    assert capsys.readouterr() == ("", "")


def test_progress_that_nobody_reads_is_no_fault(monkeypatch):
    class Closed(io.StringIO):
        def write(self, text):
            raise BrokenPipeError

    monkeypatch.setattr(sys, "stderr", Closed())
    with setup.progress("fitting a cable") as tell:
        tell("iteration 1: cost 2")


@pytest.mark.parametrize("command", ["fit", "explain"])
@pytest.mark.parametrize("options", [[], ["--quiet"]], ids=["told", "quiet"])
def test_fit_and_explain_tell_their_progress(command, options, monkeypatch):
    def told(study, *_, progress, **__):
        progress("iteration 1: cost 2")
        raise Scan2FlexError("enough")

    monkeypatch.setattr("scan2flex_jax.inference.fit", told)
    monkeypatch.setattr("scan2flex_jax.inference.explain", told)
    name = example_names()[0]
    found = scenes.run(command, example_path(name), *options)
    assert str(found.exception) == "enough"
    assert found.stderr.endswith(": iteration 1: cost 2\n") if not options else found.stderr == ""


def test_a_picture_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    """The old file stays when the new one fails, and nothing is left beside it."""
    figure, file = plt.figure(), tmp_path / "deep" / "fit.svg"
    plot.save(figure, file)
    old = file.read_bytes()
    assert b"<svg" in old

    def full(self, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.replace", full)
    with pytest.raises(OSError, match="No space"):
        plot.save(figure, file)
    assert file.read_bytes() == old
    assert list(file.parent.iterdir()) == [file]
    with pytest.raises(Scan2FlexError, match="is not a picture"):
        plot.save(figure, tmp_path / "fit.docx")
    plt.close(figure)


def test_the_program_ends_with_its_answer_while_something_is_still_being_compiled(tmp_path):
    busy = "import threading, time; threading.Thread(target=time.sleep, args=(200,)).start()"
    code = f"{busy}; from scan2flex_jax.cli import main; main()"
    command = [sys.executable, "-c", code, "check", str(tmp_path / "nothing")]
    found = subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
    assert found.returncode == 2
    assert "nothing" in found.stderr


def test_several_studies_need_names_for_their_files(tmp_path):
    for folder in ("a/cable", "b/cable"):
        (tmp_path / folder).mkdir(parents=True)
    found = scenes.run("fit", tmp_path / "a", tmp_path / "b", "--json", tmp_path / "out.json")
    assert "put {} where the study's name belongs" in str(found.exception)
    same = scenes.run("explain", tmp_path / "a/cable", tmp_path / "b/cable", "--json", tmp_path / "{}.json")
    assert "two studies are called cable" in str(same.exception)


@pytest.mark.slow
@pytest.mark.parametrize("more", [(), ("--workers", "2")])
def test_several_studies_and_one_that_is_refused(tmp_path, more):
    good = example_path("simulated-cable")
    (tmp_path / "bad").mkdir()
    found = scenes.scan2flex("fit", tmp_path / "bad", good, "--json", tmp_path / "results" / "{}.json", "--quiet", *more)
    assert found.returncode == 2 and "bad" in found.stderr and "Traceback" not in found.stderr
    assert "EI" in found.stdout and found.stdout.index(str(tmp_path / "bad")) < found.stdout.index(str(good))
    result = json.loads((tmp_path / "results" / f"{good.name}.json").read_text())
    assert result["estimates"]["bending_stiffness"]["value"] == pytest.approx(0.1, rel=0.01)


def test_the_module_is_the_program_and_knows_its_version():
    command = [sys.executable, "-m", "scan2flex_jax", "--version"]
    found = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (found.returncode, found.stdout, found.stderr) == (0, f"scan2flex_jax {scan2flex_jax.__version__}\n", "")


def test_json_on_standard_output_stands_there_alone(tmp_path):
    done = scenes.scan2flex("check", WIRE, "--json", "-", cwd=tmp_path)
    found = json.loads(done.stdout)
    assert found["scan2flex_jax"] == scan2flex_jax.__version__
    assert found["poses"].keys() == {"turn-0", "turn-360"} and "Poses: 1 to fit" in done.stderr
    assert list(tmp_path.iterdir()) == []
    assert scenes.run("check", WIRE, "--json", "-").exit_code == 0
    assert "Poses: 1 to fit" in scenes.run("check", WIRE).stdout  # the next command prints as ever


def test_other_documents_on_standard_output_stand_there_alone():
    for words in (("schema", "-o", "-"), ("pose", "--matrix", "1 0 0 0 0 1 0 0 0 0 1 0", "--json", "-")):
        found = scenes.scan2flex(*words)
        assert scan2flex_jax.__version__ in json.dumps(json.loads(found.stdout)) and found.stderr


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("fit", "nowhere", "--method", "newton"), "least-squares, bfgs, nelder-mead"),
        (("fit", "nowhere", "--distance", "near"), "normal, integrated, hausdorff"),
        (("export", "nowhere", "--to", "catia", "-o", "x"), "mujoco, pyelastica, usd"),
        (("fit", "a", "b", "--json", "-"), "--json -"),
        (("new", "nowhere", "--gravity", "down"), "is not 3 numbers"),
        (("new", "nowhere", "--mass", "1 g", "--density", "1"), "leave one of --mass and --density out"),
    ],
)
def test_options_that_cannot_be_used_are_refused_before_anything_is_read(words, said):
    found = scenes.run(*words)
    assert isinstance(found.exception, Scan2FlexError) and said in str(found.exception)
