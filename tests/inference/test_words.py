"""Numbers in words: intervals of 95 %, the digits that an interval resolves, and no digits that mean nothing."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.examples import example_path
from scan2flex_jax.inference.answer import percent, two_digits
from scan2flex_jax.inference.explanation import parameter_in_words
from scan2flex_jax.study import MeasuredCurve, describe, load_study

STUDY = load_study(example_path("simulated-cable"))


@pytest.mark.parametrize(
    ("kind", "name", "value", "std", "said"),
    [
        ("point_mass", "position", 0.4512, 0.001, "0.4512 [0.4492, 0.4532] m"),  # 1.96 standard errors to both sides
        ("point_mass", "mass", 0.05, 0.1, "0.05 [0, 0.246] kg"),  # no mass is negative
        ("stiffness_profile", "factor", 2.0, 0.2, "+100 % [+64 %, +140 %]"),  # 2 exp(-0.196), 2 exp(0.196)
        ("stiffness_profile", "factor", 2.0, 200.0, "+100 %"),
        ("kink", "angle", np.array([0.2, 0.0, 0.0]), np.full(3, 0.1),
         "(0.2, 0, 0) [(0.004, -0.196, -0.196), (0.396, 0.196, 0.196)] rad"),
        ("length_error", "length", 1.001, 0.0001, "+1.0 mm from the stated 1 m [+0.80, +1.2]"),
    ],
)  # fmt: skip
def test_a_parameter_is_printed_with_its_interval(kind, name, value, std, said):
    assert parameter_in_words(STUDY, kind, name, value, std) == said


def test_shares_below_what_means_anything_are_not_spelt_out():
    assert [percent(x) for x in (9.8e-10, -9.8e-10, 0.123, -0.5)] == ["<0.001 %", "<0.001 %", "+12 %", "-50 %"]
    assert [two_digits(x) for x in (50.88, 9.8e-8, 0.0)] == ["51", "<0.001", "0"]


def test_a_direction_that_points_do_not_show_has_no_angle():
    pose = STUDY.poses[0]
    points = pose.curve.points[:: len(pose.curve.points) // 8]
    noisy = points + 1e-3 * np.random.default_rng(0).normal(size=points.shape)

    def said(points):
        return describe(replace(STUDY, poses=(replace(pose, curve=MeasuredCurve(points)),)))

    assert "its points do not show its direction there" in said(noisy)
    assert "+-" not in said(noisy) and "deg [" in said(pose.curve.points)
