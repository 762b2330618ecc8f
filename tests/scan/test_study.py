"""Extraction of a whole study: curves written back, faults named, a picture."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from scan2flex_jax.errors import StudyError
from scan2flex_jax.inference.fitting import with_curves
from scan2flex_jax.scan import extract_study, save_picture
from scan2flex_jax.study import Clamp, Study, StudyPose
from tests.scan.truth import ends, scanned

LENGTH, RADIUS = 1.0, 0.012


def quaternion(tangent):
    """The rotation that takes e3 to the tangent."""
    return trimesh.transformations.quaternion_from_matrix(trimesh.geometry.align_vectors([0, 0, 1], tangent))


@pytest.fixture
def study(tmp_path):
    curve, scan = scanned("loop", LENGTH, RADIUS)
    trimesh.PointCloud(scan.points).export(tmp_path / "one.ply")
    start, end = (Clamp(one.position, quaternion(one.tangent)) for one in ends(curve))
    poses = (StudyPose("one", "fit", start, end, scan=tmp_path / "one.ply"),)
    return Study("a scan", np.array([0.0, 0.0, -9.81]), {"length": LENGTH, "radius": RADIUS}, poses, folder=tmp_path)


def test_curves_are_written_into_the_study_and_pictured(study, tmp_path):
    seen = []

    def progress(*what):
        seen.append(what)
        raise RuntimeError("a broken progress bar")

    filled, found = extract_study(study, progress)
    assert seen == [("one", 1, 1)]
    for pose in filled.poses:
        np.testing.assert_allclose(pose.curve.points, found[pose.name].points)
        assert not found[pose.name].warnings
        assert save_picture(found[pose.name], tmp_path / f"{pose.name}.png", pose.name).stat().st_size > 10_000
    again, none = extract_study(filled)
    assert none == {}
    assert again == filled


@pytest.mark.slow
def test_guesses_are_no_measurements_and_a_doubtful_pose_is_left_out(tmp_path):
    """Of three poses one has a gap, whose points are not in the study's curve, and one is 2 % longer than the cable."""
    poses, gap = [], (0.35, 0.45)
    for name, gaps, length in (("whole", (), LENGTH), ("gap", (gap,), LENGTH), ("long", (), 1.02 * LENGTH)):
        curve, scan = scanned("loop", length, RADIUS, gaps=gaps)
        trimesh.PointCloud(scan.points).export(tmp_path / f"{name}.ply")
        start, end = (Clamp(one.position, quaternion(one.tangent)) for one in ends(curve))
        poses.append(StudyPose(name, "fit", start, end, scan=tmp_path / f"{name}.ply"))
    poses[0] = replace(poses[0], repeat_of="long")
    study = Study("scans", np.array([0.0, 0.0, -9.81]), {"length": LENGTH, "radius": RADIUS}, tuple(poses), folder=tmp_path)
    whole, said = with_curves(study, lambda _: None)
    assert [pose.name for pose in whole.poses] == ["whole", "gap"]
    assert whole.poses[0].repeat_of is None
    assert any("'long'" in s and "left out" in s and "1.02 m long" in s for s in said)
    apart = np.linalg.norm(np.diff(whole.poses[1].curve.points, axis=0), axis=1)
    assert np.sum(apart > 0.05) == 1
    alone, said = with_curves(replace(study, poses=(poses[2],)), lambda _: None)
    assert len(alone.poses) == 1 and any("doubtful" in s for s in said)


def test_a_fault_names_the_scan_and_the_pose(study, tmp_path):
    (tmp_path / "one.ply").write_bytes(b"ply\nthis is no cloud")
    with pytest.raises(StudyError) as refusal:
        extract_study(study)
    assert "one.ply" in refusal.value.file
    assert "'one'" in refusal.value.key
    without = replace(study, cable={"length": LENGTH})
    with pytest.raises(StudyError, match="radius"):
        extract_study(without)
