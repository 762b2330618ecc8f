"""`scan2flex explain` writes what it says: JSON in the study's format, pictures, and a study that goes round again."""

import json
import os
import subprocess
import sys

import matplotlib.pyplot as plt
import numpy as np
import pytest
from typer.testing import CliRunner

from scan2flex_jax.cli.app import app
from scan2flex_jax.study import load_study, save_study

from . import scenes

pytestmark = pytest.mark.slow
ALLOWED = {"no missing effect", "explained", "tied", "unexplained", "not in equilibrium"}


def test_explain_writes_result_pictures_and_study(tmp_path):
    study = scenes.case("t004", unseen=("p7",))
    save_study(study, tmp_path / "case")
    options = ["--json", tmp_path / "result.json", "--figures", tmp_path / "pictures", "--save", tmp_path / "again"]
    found = CliRunner().invoke(app, ["explain", str(tmp_path / "case"), "--elements", "40", *map(str, options)])
    assert found.exit_code == 0, found.output
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["format"] == "scan2flex-result/1"
    assert result["verdict"] in ALLOWED
    assert result["verdict"] in found.output
    assert list(result["poses"]) == [p.name for p in study.poses]
    for name, pose in result["poses"].items():
        assert pose["rms"] >= 0
        assert ("left_out" in pose) == (next(p for p in study.poses if p.name == name).role == "fit")
    assert result["after"]["rms_fit"] < result["before"]["rms_fit"]
    assert result["after"]["rms_left_out"] < result["before"]["rms_left_out"]
    assert {"kind", "parameters", "log_evidence", "p_value", "verdict", "tied_with"} <= set(result["ranking"][0])
    load = result["equivalent_load"]
    assert np.shape(load["mean"]) == np.shape(load["std"]) == (len(load["s"]), 3)
    for picture in ("explanation.png", "shapes.png"):
        assert plt.imread(tmp_path / "pictures" / picture).std() > 0.02
    again = load_study(tmp_path / "again")
    assert [e.kind for e in again.effects] == [c["kind"] for c in result["chosen"]]


def test_plan_continues_from_the_search_of_explain(tmp_path):
    """In processes of their own, through the folder of compiled functions; a changed study is searched again."""
    save_study(scenes.case("t004", unseen=("p7",)), tmp_path / "case")

    def run(command):
        words = [sys.executable, "-m", "scan2flex_jax", command, str(tmp_path / "case"), "--elements", "40"]
        env = {**os.environ, "SCAN2FLEX_CACHE": str(tmp_path / "cache")}
        done = subprocess.run(words, capture_output=True, text=True, env=env, timeout=900, check=False)
        assert done.returncode == 0, done.stderr
        return done

    explained, planned = run("explain"), run("plan")
    assert "hypotheses of an earlier search" not in explained.stderr
    assert "hypotheses of an earlier search" in planned.stderr
    assert explained.stdout.splitlines()[0] in planned.stdout
    searches = set((tmp_path / "cache").glob("search-*"))
    toml = tmp_path / "case" / "study.toml"
    toml.write_text(toml.read_text() + "\n# looked through\n")
    assert "hypotheses of an earlier search" not in run("plan").stderr
    assert len(set((tmp_path / "cache").glob("search-*")) - searches) == 1
