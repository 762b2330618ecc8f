"""`scan2flex fit` and `extract` on a study of scans: from the points, from extracted curves, and told apart in the answer."""

import json

import pytest
from typer.testing import CliRunner

from benchmarks import virtual_experiments as virtual
from scan2flex_jax.cli.app import app
from scan2flex_jax.study import load_study, save_study

pytestmark = pytest.mark.slow
TRUE = virtual.PTFE.bending
FEW = ["--elements", "20"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The virtual PTFE cable, one scan from two sides, as a user would have it on disk."""
    scans = tmp_path_factory.mktemp("scans")
    return save_study(virtual.study_of(virtual.PTFE, scans, 1), tmp_path_factory.mktemp("study")).parent


@pytest.mark.parametrize("data", ["cloud", "curve"])
def test_a_study_of_scans_is_fitted_from_what_the_option_names(folder, tmp_path, data):
    run = CliRunner().invoke(app, ["fit", str(folder), "--data", data, "--json", str(tmp_path / "out.json"), *FEW])
    assert run.exit_code == 0, run.output
    written = json.loads((tmp_path / "out.json").read_text())
    assert written["data"] == data
    found = written["estimates"]["bending_stiffness"]
    assert abs(found["value"] / TRUE - 1.0) < 0.03
    assert found["low"] < TRUE < found["high"]
    assert {"cloud": "fit to point clouds", "curve": "fit to centre curves"}[data] in run.output
    assert load_study(folder).poses[0].curve is None  # the study on disk is as it was


def test_extract_writes_the_curve_and_says_whether_it_is_sure(folder, tmp_path):
    run = CliRunner().invoke(app, ["extract", str(folder), "--save", str(tmp_path / "s"), "--json", str(tmp_path / "c.json")])
    assert run.exit_code == 0, run.output
    (one,) = json.loads((tmp_path / "c.json").read_text()).values()
    assert one["sure"] and abs(one["arc_length"] / virtual.PTFE.length - 1.0) < 0.02
    written = load_study(tmp_path / "s").poses[0].curve
    assert written is not None
    assert f"-> {written.path}" in run.output and f"written: {tmp_path / 's' / 'study.toml'}" in run.output
