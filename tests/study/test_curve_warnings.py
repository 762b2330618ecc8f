"""Warnings about measured curves: named with the pose where one has the fault, once where all have it."""

import re
from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.examples import example_path
from scan2flex_jax.study import Clamp, Study, load_study, study_warnings
from scan2flex_jax.study.rotations import product


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
