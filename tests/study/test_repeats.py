"""Poses that repeat one another: by what they say, or by the same clamps, gravity and turns."""

import numpy as np
import pytest

from scan2flex_jax.study import EffectDeclaration, Markers, Study
from scan2flex_jax.study.check import describe
from scan2flex_jax.study.repeats import difference, repeat_sentences, repeats

LEVEL, OVER = [1.0, 0.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0]  # one rotation, written in two ways
ASIDE = 2e-3  # m


def curve(aside=0.0):
    """A sagging curve, 20 points (m), and the same moved aside."""
    x = np.linspace(0.0, 0.5, 20)
    return np.stack([x, np.full(20, aside), -0.2 * x * (0.5 - x)], axis=1)


def held(name, quaternion=LEVEL, aside=0.0, **more):
    return {"name": name, "points": curve(aside), "start": ([0, 0, 0], quaternion), "end": ([0.5, 0, 0], LEVEL)} | more


def study(*poses, effects=()):
    return Study.from_arrays({"length": 0.52, "length_density": 0.1}, poses, ["bending_stiffness"], effects=effects)


def test_poses_that_are_held_alike_are_repeats_and_their_difference_is_said():
    both = study(held("a"), held("b", OVER, ASIDE), held("c", turns=1))
    assert repeats(both) == (("a", "b"),)
    assert difference(both.pose("a"), both.pose("b")) == pytest.approx(ASIDE, rel=1e-6)
    (said,) = repeat_sentences(both)
    assert "a and b" in said and "2.00 mm" in said and "0.38 %" in said
    lines = describe(both).splitlines()
    assert [line.split() for line in lines if "repeats" in line] == [["repeats", "b"], ["repeats", "a"]]


@pytest.mark.parametrize("other", [
    {"end": ([0.5, 1e-3, 0], LEVEL)}, {"end": None}, {"end": ([0.5, 0, 0], None)}, {"turns": -1},
    {"gravity": [0.0, 9.81, 0.0]}, {"reset": True},
])  # fmt: skip
def test_poses_that_are_held_otherwise_are_none(other):
    assert repeats(study(held("a"), held("b", **other))) == ()


def test_a_weight_in_one_of_them_makes_another_pose_of_it():
    weight = EffectDeclaration("point_mass", {"position": 0.2, "mass": 0.1}, ("b",))
    assert repeats(study(held("a"), held("b"), effects=(weight,))) == ()


def test_what_is_said_to_repeat_repeats_however_it_was_held():
    moved = held("b", repeat_of="a", end=([0.5, 2e-3, 0], LEVEL))
    assert repeats(study(held("a"), moved, held("c", turns=1))) == (("a", "b"),)


def test_markers_are_compared_where_both_have_them():
    def marked(name, s, z):
        points = np.stack([s, np.zeros(len(s)), np.full(len(s), z)], axis=1)
        return {"name": name, "start": ([0, 0, 0], LEVEL), "markers": Markers(points, s)}

    a, b, c = marked("a", [0.1, 0.3], 0.0), marked("b", [0.3, 0.4], 3e-3), marked("c", [0.45], 0.0)
    found = study(a, b, c)
    assert repeats(found) == (("a", "b", "c"),)
    assert difference(found.pose("a"), found.pose("b")) == pytest.approx(3e-3)
    assert difference(found.pose("a"), found.pose("c")) is None
    assert len(repeat_sentences(found)) == 1


def test_curves_are_compared_where_both_have_points():
    """One ends early, one has a gap at its deepest place: what both show is alike."""
    whole, short, holed = held("a"), held("b"), held("c", aside=ASIDE)
    short["points"] = curve()[:-6]
    holed["points"] = np.delete(curve(ASIDE), slice(5, 14), axis=0)
    found = study(whole, short, holed)
    for one, other in (("a", "b"), ("b", "a")):
        assert difference(found.pose(one), found.pose(other)) == pytest.approx(0.0, abs=1e-12)
    for one, other in (("a", "c"), ("c", "a"), ("b", "c")):
        assert difference(found.pose(one), found.pose(other)) == pytest.approx(ASIDE, rel=1e-6)
    assert len(repeat_sentences(study(whole, short, held("c")))) == 0
