"""What `check` doubts of a curve of few points: never what its points are too far apart to show, always a clamp that is off."""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation

from scan2flex_jax.study import Study, pose_facts, study_warnings

FEW = (4, 5, 6, 8, 12, 20, 30, 40)
SPACINGS = (1.0, 2.0)  # points at the powers of even steps: as far apart at the end as twice the mean


def arc(degrees):
    """A circular arc of length 1 m: positions and tangents at s."""
    turn = np.radians(degrees)

    def at(s):
        t = turn * s
        return np.stack([np.sin(t), 0 * t, 1 - np.cos(t)], axis=1) / turn, np.stack([np.cos(t), 0 * t, np.sin(t)], axis=1)

    return at


def helix(curvature, torsion):
    """A helix, in 1/m."""
    rate = np.hypot(curvature, torsion)

    def at(s):
        t, c, p = rate * s, curvature / rate, torsion / rate
        points = np.stack([c / rate * np.cos(t), c / rate * np.sin(t), p * s], axis=1)
        return points, np.stack([-c * np.sin(t), c * np.cos(t), p + 0 * s], axis=1)

    return at


@cache
def hung(stiffness, weight=2.0, span=0.6):
    """A cable of 1 m, ``stiffness`` (N m^2) and ``weight`` (N/m), held level at both ends ``span`` (m) apart."""

    def slopes(s, y):
        angle, _, _, _, push, lift = y
        moment = push * np.sin(angle) - (lift + weight * s) * np.cos(angle)
        return np.stack([y[1], moment / stiffness, np.cos(angle), np.sin(angle), 0 * s, 0 * s])

    def ends(a, b):
        return np.array([a[0], a[2], a[3], b[0], b[2] - span, b[3]])

    s, one = np.linspace(0.0, 1.0, 400), np.ones(400)
    start = [-1.4 * np.sin(2 * np.pi * s), -2.8 * np.pi * np.cos(2 * np.pi * s), span * s, -0.3 * np.sin(np.pi * s)]
    found = solve_bvp(slopes, ends, s, np.stack([*start, 0.1 * weight * one, -0.5 * weight * one]), tol=1e-8, max_nodes=50_000)
    assert found.success
    return found.sol


def elastica(stiffness):
    """The cable of `hung`: positions and tangents at s."""

    def at(s):
        angle, _, x, z, _, _ = hung(stiffness)(s)
        return np.stack([x, 0 * s, z], axis=1), np.stack([np.cos(angle), 0 * s, np.sin(angle)], axis=1)

    return at


SHAPES = {
    "arc of 20": arc(20), "arc of 90": arc(90), "arc of 180": arc(180), "arc of 270": arc(270), "helix": helix(4.0, 2.0),
    "elastica": elastica(0.1), "heavy elastica": elastica(0.03),
}  # fmt: skip


def frame(tangent):
    """A rotation whose d3 is the tangent."""
    d1 = np.cross([0.0, 1.0, 0.0], tangent)
    d1 = d1 / np.linalg.norm(d1)
    return np.stack([d1, np.cross(tangent, d1), tangent], axis=1)


def study(shape, s, off=0.0):
    """The points of a shape at ``s``, held by clamps along it, or ``off`` (degrees) from it."""
    points, tangents = shape(s)
    turn = Rotation.from_rotvec([np.radians(off), 0.0, 0.0]).as_matrix()
    ends = {end: (points[i], frame(tangents[i]) @ turn) for end, i in (("start", 0), ("end", -1))}
    cable = {"length": 1.0, "length_density": 0.2}
    return Study.from_arrays(cable, [{"points": points, **ends}], ["bending_stiffness", "torsional_stiffness"])


def doubts(study):
    """What is said of the clamps and of the length."""
    return [said for said in study_warnings(study) if "off the axis d3" in said or "than the cable" in said]


@pytest.mark.parametrize("name", SHAPES)
def test_a_curve_of_few_exact_points_is_not_doubted(name):
    found = {
        (n, power): said
        for n in FEW
        for power in SPACINGS
        if (said := doubts(study(SHAPES[name], np.linspace(0.0, 1.0, n) ** power)))
    }
    assert not found


@pytest.mark.parametrize("n", [40, 74, 75, 200])
@pytest.mark.parametrize("name", SHAPES)
def test_a_clamp_that_is_off_is_doubted(name, n):
    made = study(SHAPES[name], np.linspace(0.0, 1.0, n), off=15.0)
    shown = (name, n) != ("heavy elastica", 40)  # it bends within the six points of a tangent
    assert len([said for said in doubts(made) if "off the axis d3" in said]) == (2 if shown else 0)
    for end in (pose_facts(made.poses[0]).start, pose_facts(made.poses[0]).end):
        assert end.angle == pytest.approx(15.0, abs=2 * end.angle_sd + 0.5)


def test_a_curve_too_short_for_its_cable_is_doubted_still():
    made = study(lambda s: [0.9 * arc(90)(s)[0], arc(90)(s)[1]], np.linspace(0.0, 1.0, 12))
    assert any("10.1 % shorter" in said for said in doubts(made))
