"""Inputs as people bring them, told before any solve: mirrored and y-up curves, exchanged markers, s in per cent; and what is
right and must not be accused."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax import EffectDeclaration, Markers, MeasuredCurve, Study, StudyError, Tolerance, load_study
from scan2flex_jax.convert import read_foreign_curve
from scan2flex_jax.examples import example_path
from scan2flex_jax.study.check import study_warnings
from scan2flex_jax.study.repeats import repeat_sentences, repeats
from scan2flex_jax.study.sense import check_study
from scan2flex_jax.study.visible import visible_mistakes

LEVEL = [0.5**0.5, 0.0, 0.5**0.5, 0.0]  # d3 along x


@pytest.fixture(scope="module")
def example():
    return load_study(example_path("simulated-cable"))


def moved(study, change):
    """The study with its curves changed."""
    poses = (replace(p, curve=MeasuredCurve(change(p.curve.points))) for p in study.poses)
    return replace(study, poses=tuple(poses))


@pytest.mark.parametrize(("change", "said", "mend"), [
    (lambda x: x * [1, -1, 1], "mirrored: their y axis points the other way", "write x, -y, z"),
    (lambda x: x * [-1, 1, 1], "mirrored: their x axis points the other way", "write -x, y, z"),
    (lambda x: x[:, [0, 2, 1]], "mirrored: their y and z axes are exchanged", "write x, z, y"),
    (lambda x: x[:, [0, 2, 1]] * [1, 1, -1], "have their y axis up, and the clamps their z axis", "write x, -z, y"),
])  # fmt: skip
def test_curves_in_other_axes_are_named_with_their_mend(example, change, said, mend):
    assert visible_mistakes(example) == ()
    (mistake,) = visible_mistakes(moved(example, change))
    assert said in mistake.sentence and mistake.mend.startswith(mend)
    for own, right in zip(mistake.study.poses, example.poses, strict=True):
        np.testing.assert_array_equal(own.curve.points, right.curve.points)
    assert study_warnings(moved(example, change)) == [f"{mistake}."]  # and nothing that only follows from it


def marked(example, order=None, count=8):
    """The example with markers in place of curves; those of its second pose in another ``order``."""
    poses = []
    for k, pose in enumerate(example.poses):
        at = np.round(np.linspace(0.06, 0.94, count) * (len(pose.curve.points) - 1)).astype(int)
        points, s = pose.curve.points[at], at / (len(pose.curve.points) - 1)
        points = points[order] if order is not None and k == 1 else points
        poses.append(replace(pose, curve=None, markers=Markers(points, s)))
    return replace(example, poses=tuple(poses))


@pytest.mark.parametrize("pair", [(3, 4), (0, 1), (2, 6)])
def test_exchanged_markers_are_named(example, pair):
    order = np.arange(8)
    order[list(pair)] = order[list(pair)][::-1]
    study = marked(example, order)
    (mistake,) = visible_mistakes(study)
    i, j = (k + 1 for k in pair)
    assert f"markers {i} and {j} of pose {study.poses[1].name} are exchanged" in mistake.sentence
    assert mistake.study == marked(example) and visible_mistakes(marked(example)) == ()


def test_markers_that_no_exchange_brings_together_are_a_warning(example):
    study = marked(example)
    pose = study.poses[1]
    points = pose.markers.points.copy()
    points[4] += [0.0, 0.3, 0.0]
    far = replace(study, poses=(study.poses[0], replace(pose, markers=Markers(points, pose.markers.arc_length))))
    said = [w for w in study_warnings(far) if "markers 4 and 5 are" in w]
    assert len(said) == 1 and "along the cable" in said[0]


def curve(bend, length=0.3, noise=0.0):
    """A cantilever's curve whose end sags by ``bend`` of its length."""
    x = np.linspace(0.02, 1.0, 30) * length
    z = -bend * length * (x / length) ** 2
    return np.column_stack([x, np.zeros(30), z + noise * np.random.default_rng(0).standard_normal(30)])


def clamped(*curves, effects=(), **cable):
    poses = [{"name": f"b{i}", "points": c, "start": ([0, 0, 0], LEVEL)} for i, c in enumerate(curves)]
    given = {"length": 0.3, "length_density": 0.06, "torsional_stiffness": 0.05} | cable
    return Study.from_arrays(given, poses, ["bending_stiffness"], effects=effects)


