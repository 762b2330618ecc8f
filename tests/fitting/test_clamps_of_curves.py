"""Studies that take their clamps from noisy curves: the intervals hold the stiffness of independent solutions."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from scan2flex_jax.cli.app import app
from scan2flex_jax.convert import measured_files, new_study
from scan2flex_jax.inference import Settings, fit
from scan2flex_jax.study import Clamp, Tolerance, load_study
from tests.reference import cantilever, write_values
from tests.reference.clamped_cases import POSE_WEIGHT

from . import scenes

CASES = Path(__file__).parents[1] / "data" / "clamps_from_curves"
WEIGHT = POSE_WEIGHT / 9.81  # kg/m


@pytest.mark.parametrize(
    ("curve", "options", "true", "widest"),
    [
        ("droop.csv", ("--units", "mm", "--length", "0.4 m", "--density", "0.15"), 0.02, 0.05),
        ("sag.csv", ("--units", "m", "--length", "1 m", "--density", "0.2"), 0.1, 0.6),
    ],
)
def test_curves_with_half_a_millimetre_of_noise(curve, options, true, widest, tmp_path):
    """A droop whose end hangs free, and a sag that is held at both ends."""
    (tmp_path / curve).write_bytes((CASES / curve).read_bytes())
    found = CliRunner().invoke(app, ["new", str(tmp_path), *options, "--clamps-from-curves"])
    assert found.exit_code == 0, found.exception
    study = load_study(tmp_path)
    assert (study.poses[0].end is None) == (curve == "droop.csv")
    e = fit(study).estimates["bending_stiffness"]
    assert e.low < true < e.high < (1 + widest) * e.value


def study_of(folder, curves, length=1.0, length_density=WEIGHT, **given):
    """The study of a folder with these curves (m), and clamps from them."""
    folder.mkdir(exist_ok=True)
    for name, points in curves.items():
        np.savetxt(folder / f"{name}.csv", points, delimiter=",", header="x,y,z", comments="")
    known = {"length": length, "length_density": length_density, **given}
    return new_study(folder, measured_files(folder), clamps=None, **known)[0]


@pytest.mark.parametrize(("noise", "flat"), [(1e-4, True), (5e-4, False)])
def test_intervals_hold_the_truth(noise, flat, tmp_path):
    """Free and clamped ends, in space and in a plane. With clamps that are fitted, a level sag tells less than a steep one."""
    s, rng = np.linspace(0, 0.5, 60), np.random.default_rng(11)
    curves = {"droop": cantilever.positions(0.5, 0.02, 1.2, 0.5, s), "stiff": cantilever.positions(0.5, 0.3, 1.2, 0.0, s)}
    curves |= {name: np.array(write_values.load(name)["positions"]) for name in ("P1", "P3")}
    for name, true in {"droop": 0.02, "stiff": 0.3, "P1": 0.1, "P3": 0.1}.items():
        points = curves[name] + noise * rng.normal(size=curves[name].shape) * ([1, 0, 1] if flat and name != "P3" else 1)
        known = (0.5, 1.2 / 9.81) if name in ("droop", "stiff") else (1.0, WEIGHT)
        study = study_of(tmp_path / name, {"pose": points}, *known)
        assert (study.poses[0].end is None) == (name in ("droop", "stiff"))
        e = fit(study).estimates["bending_stiffness"]
        assert e.low < true < e.high, name
        if (name, noise) != ("P1", 5e-4):  # 21 points with such noise give a lower limit
            assert e.high / e.low < {"droop": 1.1, "stiff": 1.5, "P1": 20.0, "P3": 1.5}[name]


def test_validate_poses_are_judged_by_what_clamps_from_curves_let_expect(tmp_path):
    """GJ moves no plane cantilever and says nothing of the expected error; a pose that may be far off tests little."""
    s, rng = np.linspace(0, 0.5, 60), np.random.default_rng(8)
    angles = {"level": 0.0, "raised": 0.5, "steep": 0.8}
    curves = {n: cantilever.positions(0.5, 0.02, 1.2, a, s) + 5e-4 * rng.normal(size=(60, 3)) for n, a in angles.items()}
    study = study_of(tmp_path, curves, 0.5, 1.2 / 9.81, validate=("steep",))
    found = fit(study)
    assert 0.05 < found.poses["steep"].ratio < 2.0
    assert found.valid is None and found.believable and "they test little" in found.judgement
    assert fit(study, settings=Settings(untested=2 * found.poses["steep"].rms / 0.5)).valid


def test_exact_clamps_would_leave_a_part_of_the_interval(tmp_path):
    """That part is the one that a fit with the true clamps has."""
    recorded, rng = write_values.load("P3"), np.random.default_rng(5)
    points = np.array(recorded["positions"])
    taken = study_of(tmp_path, {"p": points + 3e-4 * rng.normal(size=points.shape)}, noise=3e-4)
    frames = (Rotation.from_matrix(recorded["frames"][i]).as_quat(scalar_first=True) for i in (0, -1))
    start, end = (Clamp(points[i], q) for i, q in zip((0, -1), frames, strict=True))
    true = replace(taken, tolerance=Tolerance(), poses=(replace(taken.poses[0], start=start, end=end),))
    wide, narrow = fit(taken), fit(true)
    widths = [np.log(e.high / e.low) for e in (f.estimates["bending_stiffness"] for f in (wide, narrow))]
    assert narrow.influence.exact_clamps is None and "exact ones" not in scenes.summary_of(narrow)
    assert wide.influence.exact_clamps[0] == pytest.approx(widths[1] / widths[0], rel=0.3)
    assert "clamps are fitted within their tolerance" in scenes.summary_of(wide)


@pytest.mark.slow
def test_the_far_side_of_an_interval_is_as_unlikely_as_the_near_one(tmp_path):
    """Eight noises: a sag between fitted clamps says less of a stiff cable than of a limp one, and intervals hold the truth."""
    rng, points, skewed = np.random.default_rng(21), np.array(write_values.load("P1")["positions"]), 0
    for trial in range(8):
        study = study_of(tmp_path / str(trial), {"p": points + 5e-4 * rng.normal(size=points.shape)})
        e = fit(study).estimates["bending_stiffness"]
        assert e.low is None or e.low < 0.1 < e.high
        skewed += e.low is not None and np.log(e.high / e.value) > 1.2 * np.log(e.value / e.low)
    assert skewed >= 3
