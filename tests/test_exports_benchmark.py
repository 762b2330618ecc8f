"""The benchmark of exports: simulators that are missing are left out with a sentence, and the order is watched."""

import sys

import pytest

from benchmarks import exports, exports_tables, settling


def test_a_simulator_that_is_not_installed_is_one_sentence(monkeypatch, capsys):
    monkeypatch.setitem(settling.PACKAGES, "usd", "no-such-simulator")
    monkeypatch.setattr(sys, "argv", ["settling.py", "usd", "cable.usda"])
    with pytest.raises(SystemExit) as ended:
        settling.main()
    assert ended.value.code == settling.MISSING
    assert capsys.readouterr().err == f"no-such-simulator is not installed for {sys.executable}\n"


def test_a_missing_simulator_is_left_out_of_the_record(monkeypatch, tmp_path, capsys):
    script = tmp_path / "settling.py"
    script.write_text(f"import sys; sys.stderr.write('it is not here'); sys.exit({settling.MISSING})")
    monkeypatch.setattr(exports, "SCRIPT", script)
    assert exports.settled(sys.executable, "usd", tmp_path / "cable.usda") is None
    assert capsys.readouterr().out == "usd: left out, it is not here\n"


def test_a_simulator_that_fails_is_no_missing_one(monkeypatch, tmp_path):
    script = tmp_path / "settling.py"
    script.write_text("raise ValueError('no such body')")
    monkeypatch.setattr(exports, "SCRIPT", script)
    with pytest.raises(RuntimeError, match="no such body"):
        exports.settled(sys.executable, "usd", tmp_path / "cable.usda")


def test_the_ratio_is_that_of_twice_the_links():
    links = {"20": {"distance over length": 4e-3}, "40": {"distance over length": 1e-3}}
    found = exports.ratios({"mujoco": {"links": links}, "usd": {"links": {"20": {"distance over length": 0.01}}}})
    assert found == {"mujoco: 40 links over 20": 0.25}


def test_the_table_has_a_row_of_dashes_for_a_simulator_that_was_left_out(monkeypatch):
    links = {"20": {"distance over length": 4e-3, "fastest": None}, "40": {"distance over length": 1e-3, "fastest": 1e-9}}
    entry = {
        "results": {"mujoco": {"version": "4.0", "links": links}},
        "machine": {"cores": 2, "cpu": "x", "load_average": 1.0}, "versions": {"jax": "1"}, "date": "2026-01-01",
    }  # fmt: skip
    monkeypatch.setattr(exports_tables, "load", lambda name: entry)
    rows = exports_tables.exports().splitlines()
    assert rows[2:6] == ["| MuJoCo 4.0 | 20 | 0.400 % | - |", "| MuJoCo 4.0 | 40 | 0.100 % | 1e-09 |",
                         "| PyElastica | - | - | - |", "| Newton | - | - | - |"]  # fmt: skip