def straight(study):
    return [w for w in study_warnings(study) if "nearly straight" in w]


def test_one_bent_pose_is_enough():
    """A ruler with a battery at four places: EI to 0.1 %, and three of its four curves hardly bend."""
    assert straight(clamped(curve(0.002), curve(0.005), curve(0.008)))
    assert not straight(clamped(curve(0.002), curve(0.005), curve(0.08)))
    quiet = clamped(curve(0.005), curve(0.008))
    assert straight(quiet)
    assert not straight(replace(quiet, poses=tuple(replace(p, noise=5e-6) for p in quiet.poses)))


def test_poses_that_are_held_alike_and_differ_are_no_repeats():
    loads = clamped(curve(0.02), curve(0.03), curve(0.12))
    assert repeats(loads) == ()
    (said,) = repeat_sentences(loads)
    assert "b0, b1, b2 are held alike" in said and "does not declare" in said
    assert repeats(clamped(curve(0.02), curve(0.03))) == (("b0", "b1"),)


def test_a_rope_on_a_table_is_no_wrong_gravity():
    s = np.linspace(0.0, 1.0, 40)
    flat = np.column_stack([0.3 * s, 0.08 * np.sin(np.pi * s), np.full(40, 1e-4)])
    said = [w for w in study_warnings(clamped(flat, flat * [1, -1, 1])) if "lies level" in w]
    assert len(said) == 1 and "support_plane" in said[0]
    assert not [w for w in study_warnings(clamped(curve(0.1))) if "lies level" in w]


def test_a_power_line_is_in_metres_and_a_weightless_wire_weighs_what_it_likes():
    x = np.linspace(0.0, 200.0, 60)
    span = {"points": np.column_stack([x, np.zeros(60), -6.0 * x * (200.0 - x) / 1e4]), "start": ([0, 0, 0], None)}
    line = Study.from_arrays(
        {"length": 200.5, "length_density": 1.63, "torsional_stiffness": 50.0},
        [span | {"end": ([200, 0, 0], None)}], ["bending_stiffness"],
    )  # fmt: skip
    assert not [w for w in study_warnings(line) if "metres" in w]
    gripped = line.poses[0]
    gripped = replace(line, poses=(replace(gripped, start=replace(gripped.start, quaternion=LEVEL)),))
    assert [w for w in study_warnings(gripped) if "metres" in w]
    load = EffectDeclaration("point_load", {"position": 0.3, "force": [0, 0, -1]})
    wire = clamped(curve(0.1), length_density=1e-9, effects=[load])
    assert [w for w in study_warnings(wire) if "check the unit" in w]
    assert not [w for w in study_warnings(replace(wire, gravity=np.zeros(3))) if "check the unit" in w]


@pytest.mark.parametrize("unit", [1.0, 1e-3])
def test_arc_lengths_in_per_cent_are_refused(example, unit):
    """Per cent written as they are, and per cent taken for millimetres."""
    pose = example.poses[0]
    s = np.linspace(0.0, 100.0, len(pose.curve.points)) * unit
    study = replace(example, poses=(replace(pose, curve=MeasuredCurve(pose.curve.points, s)), *example.poses[1:]))
    with pytest.raises(StudyError, match="looks like per cent of the length"):
        check_study(study)


def test_a_column_in_per_cent_is_left_out_of_a_file_and_said(tmp_path):
    x = curve(0.1) * 1e3
    table = np.column_stack([np.linspace(0.0, 100.0, 30), x])
    (tmp_path / "c.csv").write_text("s,x,y,z\n" + "\n".join(",".join(f"{v:.3f}" for v in row) for row in table))
    found = read_foreign_curve(tmp_path / "c.csv", units="mm")
    assert found.curve.arc_length is None and any("looks like per cent" in note for note in found.notes)
    np.testing.assert_allclose(found.curve.points, x / 1e3, atol=1e-6)


def test_a_tolerance_is_no_accusation(example):
    """The example and its markers, with and without tolerances, give no warning."""
    loose = replace(example, tolerance=Tolerance(length=0.002, clamp_position=0.0005))
    assert study_warnings(example) == study_warnings(loose) == study_warnings(marked(example)) == []
