"""What the program says of itself: help with examples that are right, exit codes, completion."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from typer.main import get_command
from typer.testing import CliRunner

from scan2flex_jax.cli.app import app
from scan2flex_jax.convert import LENGTHS, TESTS
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.export import TO
from scan2flex_jax.inference.fitting import METHODS

COMMANDS = get_command(app).commands
COMPUTES = ("fit", "explain", "plan", "simulate", "check", "extract", "pose", "curve", "report")
PROGRAM = Path(sys.executable).with_name("scan2flex")


def examples(name):
    """The words of each example of a command."""
    text = " ".join(COMMANDS[name].help.split())
    return [shlex.split(e) for e in re.findall(r"Example: (.*?)(?= Example:|$)", text)]


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_an_example_that_it_understands(name):
    assert examples(name), f"{name} has no example"
    known = {option for parameter in COMMANDS[name].params for option in parameter.opts}
    for words in examples(name):
        assert words[:2] == ["scan2flex", name]
        used = {word.split("=")[0] for word in words[2:] if re.match(r"-{1,2}[a-z]", word)}
        assert used <= known, f"{used - known} in {words}"


@pytest.mark.parametrize("name", COMMANDS)
def test_help_says_what_exit_codes_mean(name):
    found = CliRunner().invoke(app, [name, "--help"], env={"COLUMNS": "200", "TERM": "dumb"})
    assert found.exit_code == 0
    text = " ".join(found.output.split())
    for code in ("0 done", "2 input", "3 computed", "130 interrupted"):
        assert code in text
    assert f"Example: scan2flex {name}" in text
    assert "[cable]" in text or name != "simulate"  # brackets are no markup


@pytest.mark.parametrize("name", COMMANDS)
def test_what_cannot_be_written_is_refused_before_anything_is_read(name, tmp_path):
    """Nobody waits for a result that then has no place: a file in the way of a folder, a folder in the way of a file."""
    (tmp_path / "file").write_text("")
    for parameter in COMMANDS[name].params:
        if parameter.name not in ("json", "out", "save", "figure", "figures"):
            continue
        needed = ["x"] * (name not in ("demo", "schema")) + (["--to", "json"] if name == "export" else [])
        needed += ["-o", "x"] if name == "export" and parameter.name != "out" else []
        found = CliRunner().invoke(app, [name, *needed, parameter.opts[0], str(tmp_path / "file" / "deep.png")])
        assert isinstance(found.exception, Scan2FlexError), (parameter.name, found.output)
        assert f"{tmp_path / 'file'} is not a folder" in str(found.exception)


@pytest.mark.parametrize(("words", "names"), [("fit x --method", METHODS), ("export x -o y --to", TO), ("new x --test", TESTS)])
def test_an_option_has_the_choices_of_its_function(words, names):
    found = CliRunner().invoke(app, [*words.split(), "nonsense"])
    assert str(found.exception).endswith(f"use one of {', '.join(names)}.")


def test_the_units_that_help_names_are_those_that_are_read():
    [units] = [parameter for parameter in COMMANDS["new"].params if parameter.name == "units"]
    assert units.help.endswith(f": {', '.join(LENGTHS)}.")


def test_a_folder_and_a_document_are_no_pictures(tmp_path):
    for target, words in ((tmp_path, "not a picture"), (tmp_path / "fit.docx", ".png, .svg, .pdf")):
        found = CliRunner().invoke(app, ["fit", "x", "--figure", str(target)])
        assert words in str(found.exception)
    found = CliRunner().invoke(app, ["fit", "x", "--json", str(tmp_path)])
    assert "is a folder: name a file in it" in str(found.exception)


@pytest.mark.parametrize("name", COMPUTES)
def test_what_computes_writes_json(name):
    assert any("--json" in parameter.opts for parameter in COMMANDS[name].params)


def test_help_of_the_program_names_every_command():
    found = CliRunner().invoke(app, ["--help"], env={"COLUMNS": "120", "TERM": "dumb"})
    assert all(re.search(rf"\b{name}\b", found.output) for name in COMMANDS)
    assert "--install-completion" in found.output


@pytest.mark.skipif(not PROGRAM.exists(), reason="the program scan2flex is not installed beside this Python")
def test_the_shell_completes():
    asked = {"_SCAN2FLEX_COMPLETE": "complete_bash", "COMP_WORDS": "scan2flex fit --method le", "COMP_CWORD": "3"}
    done = subprocess.run([PROGRAM], capture_output=True, text=True, env={**os.environ, **asked}, timeout=60, check=False)
    assert done.stdout.split() == ["least-squares"], done.stderr


def test_an_interrupt_is_exit_code_130(monkeypatch):
    def interrupted(folder):
        raise KeyboardInterrupt

    monkeypatch.setattr("scan2flex_jax.study.load_study", interrupted)
    assert CliRunner().invoke(app, ["check", "x"]).exit_code == 130


def test_a_wrong_option_is_exit_code_two():
    assert CliRunner().invoke(app, ["fit"]).exit_code == 2
    assert CliRunner().invoke(app, ["fit", "x", "--nothing"]).exit_code == 2
