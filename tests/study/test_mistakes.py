"""Mistakes of the input that `check` names without a solve, and the changes of a study that mend them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from benchmarks.mistakes import KINDS
from scan2flex_jax.errors import StudyError
from scan2flex_jax.examples import example_names, example_path
from scan2flex_jax.study import EffectDeclaration, Markers, check_study, load_study, mistakes, study_warnings
from scan2flex_jax.study.rotations import columns, product, rolled, twist_along
from scan2flex_jax.study.visible import scale_between, visible_mistakes

VISIBLE = {
    "tangent is x": "multiply the quaternions from the right by [0.7071068, 0, 0.7071068, 0]",
    "tangent is y": "multiply the quaternions from the right by [0.7071068, -0.7071068, 0, 0]",
    "tangent is -z": "multiply the quaternions from the right by [0, 1, 0, 0]",
    "tangent inward at the end": "multiply the end quaternions from the right by",
    "one curve reversed": "reverse the order of its points",
    "all curves reversed": "reverse the order of the points",
    "clamps exchanged in one pose": "exchange its clamps",
    "clamps exchanged in all poses": "exchange the clamps of each pose",
    "length in cm": "write length = 1",
    "length in inches": "write length = 1",
    "clamps 2 % too large": "multiply them by 0.98",
    "curves 2 % too large": "divide them by 1.02",
}
REFUSED = {
    "curves in mm": "millimetres: divide by 1000",
    "curves in cm": "centimetres: divide by 100",
    "curves in inches": "inches: divide by 39.3701",
    "clamps in mm": "millimetres: divide by 1000",
    "clamps in inches": "inches: divide by 39.3701",
    "length in mm": "millimetres: divide it by 1000",
}


@pytest.fixture(scope="module")
def study():
    return load_study(example_path("simulated-cable"))


def made(study, kind):
    """The study with one mistake of the benchmark."""
    return KINDS[kind][0](study)


def axes(study):
    return [columns(c.quaternion)[:, 2] for pose in study.poses for c in (pose.start, pose.end)]


@pytest.mark.parametrize("name", example_names())
def test_nothing_is_said_of_the_examples(name):
    example = load_study(example_path(name))
    assert visible_mistakes(example) == () and scale_between(example) is None
    assert not [said for said in study_warnings(example) if "weighs" in said or "right way" in said]


@pytest.mark.parametrize("kind", VISIBLE)
def test_check_says_the_mistake_first_with_its_mend(study, kind):
    said = study_warnings(made(study, kind))
    assert VISIBLE[kind] in said[0]


def test_exchanged_curves_that_end_at_other_clamps_are_named(study):
    said = study_warnings(made(study, "last two fitted poses exchanged"))
    a, b = [pose.name for pose in study.fit_poses[-2:]]
    assert said[0] == f"the curves of poses {a} and {b} are exchanged: exchange their centre_curve."


@pytest.mark.parametrize("kind", REFUSED)
def test_another_unit_is_refused_by_name(study, kind):
    with pytest.raises(StudyError) as fault:
        check_study(made(study, kind))
    assert REFUSED[kind] in str(fault.value)


@pytest.mark.parametrize("kind", ["tangent is x", "tangent is -z", "all curves reversed", "clamps exchanged in one pose"])
def test_the_mended_study_is_the_one_before_the_mistake(study, kind):
    """Up to the roll that both clamps share, which shapes do not tell."""
    (found,) = visible_mistakes(made(study, kind))
    np.testing.assert_allclose(axes(found.study), axes(study), atol=1e-9)
    for mended, right in zip(found.study.poses, study.poses, strict=True):
        np.testing.assert_allclose(mended.curve.points, right.curve.points)


def test_several_poses_are_named_one_after_the_other(study):
    turned = replace(study, poses=tuple(map(mistakes.reversed_curve, study.poses[:2])) + study.poses[2:])
    found = visible_mistakes(turned)
    assert [m.sentence.split()[4] for m in found] == sorted(p.name for p in study.poses[:2])
    assert visible_mistakes(found[-1].study) == ()


def test_a_free_cable_that_rises_from_its_clamp_is_doubted():
    strip = load_study(example_path("textile-strip"))
    assert "write gravity = [0, 0, -9.81]" in study_warnings(made(strip, "gravity upward"))[0]


def test_a_weight_in_another_unit_says_what_it_would_be(study):
    known = study.known("length_density")
    assert f"{known:.4g} kg/m if it was written in g/m" in " ".join(study_warnings(made(study, "density in g/m")))
    light = replace(study, cable={**study.cable, "radius": 0.005, "length_density": known / 1000})
    assert f"{known:.4g} kg/m if in t/m" in " ".join(study_warnings(light))


def test_a_weight_is_asked_only_where_something_sets_the_scale(study):
    assert list(mistakes.of_weight(study)) == []
    held = replace(study, effects=(EffectDeclaration("point_mass", {"position": 0.4, "mass": 0.05}),))
    found = [m.study.cable["length_density"] for m in mistakes.of_weight(made(held, "density in lb/m"))]
    assert min(abs(np.array(found) / study.known("length_density") - 1.0)) < 1e-4


def test_a_marker_beside_the_axis_is_left_out_with_its_place(study):
    points, s = study.poses[0].curve.points[[10, 20, 30]], np.array([0.1, 0.2, 0.3])
    marks = Markers(points, s, offset=[[0.01, 0.0], [0.02, 0.0], [0.03, 0.0]])
    marked = replace(study, poses=(replace(study.poses[0], curve=None, markers=marks), *study.poses[1:]))
    rest = mistakes.without_marker(marked, marked.poses[0], 1).study.poses[0].markers
    np.testing.assert_array_equal(rest.offset, marks.offset[[0, 2]])
    np.testing.assert_array_equal(rest.points, points[[0, 2]])


def test_products_and_rolls_are_those_of_rotations():
    rng = np.random.default_rng(3)
    p, q = (v / np.linalg.norm(v) for v in rng.standard_normal((2, 4)))
    a, b = (Rotation.from_quat(v, scalar_first=True) for v in (p, q))
    np.testing.assert_allclose(columns(product(p, q)), (a * b).as_matrix(), atol=1e-14)
    np.testing.assert_allclose(columns(rolled(p, 0.4)), (a * Rotation.from_rotvec([0, 0, 0.4])).as_matrix(), atol=1e-14)


@pytest.mark.parametrize("twist", [-2.0, 0.3, 3.0])
def test_twist_is_the_angle_beyond_transport(twist):
    """Along a plane arc the frame that does not turn about it keeps its normal to the plane."""
    angle = np.linspace(0.0, 2.0, 200)
    arc = np.stack([np.sin(angle), 0 * angle, np.cos(angle) - 1.0], axis=1)
    start, end = (Rotation.from_euler("y", 90 + np.degrees(a), degrees=True).as_quat(scalar_first=True) for a in (0.0, 2.0))
    for points in (arc, np.zeros((0, 3))):
        assert twist_along(points, start, rolled(end, twist)) == pytest.approx(twist, abs=1e-9)


@pytest.mark.parametrize(
    ("change", "kind"),
    [
        (mistakes.of_rolls, "end rolled by 90 degrees in all poses"),
        (mistakes.of_rolls, "sign of the rolls from pose to pose"),
        (mistakes.of_gravity, "gravity along another axis"),
    ],
)
def test_a_hypothesis_undoes_the_mistake(study, change, kind):
    """One of the hypotheses gives back gravity and all clamps as they were."""

    def off(other):
        pairs = zip(other.poses, study.poses, strict=True)
        return (
            max(np.abs(columns(a.end.quaternion) - columns(b.end.quaternion)).max() for a, b in pairs)
            + np.abs(other.gravity - study.gravity).max()
        )

    wrong = made(study, kind)
    assert off(wrong) > 0.5
    assert min(off(m.study) for m in change(wrong)) < 1e-6


def test_a_mistake_in_words_and_as_json(study):
    told = mistakes.Mistake("a is b", "write b", study, 0.012, 0.0003)
    assert str(told) == "a is b: write b (fits 40 times better, 0.3 mm in place of 12 mm)"
    assert told.to_json() == {"sentence": "a is b", "mend": "write b", "rms_before": 0.012, "rms_after": 0.0003}
    assert str(mistakes.Mistake("a is b", "write b", study)) == "a is b: write b"
