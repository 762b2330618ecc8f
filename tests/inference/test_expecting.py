"""What poses will tell before they are measured: against the closed form of a stiff cantilever, and as people ask for it."""

from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from scan2flex_jax import Clamp, Scan2FlexError, Study, StudyPose, Unknown, expect, load_study, plot
from scan2flex_jax.cli.app import app
from scan2flex_jax.examples import example_path
from scan2flex_jax.study import save_study

LEVEL = [np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0]  # d3 along x
SIGMA = 2e-4


def planned():
    """The simulated cable of the examples without its curves, with guesses."""
    study = load_study(example_path("simulated-cable"))
    poses = tuple(replace(pose, curve=None) for pose in study.poses)
    guesses = (Unknown("bending_stiffness", guess=0.1), Unknown("torsional_stiffness", guess=0.25))
    return replace(study, poses=poses, unknowns=guesses)


@pytest.mark.slow
def test_the_interval_of_a_stiff_cantilever_is_that_of_the_beam():
    """A cantilever that sags little: w = q s^2 (6 L^2 - 4 L s + s^2) / (24 EI), so d w / d log EI = -w at every point."""
    L, EI, density = 1.0, 20.0, 0.2
    poses = [StudyPose("level", "fit", Clamp(np.zeros(3), np.array(LEVEL)), None)]
    study = Study.from_arrays({"length": L, "length_density": density, "torsional_stiffness": 10.0}, [], [])
    study = replace(study, poses=tuple(poses), unknowns=(Unknown("bending_stiffness", guess=EI),))
    found = expect(study, noise=SIGMA)
    s = np.arange(1, 40) / 40 * L
    w = density * 9.81 * s**2 * (6 * L**2 - 4 * L * s + s**2) / (24 * EI)
    d = np.abs(s[:, None] - s) / (0.07 * L)  # half of the variance white, half correlated over 7 % of the length
    smooth = 0.5 * ((1 + np.sqrt(3) * d) * np.exp(-np.sqrt(3) * d) + np.exp(-0.5 * d**2))
    C = 0.5 * SIGMA**2 * (np.eye(len(s)) + smooth)
    expected = 1 / np.sqrt(w @ np.linalg.solve(C, w))
    assert found.estimates["bending_stiffness"].std / EI == pytest.approx(expected, rel=0.05)
    assert found.noise == pytest.approx(SIGMA)


@pytest.fixture(scope="module")
def expectation():
    return expect(planned(), noise=1e-3)


@pytest.mark.slow
def test_less_noise_shows_more(expectation):
    finer = expect(planned(), noise=0.5e-3)
    for name, e in expectation.estimates.items():
        assert finer.estimates[name].std == pytest.approx(0.5 * e.std, rel=0.02)
    sizes = {v.kind: v.size for v in finer.effects}
    assert all(sizes[v.kind] == pytest.approx(0.5 * v.size, rel=0.05) for v in expectation.effects[:10])


@pytest.mark.slow
def test_plane_poses_do_not_determine_torsion():
    study = planned()
    told = expect(replace(study, poses=tuple(p for p in study.poses if p.name == "plane")))
    assert told.estimates["torsional_stiffness"].std is None or told.estimates["torsional_stiffness"].std > 1.0
    assert "torsional_stiffness      not determined" in told.summary()


@pytest.mark.slow
def test_a_file_without_curves_is_planned(tmp_path):
    save_study(replace(planned(), folder=None), tmp_path / "planned")
    words = ["plan", tmp_path / "planned", "--figure", tmp_path / "seen.png", "--json", tmp_path / "seen.json", "--quiet"]
    words += ["--elements", 40]
    told = CliRunner().invoke(app, [*map(str, words)], env={"SCAN2FLEX_CACHE": "off"})
    assert told.exit_code == 0, told.output
    assert "what 3 poses will tell" in told.output
    assert "next poses to scan" in told.output
    assert (tmp_path / "seen.png").stat().st_size > 10_000


@pytest.mark.slow
def test_the_picture_has_a_row_for_every_effect(expectation):
    assert len(plot.expected(expectation).get_yticklabels()) == len(expectation.effects)
    assert expectation.to_json()["effects"][0]["kind"] == expectation.effects[0].kind


def test_what_cannot_be_expected_is_said():
    with pytest.raises(Scan2FlexError, match="nothing is unknown"):
        expect(replace(planned(), unknowns=(), cable=planned().cable | {"bending_stiffness": 0.1, "torsional_stiffness": 0.25}))
    with pytest.raises(Scan2FlexError, match="must be a positive number of metres"):
        expect(planned(), noise=-1e-3)
    with pytest.raises(Scan2FlexError, match="guess"):
        expect(replace(planned(), unknowns=(Unknown("bending_stiffness"), Unknown("torsional_stiffness"))))
