"""Extraction of a whole study: curves written back, faults named, one compilation for all poses, a picture."""

import logging
from dataclasses import replace

import jax
import numpy as np
import pytest
import trimesh

from scan2flex_jax.errors import StudyError
from scan2flex_jax.scan import extract_study, save_picture
from scan2flex_jax.study import Clamp, Study, StudyPose
from tests.scan.truth import ends, scanned

LENGTH, RADIUS = 1.0, 0.012


def quaternion(tangent):
    """The rotation that takes e3 to the tangent."""
    return trimesh.transformations.quaternion_from_matrix(trimesh.geometry.align_vectors([0, 0, 1], tangent))


@pytest.fixture
def study(tmp_path):
    poses = []
    for name, family in (("one", "random"), ("two", "helix")):
        curve, scan = scanned(family, LENGTH, RADIUS)
        trimesh.PointCloud(scan.points[: 10000 + 500 * len(poses)]).export(tmp_path / f"{name}.ply")
        start, end = (Clamp(one.position, quaternion(one.tangent)) for one in ends(curve))
        poses.append(StudyPose(name, "fit", start, end, scan=tmp_path / f"{name}.ply"))
    return Study("two scans", np.array([0.0, 0.0, -9.81]), {"length": LENGTH, "radius": RADIUS}, tuple(poses), folder=tmp_path)


def test_curves_are_written_into_the_study_and_pictured(study, tmp_path):
    seen = []

    def progress(*what):
        seen.append(what)
        raise RuntimeError("a broken progress bar")

    filled, found = extract_study(study, progress)
    assert seen == [("one", 1, 2), ("two", 2, 2)]
    for pose in filled.poses:
        np.testing.assert_allclose(pose.curve.points, found[pose.name].points)
        assert not found[pose.name].warnings
        assert save_picture(found[pose.name], tmp_path / f"{pose.name}.png", pose.name).stat().st_size > 10_000
    again, none = extract_study(filled)
    assert none == {}
    assert again == filled


def test_poses_share_one_compilation(study, caplog):
    one, two = (replace(study, poses=(pose,)) for pose in study.poses)
    extract_study(one)
    with caplog.at_level(logging.WARNING), jax.log_compiles():
        extract_study(two)
    heavy = ("_beside", "_solve", "_judge", "nearest", "_frames")
    compiled = [r.getMessage() for r in caplog.records if "XLA compilation" in r.getMessage()]
    assert not [message for message in compiled if any(f"jit({name})" in message for name in heavy)]


def test_a_fault_names_the_scan_and_the_pose(study, tmp_path):
    (tmp_path / "one.ply").write_bytes(b"ply\nthis is no cloud")
    with pytest.raises(StudyError) as refusal:
        extract_study(study)
    assert "one.ply" in refusal.value.file
    assert "'one'" in refusal.value.key
    without = replace(study, cable={"length": LENGTH})
    with pytest.raises(StudyError, match="radius"):
        extract_study(without)
