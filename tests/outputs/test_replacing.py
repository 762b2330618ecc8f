"""Results replace what the program wrote itself, and nothing else; a study's own files are never replaced."""

import json
import os
import signal
import subprocess
import sys
import time

import matplotlib.pyplot as plt
import pytest

from scan2flex_jax import plot
from scan2flex_jax.errors import Scan2FlexError, StudyError
from scan2flex_jax.prediction import predict, write_csv
from scan2flex_jax.study import load_study, write_json_atomic
from scan2flex_jax.study.outputs import write_file

from . import scenes


@pytest.fixture
def study(tmp_path):
    return scenes.write_study(tmp_path / "study", ["pose-0", "pose-1"])


def refused(found, *words):
    assert isinstance(found.exception, Scan2FlexError), (found.exception, found.output)
    said = str(found.exception)
    assert "\n" not in said
    for word in words:
        assert word in said


@pytest.mark.parametrize("force", [[], ["--force"]])
def test_a_simulation_replaces_no_measured_curve(study, force):
    before = scenes.contents(study)
    refused(scenes.run("simulate", study, "--out", study, "--elements", "8", *force), "pose-0.csv", "name another file")
    assert scenes.contents(study) == before


@pytest.mark.parametrize("force", [[], ["--force"]])
def test_no_way_leads_to_a_file_of_the_study(study, tmp_path, force):
    """Its own name, a way around, links to the file and to its folder, a second name of it, a name that differs in case."""
    (tmp_path / "folder").symlink_to(study)
    (tmp_path / "link.json").symlink_to(study / "pose-0.csv")
    os.link(study / "pose-1.csv", tmp_path / "hard.json")
    ways = [study / "study.toml", study / ".." / "study" / "pose-0.csv", tmp_path / "folder" / "pose-1.csv",
            tmp_path / "link.json", tmp_path / "hard.json", study / "POSE-0.CSV", study / "Study.toml"]  # fmt: skip
    before = scenes.contents(study)
    for way in ways:
        refused(scenes.run("check", study, "--json", way, *force), way.name, "what was measured")
    assert scenes.contents(study) == before


def test_the_file_that_is_read_is_not_replaced(tmp_path):
    file = tmp_path / "export.txt"
    file.write_text("".join(f"{x} {y} {z}\n" for x, y, z in scenes.curve()))
    before = file.read_bytes()
    refused(scenes.run("curve", file, "-o", file, "--force"), "export.txt")
    assert file.read_bytes() == before


def test_a_study_that_is_not_the_command_s_own_is_kept_too(study, tmp_path):
    """Though it cannot be read."""
    other, toml = scenes.write_study(tmp_path / "other"), study / "study.toml"
    for broken in ("", "broken ["):
        toml.write_text(toml.read_text() + broken)
        refused(scenes.run("check", other, "--json", study / "pose-1.csv", "--force"), f"belongs to the study in {study}")
    toml.write_text("broken [")
    refused(scenes.run("check", other, "--json", toml, "--force"), "study.toml")


def test_a_file_of_the_user_and_a_result_are_replaced_by_force_alone(study, tmp_path):
    result, notes = tmp_path / "deep" / "check.json", tmp_path / "notes.json"
    assert scenes.run("check", study, "--json", result).exit_code == 0
    notes.write_text("mine")
    for file in (result, notes):
        refused(scenes.run("check", study, "--json", file), file.name, "there already", "--force")
        assert notes.read_text() == "mine"
        assert scenes.run("check", study, "--json", file, "--force").exit_code == 0
    assert json.loads(notes.read_text())["unknown"] == []
    (tmp_path / "empty.json").touch()  # as mktemp makes it: there is nothing to lose
    assert scenes.run("check", study, "--json", tmp_path / "empty.json").exit_code == 0


def test_two_results_are_not_one_file(study, tmp_path):
    refused(scenes.run("fit", study, "--json", tmp_path / "a.png", "--figure", tmp_path / "." / "a.png"), "two results")
    assert list(tmp_path.iterdir()) == [study]


def test_functions_of_a_notebook_keep_measured_files(study):
    """They replace what their caller names, but no file that a study was measured with."""
    before = scenes.contents(study)
    figure = plt.figure()
    (study / "mine.png").write_text("old")
    plot.save(figure, study / "mine.png")
    (study / "pose-0.png").symlink_to(study / "pose-0.csv")
    with pytest.raises(StudyError, match="what was measured"):
        plot.save(figure, study / "pose-0.png")
    plt.close(figure)
    with pytest.raises(StudyError, match="what was measured"):
        write_json_atomic(study / "study.toml", {})
    prediction = predict(load_study(study), elements=8)["pose-1"]
    with pytest.raises(StudyError, match=r"pose-1\.csv"):
        write_csv({"pose-1": prediction}, study)
    assert before.items() <= scenes.contents(study).items()
    assert write_csv({"other": prediction}, study)["other"][0].exists()


def test_a_report_keeps_the_study_it_is_about(study):
    from scan2flex_jax.reporting import save_report

    with pytest.raises(StudyError, match="what was measured"):
        save_report(load_study(study), study / "pose-0.csv")


WRITER = """
import sys
from pathlib import Path
from scan2flex_jax.study.outputs import Outputs
for _ in range(6):
    Outputs(force=True).write(Path(sys.argv[1]), 300_000 * sys.argv[2].encode())
"""


def test_two_processes_that_write_one_file_leave_it_whole(tmp_path):
    file = tmp_path / "result.json"
    writers = [subprocess.Popen([sys.executable, "-c", WRITER, str(file), letter]) for letter in "ab"]
    while any(writer.poll() is None for writer in writers):
        data = file.read_bytes() if file.exists() else b""
        assert set(data) <= {ord("a")} or set(data) <= {ord("b")}
        assert len(data) in (0, 300_000)
    assert [writer.returncode for writer in writers] == [0, 0]
    assert {path.name for path in tmp_path.iterdir()} == {"result.json"}


KILLED = """
import sys
from pathlib import Path
from scan2flex_jax.study.outputs import Outputs
print("begun", flush=True)
for i in range(10**9):
    Outputs(force=True).write(Path(sys.argv[1]), str(i % 10).encode() * 200_000)
"""


def test_a_process_killed_while_it_writes_leaves_a_whole_file(tmp_path):
    """What is there is an old or a new result."""
    file = tmp_path / "result.json"
    for k in range(2):
        process = subprocess.Popen([sys.executable, "-c", KILLED, str(file)], stdout=subprocess.PIPE)
        assert process.stdout.readline() == b"begun\n"
        time.sleep(0.02 + 0.013 * k)
        process.send_signal(signal.SIGKILL)
        process.communicate()
        data = file.read_bytes()
        assert len(data) == 200_000 and len(set(data)) == 1


def test_a_write_protected_file_stays(tmp_path):
    file = tmp_path / "a.json"
    file.write_text("mine")
    file.chmod(0o400)
    if os.access(file, os.W_OK):
        pytest.skip("this user may write everything")
    with pytest.raises(OSError):
        write_file(file, b"{}")
    assert file.read_text() == "mine"
