"""The data set of blind cases: what is sealed stays out of what is given, and a script that is not ours scores it."""

import ast
import json
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from benchmarks.blind import data_set
from benchmarks.blind.__main__ import rows
from scan2flex_jax import Scan2FlexError, load_study

MADE = Path(__file__).parents[1] / "data" / "blind"


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data-set") / "bent-cables"
    data_set.export(folder, MADE / "cases", MADE / "answers")
    return folder


def answer_of(folder, name):
    return json.loads((folder / "answers" / f"{name}.json").read_text())


def test_the_scorer_is_thirty_lines_of_the_standard_library(exported):
    text = (exported / "score.py").read_text()
    imported = {n.module if isinstance(n, ast.ImportFrom) else n.names[0].name for n in ast.walk(ast.parse(text))
                if isinstance(n, (ast.Import, ast.ImportFrom))}  # fmt: skip
    assert imported <= sys.stdlib_module_names
    assert len([line for line in text.splitlines() if line.strip()]) <= 30


def test_cases_are_studies_without_what_is_asked(exported):
    for folder in (exported / "cases").iterdir():
        study, asked = load_study(folder), json.loads((folder / "asked.json").read_text())
        unseen = answer_of(exported, folder.name)["unseen"]
        assert all(pose.role == "fit" for pose in study.poses)
        assert set(asked["unseen"]) == set(unseen)
        assert not {pose.name for pose in study.poses} & set(unseen)
        given = "".join(f.read_text() for f in folder.iterdir())
        for pose in unseen.values():
            x = pose["points"][len(pose["points"]) // 2]
            assert "".join(f"{v:.6f}," for v in x if v is not None)[:-1] not in given or len(pose["points"]) == 1


def test_the_truth_is_that_of_the_generator(exported):
    truth = tomllib.loads((MADE / "answers" / "t006.toml").read_text())
    told = answer_of(exported, "t006")
    assert told["bending_stiffness"] == truth["true_bending_stiffness"]
    assert told["truth"] == truth["kinds"]
    assert set(truth["accept"]) <= set(told["accept"])


def scored(folder, mine, tmp_path):
    file = tmp_path / "mine.json"
    file.write_text(json.dumps(mine))
    return rows(folder, file)


def test_a_program_that_says_nothing_names_nothing(exported, tmp_path):
    assert all(not r["alarm"] and not r["in_tie_set"] and not r["wrong"] and "unseen_over_noise" not in r
               for r in scored(exported, {}, tmp_path).values())  # fmt: skip


def test_the_truth_scores_best_and_its_measured_points_have_no_error(exported, tmp_path):
    names = [f.stem for f in (exported / "answers").glob("t*.json")]
    true = {name: answer_of(exported, name) for name in names}
    mine = {n: {"named": t["truth"], "missing": t["class"] != "none",
                "bending_stiffness": {"value": v, "low": v, "high": v} if (v := t.get("bending_stiffness")) else {},
                "unseen": {p: u["points"] for p, u in t["unseen"].items()}} for n, t in true.items()}  # fmt: skip
    for name, row in scored(exported, mine, tmp_path).items():
        if name in true:
            assert row["unseen_over_noise"] == pytest.approx(0.0, abs=1e-9)
            assert not row["wrong"]
            assert row["alarm"] == (row["class"] != "none")
            assert row["class"] != "one" or row["in_tie_set"]
            assert row["class"] != "two" or row["both"]
            assert row.get("covers_bending_stiffness", True)


def test_a_curve_moved_by_its_noise_scores_one(exported, tmp_path):
    """A straight curve across its points: each is off by the same distance, the noise of the case."""
    true = answer_of(exported, "t001")
    pose, unseen = next(iter(true["unseen"].items()))
    along = np.linspace(0.0, 1.0, 20)[:, None] * np.array([0.3, 0.4, 0.5])
    moved = along + true["noise"] * np.array([0.8, -0.6, 0.0])  # normal to the curve
    (exported / "answers" / "z.json").write_text(json.dumps(true | {"unseen": {pose: unseen | {"points": along.tolist()}}}))
    longer = np.concatenate([moved[:1] - moved[1:2] + moved[:1], moved, 2 * moved[-1:] - moved[-2:-1]])
    row = scored(exported, {"z": {"unseen": {pose: longer.tolist()}}}, tmp_path)["z"]
    (exported / "answers" / "z.json").unlink()
    assert row["unseen_over_noise"] == pytest.approx(1.0, rel=1e-9)


def test_markers_are_compared_at_their_own_places(exported, tmp_path):
    true = answer_of(exported, "wing-bare")
    mine = {p: [[0.1, 0.2, x[2] + true["noise"]] for x in u["points"]] for p, u in true["unseen"].items()}
    assert scored(exported, {"wing-bare": {"unseen": mine}}, tmp_path)["wing-bare"]["unseen_over_noise"] == pytest.approx(1.0)


def test_every_file_has_its_digest_and_an_export_writes_over_nothing(exported):
    told = json.loads((exported / "dataset.json").read_text())
    listed = set(told["files"])
    assert listed == {f.relative_to(exported).as_posix() for f in exported.rglob("*") if f.is_file()} - {"dataset.json"}
    assert told["version"] == data_set.VERSION
    with pytest.raises(Scan2FlexError, match="name a new folder"):
        data_set.export(exported, MADE / "cases", MADE / "answers")


def test_cases_of_another_seed_are_refused_under_the_names_of_the_record(tmp_path):
    for name in ("cases", "answers"):
        (tmp_path / name).mkdir()
    (tmp_path / "answers" / "b001.toml").write_text("plain_over_noise = 1.0\n")
    with pytest.raises(Scan2FlexError, match=f"--seed {data_set.SEED}"):
        data_set.export(tmp_path / "out", tmp_path / "cases", tmp_path / "answers")


@pytest.mark.slow
def test_a_plain_fit_answers_in_the_form_of_the_data_set(exported, tmp_path):
    mine = tmp_path / "plain.json"
    told = subprocess.run([sys.executable, "-m", "benchmarks.blind", "answer", exported, mine, "--by", "plain"], check=False,
                          capture_output=True, text=True)  # fmt: skip
    assert told.returncode == 0, told.stderr[-500:]
    found = rows(exported, mine)["t003"]  # nothing is missing, and clamps are exact
    assert found["unseen_over_noise"] < 1.15
    assert found["covers_bending_stiffness"]
