"""Extraction of a whole study: curves written back, faults named, a picture."""

from dataclasses import replace

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


def test_a_fault_names_the_scan_and_the_pose(study, tmp_path):
    (tmp_path / "one.ply").write_bytes(b"ply\nthis is no cloud")
    with pytest.raises(StudyError) as refusal:
        extract_study(study)
    assert "one.ply" in refusal.value.file
    assert "'one'" in refusal.value.key
    without = replace(study, cable={"length": LENGTH})
    with pytest.raises(StudyError, match="radius"):
        extract_study(without)
