"""What a layout needs of a known cable: bend radius, tension, reactions, in the poses of a table of clamps."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from scan2flex_jax.cli.app import app
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.prediction import posed, predict
from scan2flex_jax.study import Clamp, load_study
from tests.outputs.scenes import ALONG_X, HEAD

EI, MASS, G = 0.1, 0.2, 9.81  # those of `HEAD`
POSE = f'[[pose]]\nname = "sag"\nrole = "fit"\nstart = {{ position = [0.0, 0.0, 0.0], quaternion = {ALONG_X} }}\n'


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "hose").mkdir()
    (tmp_path / "hose" / "study.toml").write_text(HEAD + POSE)
    return tmp_path / "hose"


def test_a_hanging_cable_carries_its_weight_and_a_cantilever_bends_most_at_its_clamp(folder):
    """Vertical: no bend, tension m g at the top and 0 at the end. Horizontal: curvature at the clamp is its moment over EI."""
    down = [0.0, 1.0, 0.0, 0.0]  # d3 = -z
    clamps = {"down start": Clamp([0.0, 0.0, 0.0], down), "out start": Clamp([0.0, 0.0, 0.0], ALONG_X)}
    found = predict(posed(load_study(folder, purpose="predict"), clamps))
    assert found["down"].bend_radius > 1e3
    half = 0.5 / len(found["down"].tension)
    np.testing.assert_allclose(found["down"].tension[[0, -1]], MASS * G * np.array([1.0 - half, half]), atol=1e-6)
    out = found["out"]
    assert out.bend_at == 0.0
    assert 1.0 / out.bend_radius == pytest.approx(np.linalg.norm(out.reaction_moment[0]) / EI, rel=2e-3)


def test_forces_and_moments_along_and_across_the_cable(folder):
    """A level cantilever: at its clamp the weight beyond acts across, its moment bends, and nothing twists."""
    out = predict(posed(load_study(folder, purpose="predict"), {"out start": Clamp([0.0, 0.0, 0.0], ALONG_X)}))["out"]
    beyond = MASS * G * (1.0 - out.section_s[0])
    assert np.hypot(out.tension[0], out.shear[0]) == pytest.approx(beyond, rel=2e-3)  # of a mesh of 40 elements
    assert out.shear[0] == pytest.approx(beyond * np.hypot(*out.tangents[0, :2]), rel=2e-3)
    np.testing.assert_allclose(out.bending, np.linalg.norm(out.moment, axis=1))
    np.testing.assert_allclose(out.torque, 0.0, atol=1e-9)


def test_a_table_of_clamps_is_simulated_in_one_command(folder, tmp_path):
    layout = tmp_path / "layout.csv"
    q = ",".join(map(str, ALONG_X))
    layout.write_text(f"name,x,y,z,qw,qx,qy,qz\narch start,0,0,0,{q}\narch end,500,0,0,{q}\nhang start,0,0,0,{q}\n")
    said = ["--units", "mm", "--out", str(tmp_path / "out"), "--json", str(tmp_path / "out.json")]
    ran = CliRunner().invoke(app, ["simulate", str(folder), "--clamps", str(layout), *said])
    assert ran.exit_code == 0
    found = json.loads((tmp_path / "out.json").read_text())
    assert set(found) == {"arch", "hang"}
    assert {p.name for p in (tmp_path / "out").iterdir()} >= {"arch-forces.csv", "arch.csv", "hang-forces.csv", "hang.csv"}
    pull = np.array([found["arch"][end]["force"] for end in ("start", "end")])
    np.testing.assert_allclose(pull.sum(axis=0), [0.0, 0.0, MASS * G], atol=1e-6)  # both ends carry the weight
    np.testing.assert_allclose(found["hang"]["start"]["force"], [0.0, 0.0, MASS * G], atol=1e-6)
    assert ran.output.count("smallest bend radius") == 2
    assert ran.output.count("the end exerts") == 1  # the end of `hang` is free


@pytest.mark.parametrize(("name", "words"), [("sag", "POSE start"), ("sag end", "no clamp at its start")])
def test_a_clamp_of_no_pose_is_one_sentence(folder, name, words):
    with pytest.raises(Scan2FlexError, match=words):
        posed(load_study(folder, purpose="predict"), {name: Clamp([0.0, 0.0, 0.0], ALONG_X)})


def test_a_known_cable_is_exported_without_a_measured_shape(folder, tmp_path):
    for to, file in (("abaqus", "hose.inp"), ("mujoco", "hose.xml")):
        assert CliRunner().invoke(app, ["export", str(folder), "--to", to, "-o", str(tmp_path / file)]).exit_code == 0
        assert (tmp_path / file).stat().st_size > 1000
