"""docs/first-cable.md, run as it stands there: the same commands on the same files, from two starting points.

The third starting point, arrays in Python, is docs/python.md: tests/notebook/test_studies_in_memory.py.
"""

import json
import re
import shutil

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks.readme import opening
from benchmarks.record import load
from scan2flex_jax import load_study
from scan2flex_jax.cli.app import app
from tests.documents import DOCS, commands, printed_files, section

PAGE = (DOCS / "first-cable.md").read_text("utf-8")
TRUE = {"bending_stiffness": 0.1, "torsional_stiffness": 0.25}  # of the simulated cable, N m^2


def run(words):
    found = CliRunner().invoke(app, words)
    assert found.exit_code == 0, (words, found.exception or found.output)
    return found.stdout


def steps(*titles):
    """The commands below these headings."""
    return [words for title in titles for words in commands(section(PAGE, title))]


@pytest.fixture
def scans(tmp_path, monkeypatch):
    """The folder of measurements, and the study that the page's second step makes of it."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(DOCS / "first-cable" / "scans", tmp_path / "scans")
    said = [run(words) for words in steps("2. Make the study")]
    assert len(said) == 2
    return tmp_path


def test_the_files_are_those_of_the_page():
    told = re.findall(r"scans/(\S+\.csv)", section(PAGE, "1. A folder of measurements"))
    assert sorted(told) == sorted(p.name for p in (DOCS / "first-cable" / "scans").iterdir())
    lines = (DOCS / "first-cable" / "scans" / "clamps.csv").read_text().splitlines()
    assert "\n".join(lines[:3]) in PAGE


def test_curves_and_robot_frames_lead_to_the_stiffness(scans):
    study = load_study(scans / "scans")
    assert [p.name for p in study.validate_poses] == ["unseen"]
    [said] = [run(words) for words in steps("3. Fit")]
    found = json.loads((scans / "result.json").read_text())
    for name, true in TRUE.items():
        assert found["estimates"][name]["low"] < true < found["estimates"][name]["high"]
    assert found["poses"]["unseen"]["rms"] < 0.6e-3
    assert (scans / "fit.png").stat().st_size > 10_000
    shown = load("readme")["results"]["lines"]
    assert opening(said)[1:] == shown[1:], "run `python -m benchmarks.readme`, then `python -m benchmarks.tables`"


@pytest.mark.slow
def test_the_other_steps_of_the_page(scans):
    for words in steps("3. Fit", "4. What is missing, and what to measure next", "5. Use the cable"):
        run(words)
    assert "<mujoco" in (scans / "cable.xml").read_text()
    assert "<html" in (scans / "report.html").read_text()[:300]
    assert len(list((scans / "predicted").iterdir())) >= 4


@pytest.mark.slow
def test_markers_lead_to_the_stiffness(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "markers").mkdir()
    files = printed_files(section(PAGE, "Markers"))
    assert len(files) == 3
    for name, text in files:
        (tmp_path / name).write_text(text)
    for words in steps("Markers"):
        run(words)
    cable = load_study(tmp_path / "calibrated-markers").cable
    np.testing.assert_allclose([cable[name] for name in TRUE], list(TRUE.values()), rtol=0.02)
