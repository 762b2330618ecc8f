"""The background of blind cases: it moves each pose as far as drawn, stays unknown to the study, and is what rivals forgive."""

import tomllib
from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.blind import background, effects, generate, studies
from benchmarks.blind.noise import Noise
from benchmarks.blind.scene import interpolate, mesh, observation_matrix
from benchmarks.blind.shapes import Lens, Model

from .test_generator import CABLE, solved, twisted


@pytest.fixture(scope="module")
def base():
    scene, F, y = solved(CABLE, twisted())
    sigma = mesh(64, scene.cable.length)
    return Model(scene, [], sigma, interpolate(F.sigma, y, sigma))


@pytest.fixture(scope="module")
def under(base):
    return background.draw(np.random.default_rng(3), base)


def test_each_pose_is_moved_as_far_as_drawn(base, under):
    """RMS distance at equal arc length, of the curvature alone; within 0.3 to 1.5 % of L."""
    model = Model(base.scene, under["effects"][:1], base.F.sigma, base.y)
    moved = np.sqrt(((model.y[..., :3] - base.y[..., :3]) ** 2).sum(-1).mean(-1))
    assert np.abs(moved / under["moves"] - 1).max() < background.ALIKE + 1e-3
    low, high = background.MOVES
    assert low <= under["moves"] / base.scene.cable.length <= high


def test_each_pose_has_a_curvature_and_seats_of_its_own(under):
    for own in (under["effects"][0]["harmonics"], under["effects"][1]["rotation"]):
        assert len(own) == 2
        assert np.abs(own[0] - own[1]).max() > 0.1 * np.abs(own).max()


def test_its_columns_are_what_it_does(base, under):
    """To first order, the columns that rivals marginalise move the shapes as the background itself does."""
    s = [np.linspace(0.0, base.scene.cable.length, 60)] * 2
    lens = Lens(base.F.sigma, base.scene.cable.length, s, Noise(1e-3))
    columns = base.nuisances(lens, under["tolerance"])
    harmonics, turns = under["effects"][0]["harmonics"], under["effects"][1]["rotation"]
    small, by_pose = 1e-4, []
    for p in range(2):
        units = harmonics[p] / under["tolerance"].curvature[p][:, None]
        by_pose.append(np.concatenate([turns[p].ravel() / background.SEAT, units.ravel()]))
    own = [{"kind": "pose_curvature", "harmonics": small * harmonics}]
    own += [{"kind": "pose_reseating", "rotation": small * turns}]
    moved = Model(base.scene, own, base.F.sigma, base.y)
    exact = moved.residual(lens, [base.shape(lens, p) for p in range(2)]) / small
    assert np.abs(columns @ np.concatenate(by_pose) - exact).max() < 2e-3 * np.abs(exact).max()


def test_the_attained_error_is_that_of_the_true_curve(base):
    """Points put 2 mm beside a curve, across it, are 2 mm from it."""
    at = np.linspace(0.1, 0.9, 30)
    y, sigma = base.y[0], base.F.sigma
    side = np.cross(np.gradient(y[:, :3], axis=0), [0.0, 0.0, 1.0])
    side = observation_matrix(sigma, at) @ (side / np.linalg.norm(side, axis=1, keepdims=True))
    points = observation_matrix(sigma, at) @ y[:, :3] + 2e-3 * side / np.linalg.norm(side, axis=1, keepdims=True)
    far = background.distances({"model": base}, 0, points)
    assert far == pytest.approx(2e-3, rel=0.01)


def test_a_third_has_nothing_else_and_the_others_one_kind_each():
    kinds = Counter(k for k, off in background.schedule(60, 9) if off is None)
    assert kinds.pop(()) == 20
    assert {len(k) for k in kinds} == {1}
    assert {k for k, in kinds} == set(effects.CATALOGUE)
    assert set(kinds.values()) <= {2, 3}


def test_a_case_tells_its_background_in_the_answer_only(tmp_path):
    rng, case = next(made for k in range(20) if (made := background.make_case((11, 0, k), (), 60)))
    studies.write(rng, {"id": "b001", **case}, tmp_path / "cases", tmp_path / "answers")
    answer = tomllib.loads((tmp_path / "answers" / "b001.toml").read_text())
    study = tomllib.loads((tmp_path / "cases" / "b001" / "study.toml").read_text())
    assert "tolerance" not in study
    roles = Counter(p["role"] for p in study["pose"])
    assert roles["validate"] == 2
    assert roles["fit"] >= 4
    assert answer["kinds"] == []
    # what the true model leaves is background and noise together, both across the cable
    together = np.hypot(answer["background"], np.sqrt(2) * answer["noise_rms"])
    assert answer["attained_fit"] == pytest.approx(together, rel=0.15)
    assert len(answer["background_of_poses"]) == len(study["pose"])


@pytest.mark.parametrize("kinds", [["kink+tether"], ["off:wavy_mass"]])
def test_a_truth_that_the_class_does_not_have_is_refused(kinds):
    asked = SimpleNamespace(kinds=kinds, background=True, count=1, seed=1)
    with pytest.raises(SystemExit, match="one kind of the catalogue"):
        generate.run(asked)
