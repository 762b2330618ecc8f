"""`[cable] section`: what calipers or a data sheet say of the sections along a cable."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from scan2flex_jax.cli.app import app
from scan2flex_jax.errors import StudyError
from scan2flex_jax.prediction import predict
from scan2flex_jax.study import load_study, save_study
from tests.reference import cantilever

L, MASS, G, EI = 1.0, 0.2, 9.81, 0.6
ALONG_X = [0.7071067811865476, 0.0, 0.7071067811865476, 0.0]
STUDY = f"""
format = "scan2flex-study/1"
gravity = [0.0, 0.0, -{G}]
[cable]
length = {L}
length_density = {MASS}
bending_stiffness = {EI}
torsional_stiffness = 0.3
section = "section.csv"
[[pose]]
name = "out"
role = "fit"
start = {{ position = [0.0, 0.0, 0.0], quaternion = {ALONG_X} }}
"""


@pytest.fixture
def folder(tmp_path):
    def written(table, text=STUDY):
        (tmp_path / "section.csv").write_text(table)
        (tmp_path / "study.toml").write_text(text)
        return tmp_path

    return written


def loaded(folder):
    return load_study(folder, purpose="predict")


def test_a_cone_of_stated_stiffness_droops_as_an_independent_solver_says(folder):
    """Diameters fall to half: EI, relative to the middle, with the fourth power, mass with the second, whose sum is kept."""
    study = loaded(folder("s,diameter\n0,0.008\n0.25,0.007\n0.5,0.006\n0.75,0.005\n1,0.004\n"))
    at = np.linspace(0.0, L, 5)

    def log_d(s):
        return np.interp(s, at, np.log([0.008, 0.007, 0.006, 0.005, 0.004]))

    fine = np.linspace(0.0, L, 4001)
    mean = np.trapezoid(np.exp(2 * log_d(fine)), fine)
    stiffness, weight = lambda s: EI * np.exp(4 * (log_d(s) - log_d(0.5))), lambda s: G * MASS * np.exp(2 * log_d(s)) / mean
    found = predict(study, elements=80)["out"].points[-1]
    np.testing.assert_allclose(found[[0, 2]], cantilever.tip(L, stiffness, weight), atol=2e-5)


def test_columns_that_the_cable_does_not_state_are_absolute(folder):
    text = STUDY.replace(f"bending_stiffness = {EI}\n", "").replace(f"length_density = {MASS}\n", "")
    study = loaded(folder("s,bending_stiffness,length_density\n0,0.4,0.3\n1,0.1,0.1\n", text))
    assert study.cable["bending_stiffness"] == pytest.approx(0.2)  # linear in its logarithm
    assert study.cable["length_density"] == pytest.approx((0.3 - 0.1) / np.log(3.0), rel=1e-5)
    (profile,) = study.effects
    assert profile.kind == "section_profile"
    np.testing.assert_allclose(profile.parameters["torsion"], [0.4, 0.1])  # GJ goes with EI


def test_a_section_survives_saving_and_reaches_the_exports(folder, tmp_path):
    study = loaded(folder("s,across_flats\n0,0.006\n1,0.003\n"))
    again = load_study(save_study(study, tmp_path / "saved").parent, purpose="predict")
    np.testing.assert_allclose(again.effects[0].parameters["bending"], study.effects[0].parameters["bending"])
    out = tmp_path / "cable.json"
    assert CliRunner().invoke(app, ["export", str(tmp_path), "--to", "json", "-o", str(out)]).exit_code == 0
    K = np.array(json.loads(out.read_text())["elements"]["stiffness"])
    assert K[0, 3, 3] / K[-1, 3, 3] == pytest.approx(2.0 ** (4 * 39 / 40), rel=1e-3)  # between the middles of 40 elements
    refused = CliRunner().invoke(app, ["export", str(tmp_path), "--to", "usd", "-o", str(tmp_path / "cable.usda")])
    assert "section_profile" in str(refused.exception)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("s,diameter\n0,0.008\n0,0.004\n", "do not grow"),
        ("s,diameter\n0,0.008\n1,0\n", "not positive"),
        ("s,diameter,inner_diameter\n0,0.008,0.009\n1,0.008,0.007\n", "wider inside"),
        ("s,thickness\n0,1\n1,2\n", "header"),
    ],
)
def test_a_wrong_table_is_one_sentence(folder, table, words):
    with pytest.raises(StudyError, match=words) as found:
        loaded(folder(table))
    assert "section.csv" in str(found.value)
    assert "\n" not in str(found.value)


@pytest.mark.parametrize(("length", "words"), [("9" * 400, "a number below"), ('"900 mm"', "quotation marks"), ("0", "above")])
def test_a_wrong_length_is_named_before_the_sections_are_scaled_by_it(folder, length, words):
    text = STUDY.replace(f"bending_stiffness = {EI}\n", "").replace(f"length = {L}", f"length = {length}")
    with pytest.raises(StudyError, match=words) as found:
        loaded(folder("s,bending_stiffness\n0,0.4\n1,0.1\n", text))
    assert found.value.key == "cable.length"
