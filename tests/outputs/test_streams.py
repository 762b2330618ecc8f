"""Devices, pipes and streams are written to and stay what they are; what cannot be written is one sentence and exit code 2."""

import contextlib
import io
import json
import os
import stat
import subprocess
import threading
from pathlib import Path

import pytest

from scan2flex_jax.cli import main
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study import files, load_study, write_json_atomic
from scan2flex_jax.study.outputs import Outputs, write_file

from . import scenes


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return scenes.write_study(tmp_path_factory.mktemp("study"))


def one_sentence(found, *words):
    assert found.returncode == 2, (found.returncode, found.stderr)
    assert found.stderr.count("\n") == 1 and found.stderr.startswith("scan2flex: ")
    for word in words:
        assert word in found.stderr


def test_a_pipe_gets_the_result_and_stays_a_pipe(study, tmp_path):
    pipe, read = tmp_path / "pipe", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: read.append(pipe.read_bytes()))
    reader.start()
    assert scenes.run("check", study, "--json", pipe).exit_code == 0
    reader.join(20)
    assert json.loads(read[0])["poses"].keys() == {"sag"}
    assert stat.S_ISFIFO(pipe.stat().st_mode) and [p.name for p in tmp_path.iterdir()] == ["pipe"]


def test_a_pipe_that_nobody_reads_is_said(study, tmp_path, monkeypatch):
    os.mkfifo(tmp_path / "pipe")
    monkeypatch.setattr(files, "PATIENCE", 0.2)
    found = scenes.run("check", study, "--json", tmp_path / "pipe")
    assert isinstance(found.exception, Scan2FlexError)
    assert "nobody read this pipe" in str(found.exception)


def test_a_device_stays_a_device(study, tmp_path):
    (tmp_path / "link.json").symlink_to("/dev/null")
    before = os.stat("/dev/null")
    if not stat.S_ISCHR(before.st_mode):
        pytest.skip("there is no /dev/null")
    assert scenes.run("check", study, "--json", tmp_path / "link.json").exit_code == 0
    assert os.stat("/dev/null").st_ino == before.st_ino
    assert (tmp_path / "link.json").is_symlink()


def test_standard_output_takes_a_result_wherever_it_leads(study, tmp_path):
    """Into a pipe, and into a file, where the words of the command stand too."""
    found = scenes.scan2flex("check", study, "--json", "/dev/stdout")
    assert found.returncode == 0, found.stderr
    assert json.loads(found.stdout[found.stdout.index("\n{") :])["poses"].keys() == {"sag"}
    with (tmp_path / "out.txt").open("w") as out:
        assert scenes.scan2flex("check", study, "--json", "/dev/stdout", stdout=out).returncode == 0
    assert (tmp_path / "out.txt").read_text() == found.stdout


@pytest.mark.parametrize("target", ["out.json", "-"])
def test_a_reader_who_leaves_is_no_fault(study, tmp_path, target):
    """As `| head -1` does; a result in a file is written all the same."""
    reading, writing = os.pipe()
    os.close(reading)
    found = scenes.scan2flex("check", study, "--json", target, stdout=writing, cwd=tmp_path)
    os.close(writing)
    assert found.returncode == 0
    assert target == "-" or (found.stderr == "" and json.loads((tmp_path / target).read_text()))


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")
def test_a_full_device_is_one_sentence(study, tmp_path):
    one_sentence(scenes.scan2flex("check", study, "--json", "/dev/full"), "/dev/full", "No space left")
    assert stat.S_ISCHR(os.stat("/dev/full").st_mode)
    with open("/dev/full", "w") as full:
        one_sentence(scenes.scan2flex("check", study, stdout=full), "No space left")


def test_a_full_disk_leaves_the_old_result(study, tmp_path):
    """A limit on the size of files stands for the disk."""
    file = tmp_path / "out.json"
    assert scenes.scan2flex("check", study, "--json", file).returncode == 0
    old = file.read_bytes()
    limited = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (50, 50)); {scenes.PROGRAM[-1]}"
    for target in (file, tmp_path / "new.json"):
        command = [*scenes.PROGRAM[:-1], limited, "check", str(study), "--json", str(target), "--force"]
        found = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
        one_sentence(found, target.name, "File too large")
    assert file.read_bytes() == old
    assert {p.name for p in tmp_path.iterdir()} == {"out.json"}


def test_links_that_lead_in_a_circle_are_one_sentence(study, tmp_path):
    (tmp_path / "a").symlink_to(tmp_path / "b")
    (tmp_path / "b").symlink_to(tmp_path / "a")
    for words in (["check", study, "--json", tmp_path / "a" / "x.json"], ["check", tmp_path / "a"],
                  ["simulate", study, "--out", tmp_path / "a"]):  # fmt: skip
        found = scenes.run(*words)
        assert isinstance(found.exception, Scan2FlexError) and str(tmp_path / "a") in str(found.exception)
    one_sentence(scenes.scan2flex("check", study, "--json", tmp_path / "a"), str(tmp_path / "a"))
    assert (tmp_path / "a").is_symlink()


def test_a_folder_that_takes_nothing_is_one_sentence(study):
    one_sentence(scenes.scan2flex("check", study, "--json", "/proc/none/x.json"), "/proc")


def test_a_name_with_a_null_byte_is_one_sentence():
    for act in (Outputs().claim, load_study, lambda p: write_json_atomic(p, {}), lambda p: write_file(p, b"")):
        with pytest.raises(Scan2FlexError) as error:
            act(Path("a\0b"))
        assert "\n" not in str(error.value) and "\0" not in str(error.value)


def test_names_that_the_terminal_cannot_show_are_printed(study, tmp_path):
    odd = tmp_path / os.fsdecode(b"caf\xe9")
    scenes.write_study(odd, ["K\u00fcche"])
    for env in ({"PYTHONIOENCODING": "ascii"}, {"PYTHONIOENCODING": "utf-8"}):
        found = scenes.scan2flex("check", odd, env=env)
        assert (found.returncode, found.stderr) == (0, "")
        assert "Poses: 1" in found.stdout


def test_a_path_that_is_too_long_is_one_sentence_where_the_output_is_in_memory(study, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["scan2flex", "check", str(study), "--json", str(tmp_path / ("x" * 300))])
    with contextlib.redirect_stdout(io.StringIO()), pytest.raises(SystemExit) as end:
        main()
    said = capsys.readouterr().err
    assert end.value.code == 2 and said.count("\n") == 1 and "File name too long" in said


def test_an_output_that_is_closed_is_no_traceback(study):
    command = ["sh", "-c", '"$@" >&-', "sh", *scenes.PROGRAM, "check", str(study)]
    found = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert "Traceback" not in found.stderr
