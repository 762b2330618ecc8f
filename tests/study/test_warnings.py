"""What `check` doubts before any fit: curves, clamps, a weight, a radius, a direction of gravity or a scan that no cable has.

A fault is named with its pose where one has it, and once where all have it.
"""

import re
from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.errors import Scan2FlexError, StudyError
from scan2flex_jax.examples import example_path
from scan2flex_jax.study import Clamp, Study, load_study, study_warnings
from scan2flex_jax.study.rotations import product
from scan2flex_jax.study.scans import scan_facts

from .samples import STUDY, curve, write_sample


@pytest.fixture(scope="module")
def study() -> Study:
    return load_study(example_path("simulated-cable"))


def changed(study, change, count):
    """The study with ``change`` of its first poses."""
    return replace(study, poses=(*(change(pose) for pose in study.poses[:count]), *study.poses[count:]))


def cut(pose):
    return replace(pose, curve=replace(pose.curve, points=pose.curve.points[3:]))


def turned(degrees, axis=(1.0, 0.3, 0.0)):
    """A change of a pose: its start clamp turned about an axis of its own frame."""
    half, along = np.radians(degrees) / 2, np.asarray(axis) / np.linalg.norm(axis)
    turn = np.r_[np.cos(half), np.sin(half) * along]
    return lambda pose: replace(pose, start=Clamp(pose.start.position, product(pose.start.quaternion, turn)))


def about(study, word):
    return [said for said in study_warnings(study) if word in said]


def test_a_fault_of_two_poses_is_said_of_each(study):
    said = about(changed(study, cut, 2), "scan up to")
    assert [text.partition(":")[0] for text in said] == [pose.name for pose in study.poses[:2]]


@pytest.mark.parametrize("count", [3, 4])
def test_a_fault_of_many_poses_is_said_once(study, count):
    [said] = about(changed(study, cut, count), "scan up to")
    names = ", ".join(pose.name for pose in study.poses[:3])
    assert said.startswith("all 4 curves stop" if count == 4 else f"3 of 4 curves ({names}) stop")
    least, most = map(float, re.search(r"stop (\S+) to (\S+) mm", said).groups())
    assert 0 < least <= most < 200


def test_a_wrong_length_is_said_once(study):
    [said] = about(replace(study, cable={**study.cable, "length": 1.05}), "than the cable's length")
    assert said.startswith("all 4 curves with their gaps are 4.") and "shorter" in said


def test_a_loose_clamp_has_a_tolerance_and_a_wrong_frame_has_none(study):
    """A frame that is off by a right angle is wrong: a tolerance of that size would hide it."""
    for count in (1, 3):
        [loose] = about(changed(study, turned(12.0), count), "write clamp_rotation = 0.2")
        assert "correct" in loose
        wrong = about(changed(study, turned(60.0), count), "correct ")
        assert wrong and not any("clamp_rotation" in text for text in wrong)
    [said] = about(changed(study, turned(60.0), 3), "off the axis d3")
    assert "convention of their angles" in said and "--tangent" in said


def test_another_axis_is_the_reason_for_every_tangent(study):
    half = np.sqrt(0.5)
    turn = np.array([half, 0.0, -half, 0.0])
    poses = tuple(
        replace(p, **{n: Clamp(getattr(p, n).position, product(getattr(p, n).quaternion, turn)) for n in ("start", "end")})
        for p in study.poses
    )
    said = study_warnings(replace(study, poses=poses))
    assert "along d1" in said[0]
    assert not any("off the axis d3" in text for text in said)


def test_every_warning_of_a_pose_says_what_to_do(study):
    pose = study.pose("plane")
    short = replace(turned(12.0, (1.0, 0.0, 0.0))(pose), curve=replace(pose.curve, points=pose.curve.points[5:]))
    said = " ".join(study_warnings(replace(study, poses=(short, *study.poses[1:]), cable={**study.cable, "length": 1.05})))
    assert "scan up to the start clamp" in said
    written = float(re.search(r"write clamp_rotation = (\S+) under \[tolerance\]", said)[1])
    angle = float(re.search(r"meets the \w+ clamp (\S+) deg off the axis d3", said)[1])
    assert written == pytest.approx(np.radians(angle), rel=0.05)
    assert re.search(r"shorter than the cable's length: measure the length again \(the curves give 0.9\d+ to 0.9\d+ m\)", said)


def doubts(folder, old, new):
    """The warnings of the sample with one piece of its text exchanged."""
    assert old in STUDY
    write_sample(folder, STUDY.replace(old, new))
    return " ".join(study_warnings(load_study(folder)))


def test_a_cable_heavier_than_cables_is_doubted(tmp_path):
    """0.336 kg/m written in g/m; and 2 kg/m, which a radius of 4 mm could hold only of 40,000 kg/m^3."""
    assert "weighs" not in doubts(tmp_path, "length_density = 0.336", "length_density = 0.9")
    assert "weighs 336 kg/m: check the unit" in doubts(tmp_path, "length_density = 0.336", "length_density = 336.0")
    assert "weighs 2 kg/m" in doubts(tmp_path, "length_density = 0.336", "length_density = 2.0")


def test_a_cable_that_stands_against_gravity_is_doubted(tmp_path):
    assert "point the right way" not in doubts(tmp_path, "-9.81]", "-9.81]")
    assert "point the right way" in doubts(tmp_path, "-9.81]", "9.81]")


def test_a_radius_in_millimetres_is_refused(tmp_path):
    with pytest.raises(StudyError, match=r"cable.radius: the radius is 4 m on a cable of at most 0.906 m: write both"):
        doubts(tmp_path, "radius = 0.004", "radius = 4.0")


def test_a_scan_tells_its_points_and_its_size(tmp_path):
    points = curve(50)
    np.savetxt(tmp_path / "sag.xyz", points)
    count, size = scan_facts(tmp_path / "sag.xyz")
    assert count == 50
    np.testing.assert_allclose(size, np.ptp(points, axis=0))
    (tmp_path / "sag.ply").write_text("hello")
    with pytest.raises(Scan2FlexError, match=r"cannot be read as a point cloud .*: export it again"):
        scan_facts(tmp_path / "sag.ply")
    with pytest.raises(Scan2FlexError, match="is not there"):
        scan_facts(tmp_path / "nowhere.ply")
