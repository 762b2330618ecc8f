"""A study that is read says what its files say."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.errors import Scan2FlexError, StudyError
from scan2flex_jax.examples import example_names, example_path
from scan2flex_jax.study import (
    Clamp,
    KindFormat,
    ParameterFormat,
    describe,
    kind_names,
    kinds,
    load_study,
    pose_facts,
    register_kind,
    study_warnings,
)
from scan2flex_jax.study.curves import curve_length

from .samples import STUDY, csv, curve, write_sample


def test_every_key_of_the_format(tmp_path):
    study = load_study(write_sample(tmp_path))
    assert study == load_study(tmp_path / "study.toml")
    sag, again = study.poses
    assert study.fit_poses == (sag,) and study.validate_poses == (again,) and study.pose("again") == again
    np.testing.assert_array_equal(study.gravity, [0, 0, -9.81])
    assert study.cable["length"] == 0.9 and "bending_stiffness" not in study.cable
    np.testing.assert_array_equal(study.cable["shear_stiffness"], [1e5, 2e5])
    assert study.tolerance.length == 0.002 and study.tolerance.gravity == 0.0
    assert study.unknown_names == ("bending_stiffness", "point_mass.mass", "natural_curvature")
    assert study.start_value("bending_stiffness") == 0.1 and study.start_value("point_mass.mass") is None
    assert study.known("natural_curvature") is None and study.known("torsional_stiffness") == 0.03
    assert study.effects[0].parameters == {"position": 0.42}
    assert (sag.turns, sag.noise, again.turns, again.noise, again.repeat_of) == (-1, 0.001, 0, None, "sag")
    np.testing.assert_allclose(sag.start.tangent, [1, 0, 0], atol=1e-15)
    assert again.end.quaternion is None and again.end.tangent is None
    assert sag.curve.arc_length is None and len(again.curve.arc_length) == 40
    assert sag.scan == tmp_path.resolve() / "sag.xyz" and sag.guide_points.shape == (5, 3)
    assert study.clamped_ends == ("start", "end")


def test_arrays_are_read_only_and_copies_change(tmp_path):
    study = load_study(write_sample(tmp_path))
    with pytest.raises(ValueError, match="read-only"):
        study.gravity[0] = 1.0
    assert replace(study, title="other") != study
    moved = replace(study.poses[0], start=Clamp(np.array([0.0, 0.0, 1e-12])))
    assert replace(study, poses=(moved, study.poses[1])) != study


@pytest.mark.parametrize("name", ["natural_curvature.curvature", "natural_curvature"])
def test_a_name_of_both_tables_is_told_apart(tmp_path, name):
    effect = '[[effect]]\nkind = "natural_curvature"\ncurvature = [0.0, 0.0, 0.0]\n'
    text = STUDY.replace("[unknown.natural_curvature]", f"[unknown.{name}]") + effect
    assert load_study(write_sample(tmp_path, text)).unknown_names[-1] == name


def test_one_entry_will_do_where_one_end_has_a_clamp(tmp_path):
    text = STUDY.replace(
        "end = { position = [0.5, 0.0, 0.0], quaternion = [0.7071068, 0.0, 0.7071068, 0.0] }\nturns = -1\n", ""
    ).replace("stiffness = [1.0, 2.0]", "stiffness = [1.0]")
    study = load_study(write_sample(tmp_path, text))
    assert study.clamped_ends == ("start",) and study.effects[1].parameters["stiffness"].shape == (1,)


def test_line_ends_and_byte_order_marks_of_other_systems(tmp_path):
    plain = load_study(write_sample(tmp_path / "a"))
    strange = b"\xef\xbb\xbf" + STUDY.replace("\n", "\r\n").encode()
    sag = {"shapes/sag": b"\xef\xbb\xbf" + csv(curve()).replace("\n", "\r\n").encode()}
    assert load_study(write_sample(tmp_path / "b", strange, **sag)) == plain


def test_a_later_effect_adds_itself(tmp_path, monkeypatch):
    monkeypatch.setattr(kinds, "_KINDS", dict(kinds._KINDS))  # other tests know the package's own
    taper = KindFormat("taper_for_test", "energy", (ParameterFormat("slope", "1/m"),), "the cable gets thinner")
    assert register_kind(taper) == register_kind(taper) and "taper_for_test" in kind_names()
    with pytest.raises(Scan2FlexError, match="taken"):
        register_kind(replace(taper, place="clamps"))
    text = STUDY + '\n[[effect]]\nkind = "taper_for_test"\nslope = 0.1\n'
    assert load_study(write_sample(tmp_path, text)).effects[-1].parameters == {"slope": 0.1}


@pytest.mark.parametrize("n", [40, 500, 5000])
def test_noise_hardly_lengthens_a_curve(n):
    points = curve(n) + 1e-3 * np.random.default_rng(n).normal(size=(n, 3))
    assert curve_length(points) == pytest.approx(0.9, rel=0.01)


def test_the_angle_to_the_clamp_is_found_in_noise(tmp_path):
    study = load_study(write_sample(tmp_path))
    pose = study.poses[0]
    half = next(h for h in np.linspace(1e-3, np.pi, 20000) if np.sin(h) / h < 0.5 / 0.9)
    for n, noise in ((60, 0.0), (400, 1e-4), (4000, 1e-3)):
        points = curve(n) + noise * np.random.default_rng(n).normal(size=(n, 3))
        facts = pose_facts(replace(pose, curve=replace(pose.curve, points=points)))
        for end in (facts.start, facts.end):
            assert end.angle == pytest.approx(np.degrees(half), abs=max(1.0, 4 * end.angle_sd))


@pytest.mark.parametrize("name", example_names())
def test_examples_come_with_the_package(name):
    study = load_study(example_path(name))
    assert study.fit_poses
    text = describe(study)
    assert study.title in text and all(pose.name in text for pose in study.poses)
    for heading in ("Given", "Assumed", "To estimate", "Tolerances (standard deviations)", "Poses: "):
        assert f"\n{heading}" in text


def test_no_such_example():
    with pytest.raises(Scan2FlexError, match="black-wire"):
        example_path("grey-wire")


def test_plane_poses_and_a_single_pose_are_doubted(tmp_path):
    study = load_study(write_sample(tmp_path))
    found = "\n".join(study_warnings(study))
    assert "all poses are plane" in found and "no validate pose" not in found
    assert "no validate pose" in "\n".join(study_warnings(replace(study, poses=study.poses[:1])))


def test_one_sentence():
    assert str(StudyError("a.toml", "cable.length", "got -1.")) == "a.toml: cable.length: got -1."
    assert str(StudyError("a.toml", None, "it is not there.")) == "a.toml: it is not there."
