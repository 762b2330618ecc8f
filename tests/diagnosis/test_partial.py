"""Poses that differ, each in its own way: what is found although it is not complete, and what is not found at all.

Shapes come from the continuous equations (`reference.cosserat_bvp`). In every pose the cable has a natural curvature of that
pose's own, as friction and handling leave it, and in some studies one that is the same in all poses beside it.
"""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.diagnosis import explain
from scan2flex_jax.fitting import fit
from scan2flex_jax.study import MeasuredCurve
from tests.diagnosis import scenes

EI, GJ = scenes.clamped_cases.POSE_K[0], scenes.clamped_cases.POSE_K[2]
OWN = {"level": (0.12, -0.05, 0.0), "twist+": (-0.08, 0.1, 0.0), "twist-": (0.03, 0.13, 0.0), "aside": (-0.1, -0.08, 0.0)}
COMMON = np.array([0.9, 0.5, 0.0])  # 1/m
LEFT = 0.004  # m, that the poses' own curvatures move the cable by, roughly


def study(common=0.0, own=1.0):
    """Four poses whose natural curvatures are ``common`` times that of all, and ``own`` times their own."""
    plain, rng, poses = scenes.study(), np.random.default_rng(3), []
    for pose in plain.poses:
        curvature = tuple(common * COMMON + own * np.array(OWN[pose.name]))
        points = scenes.shape(pose.name, natural_curvature=curvature)
        poses.append(replace(pose, curve=MeasuredCurve(points + scenes.NOISE * rng.standard_normal(points.shape))))
    return replace(plain, poses=tuple(poses))


@pytest.fixture(scope="module")
def scattered():
    return fit(study())


def test_poses_that_differ_have_a_discrepancy_and_intervals_that_carry_it(scattered):
    steady = fit(study(own=0.0))
    assert steady.discrepancy.rms == 0.0
    assert scenes.NOISE < scattered.discrepancy.rms < LEFT
    for name, truth in (("bending_stiffness", EI), ("torsional_stiffness", GJ)):
        with_scatter, without = scattered.estimates[name], steady.estimates[name]
        assert with_scatter.low < truth < with_scatter.high
        assert with_scatter.std > 3.0 * without.std
    assert any("its own way" in sentence for sentence in scattered.sentences)


def test_the_sensor_is_not_blamed_for_poses_that_differ(scattered):
    assert scattered.noise.total == pytest.approx(scenes.NOISE, rel=0.5)


def test_a_discrepancy_stands_in_the_result(scattered):
    written = scattered.to_json()["discrepancy"]
    assert written["rms"] == scattered.discrepancy.rms
    assert written["relative"] == pytest.approx(written["rms"] / 1.0)


@pytest.mark.slow
def test_poses_that_differ_only_name_nothing():
    found = explain(study(), mesh=False)
    assert found.chosen == () and found.verdict in ("unexplained", "no missing effect")
    assert scenes.NOISE < found.to_json()["discrepancy"]["rms"] < 2.0 * LEFT
    for name, truth in (("bending_stiffness", EI), ("torsional_stiffness", GJ)):
        e = found.estimates[name]
        assert e.low is None or e.low < truth < e.high
