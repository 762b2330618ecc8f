"""The benchmark of laws: a measured curve is itself, whatever the cable's size; a run goes on where the last one stopped."""

import json
from dataclasses import replace

import numpy as np
import pytest

from benchmarks import conductor, laws

Q, M = np.array([0.01, 0.02, 0.05, 0.2, 0.6]), np.array([15.0, 31.0, 52.0, 70.0, 84.0])  # 1/m and N m of no real cable


@pytest.fixture
def table(tmp_path):
    path = tmp_path / "curve.csv"
    path.write_text("curvature,moment\n" + "".join(f"{q},{m}\n" for q, m in zip(Q, M, strict=True)))
    return path


@pytest.mark.parametrize("stretch", [1.0, 40.0])
def test_a_measured_curve_goes_through_its_points_and_grows(table, stretch):
    law = replace(conductor.read(table), stretch=stretch)
    k = stretch * Q
    np.testing.assert_allclose(k * law.g(k**2)[0] * M[0] / Q[0] / stretch, M)
    fine = np.linspace(1e-4, 1.5, 4001) * k[-1]
    assert np.all(np.diff(fine * law.g(fine**2)[0]) > 0)
    assert law.yields == pytest.approx(stretch * M[-1] * Q[0] / M[0])


def test_its_derivative_is_that_of_a_complex_step(table):
    law = replace(conductor.read(table), stretch=7.0)
    u = np.linspace(0.001, 6.0, 500) ** 2
    np.testing.assert_allclose(law.g(u + 1e-20j)[0].imag / 1e-20, law.g(u)[1].real, rtol=1e-9, atol=1e-12)


NO_CURVES = ["", "1,2\n", "1,2\n2,1\n3,4\n", "0,0\n1,2\n2,3\n", "a,b\n", "1,2,3\n"]


@pytest.mark.parametrize("text", NO_CURVES)
def test_what_is_no_curve_is_said_with_its_file(tmp_path, text):
    path = tmp_path / "no.csv"
    path.write_text(f"q,m\n{text}")
    with pytest.raises(conductor.CurveError, match=r"no\.csv"):
        conductor.read(path)


@pytest.fixture
def recorded(tmp_path, monkeypatch):
    """A record of the first case of seed 5, and the cases that a run makes."""
    made = []

    def one(i, seed, measured=None):
        made.append((i, seed, measured is not None))
        name = laws.CONDUCTOR if measured else "linear"
        return {"case": i, "law": name, "coverage": 1.0, "error": 0.01, "linear": measured is None}

    monkeypatch.setattr(laws, "RESULTS", tmp_path)
    monkeypatch.setattr("benchmarks.record.RESULTS", tmp_path)
    monkeypatch.setattr(laws, "one", one)
    laws.run(1, 5)
    made.clear()
    return made, tmp_path / "laws.json"


def test_a_run_goes_on_where_the_record_of_its_seed_stops(recorded):
    made, path = recorded
    laws.run(3, 5)
    assert made == [(1, 5, False), (2, 5, False)]
    assert [r["case"] for r in json.loads(path.read_text())["results"]["cases"]] == [0, 1, 2]


def test_a_record_of_another_seed_is_not_gone_on_with(recorded):
    made, path = recorded
    laws.run(2, 6)
    assert made == [(0, 6, False), (1, 6, False)]
    assert json.loads(path.read_text())["results"]["seed"] == 6


def test_a_measured_curve_is_a_case_of_its_own_beside_the_five_laws(recorded, table):
    made, path = recorded
    laws.run(1, 5, conductor.read(table))
    laws.run(1, 5, conductor.read(table))
    assert made == [(0, 5, True)]
    written = json.loads(path.read_text())["results"]
    assert [r["law"] for r in written["cases"]] == ["linear", laws.CONDUCTOR]
    assert written["summary"]["cases"] == 1
