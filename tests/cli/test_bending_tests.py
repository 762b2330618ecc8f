"""From the table of a bending test to EI in two commands, and tables that cannot be used."""

import json

import pytest
from typer.testing import CliRunner

from scan2flex_jax.cli.app import app
from tests.fitting.test_bending_tests import SPAN, STIFF, deflection

FORCES = (4.0, 8.0, 12.0, 16.0, 20.0)


def said(*arguments):
    found = CliRunner().invoke(app, list(map(str, arguments)))
    assert found.exit_code == 0, found.output
    return found.output


@pytest.mark.slow
def test_from_five_rows_to_the_stiffness_in_two_commands(tmp_path):
    """A beam on supports that bends by a tenth of its span; deflections are read to 0.01 mm."""
    rows = [f"{f:g};{1e3 * deflection(f):.2f}".replace(".", ",") for f in FORCES]
    (tmp_path / "tests.csv").write_text("\n".join(["Force (N);Deflection (mm)", *rows]))
    out = said("new", tmp_path / "tests.csv", "--test", "three-point", "--span", f"{1e3 * SPAN:g} mm", "--noise", "0.01 mm")
    assert "closed form: EI = 0.1" in out and "5 to fit" in out
    found = said("fit", tmp_path / "tests", "--json", tmp_path / "fit.json")
    e = json.loads((tmp_path / "fit.json").read_text())["estimates"]["bending_stiffness"]
    assert "rests on neither a stated length nor a stated mass" in " ".join(found.split())
    assert e["low"] < STIFF < e["high"]
    assert e["value"] == pytest.approx(STIFF, rel=1e-3)


def test_one_row_needs_no_table(tmp_path):
    out = said("new", "weight=50 g", "deflection=21 mm", "--test", "droop", "--length", "300 mm", "--mass", "9 g", "--noise",
               "0.5 mm", "--out", tmp_path / "one")  # fmt: skip
    assert f"EI = {0.05 * 9.80665 * 0.3**3 / 3 / 0.021:.3g} N m^2" in out
    text = (tmp_path / "one" / "study.toml").read_text()
    assert 'change_from = "unloaded"' in text and 'kind = "point_mass"' in text


@pytest.mark.parametrize(("table", "words"), [
    ("force (N),depth (mm)\n1,2", "the column 'depth (mm)' is not known"),
    ("force (N)\n1", "the column deflection is missing"),
    ("force (V),deflection (mm)\n1,2", "the unit 'V' is none of a force"),
    ("force (N)\tdeflection (mm)\n1\t1,200", "row 1.deflection: '1,200' may be 1200 or 1.200"),
    ("force (N),deflection (mm)\n1,two", "row 1.deflection: got 'two'"),
    ("force (N),deflection (mm)\n1", "got 1 cells: write 2"),
    ("force (N),deflection (mm)\n", "no row below its header"),
])  # fmt: skip
def test_a_table_that_cannot_be_used(table, words, tmp_path):
    (tmp_path / "tests.csv").write_text(table)
    given = ["new", str(tmp_path / "tests.csv"), "--test", "three-point", "--span", "0.2"]
    found = CliRunner().invoke(app, given)
    assert found.exit_code != 0
    assert words in str(found.exception) + found.output


def test_a_test_asks_for_what_it_needs(tmp_path):
    (tmp_path / "tests.csv").write_text("overhang (mm)\n100")
    found = CliRunner().invoke(app, ["new", str(tmp_path / "tests.csv"), "--test", "peirce"])
    assert "--density" in str(found.exception)
    assert not (tmp_path / "tests" / "study.toml").exists()
