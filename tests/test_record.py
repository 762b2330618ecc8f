"""The benchmarks' own watch: a ratio that got worse by more than 30 % is reported, by name, and the command fails."""

import json
import shutil
import subprocess

import pytest

from benchmarks import record as r


def test_worse_is_more_than_thirty_percent():
    before = {"a": 1.0, "b": 1.0, "c": 2.0, "gone": 1.0, "broken": 1.0}
    now = {"a": 1.29, "b": 1.31, "c": 0.5, "new": 9.0, "broken": float("nan")}
    told = r.worse(before, now)
    assert [sentence.split()[0] for sentence in told] == ["b", "gone", "broken"]
    assert "was 1 and is 1.31" in told[0]
    assert r.worse({}, now) == []


@pytest.fixture
def results(tmp_path, monkeypatch):
    folder = tmp_path / "results"
    monkeypatch.setattr(r, "RESULTS", folder)
    return folder


def test_a_run_that_got_worse_is_recorded_and_fails(results, capsys):
    r.conclude("it", {"figure": 1}, {"warm over generic": 0.4})
    with pytest.raises(SystemExit) as ended:
        r.conclude("it", {"figure": 2}, {"warm over generic": 0.6})
    assert ended.value.code == 1
    assert capsys.readouterr().err == "REGRESSION: it: warm over generic was 0.4 and is 0.6\n"
    written = json.loads((results / "it.json").read_text())
    assert (written["results"]["figure"], written["ratios"]) == (2, {"warm over generic": 0.6})


@pytest.mark.skipif(shutil.which("git") is None, reason="git is not installed: without it the record on disk counts")
def test_what_counts_is_the_record_that_was_committed(results):
    """Else a second run would take the first one's regression for granted."""
    r.record("it", {}, {"x": 1.0})
    git = ["git", "-C", str(results), "-c", "user.name=a", "-c", "user.email=a@b.c"]
    for command in (["init", "-q"], ["add", "."], ["commit", "-q", "-m", "x"]):
        subprocess.run([*git, *command], check=True)
    for _ in range(2):
        with pytest.raises(SystemExit):
            r.conclude("it", {}, {"x": 2.0})
    r.conclude("it", {}, {"x": 1.2})


def test_records_name_their_ratios():
    """What the committed records watch are numbers, or the comparison of the next run would say nothing."""
    for path in r.RESULTS.glob("*.json"):
        ratios = json.loads(path.read_text()).get("ratios", {})
        assert all(isinstance(x, float) and x > 0 for x in ratios.values()), path.name
