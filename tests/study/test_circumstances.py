"""What a study says of single poses: effects that act in some of them, gravity, time, and a cable that was straightened."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.errors import StudyError
from scan2flex_jax.study import EffectDeclaration, Unknown, check_study, describe, load_study, save_study, study_warnings

from .samples import STUDY, write_sample

TURNED = STUDY.replace("noise = 0.001", "noise = 0.001\ngravity = [0, -9.81, 0]\ntime = 12.5\nreset = true")
HUNG = TURNED.replace("position = 0.42", 'position = 0.42\nposes = ["again"]')
RATIOS = "the density and both stiffnesses are unknown: shapes tell only their ratios."


def test_the_keys_are_read_and_written_back(tmp_path):
    study = load_study(write_sample(tmp_path / "a", HUNG))
    sag, again = study.poses
    np.testing.assert_array_equal(sag.gravity, [0, -9.81, 0])
    assert (sag.time, sag.reset, again.gravity, again.time, again.reset) == (12.5, True, None, None, False)
    assert [effect.poses for effect in study.effects] == [("again",), None]
    save_study(study, tmp_path / "b")
    assert load_study(tmp_path / "b") == study
    assert load_study(write_sample(tmp_path / "c")) != study


def test_a_study_tells_what_holds_in_a_pose(tmp_path):
    study = load_study(write_sample(tmp_path, HUNG))
    kinds = {pose.name: [effect.kind for effect in study.acting(pose)] for pose in study.poses}
    assert kinds == {"sag": ["elastic_clamp"], "again": ["point_mass", "elastic_clamp"]}
    assert [effect.kind for effect in study.acting()] == ["elastic_clamp"]
    np.testing.assert_array_equal(study.gravity_in(study.poses[0]), [0, -9.81, 0])
    np.testing.assert_array_equal(study.gravity_in(study.poses[1]), study.gravity)


def test_they_stand_in_the_description(tmp_path):
    said = describe(load_study(write_sample(tmp_path, HUNG)))
    for words in ("mass to be estimated; in again only", "[0, -9.81, 0] m/s^2 in this pose", "at 12.5 s", "straightened"):
        assert words in said


def test_odd_gravity_of_a_pose_is_a_warning(tmp_path):
    study = load_study(write_sample(tmp_path, TURNED.replace("[0, -9.81, 0]", "[0, -981.0, 0]")))
    assert "sag: gravity is 981 m/s^2, not 9.81: check its unit." in study_warnings(study)


def test_a_known_weight_tells_more_than_ratios(tmp_path):
    study = load_study(write_sample(tmp_path))
    cable = {k: v for k, v in study.cable.items() if k not in ("length_density", "torsional_stiffness")}
    unknowns = tuple(Unknown(n) for n in ("length_density", "bending_stiffness", "torsional_stiffness"))
    bare = replace(study, cable=cable, unknowns=unknowns, effects=())
    assert RATIOS in study_warnings(bare)
    hung = replace(bare, effects=(EffectDeclaration("point_mass", {"position": 0.4, "mass": 0.05}, ("sag",)),))
    assert RATIOS not in study_warnings(hung)
    unseen = replace(hung, effects=(replace(hung.effects[0], poses=("again",)),))  # a validate pose tells a fit nothing
    assert RATIOS in study_warnings(unseen)
    unknown = replace(hung, unknowns=(*unknowns, Unknown("point_mass.mass")))
    assert RATIOS in study_warnings(unknown)


def test_gravity_of_a_pose_sets_the_scale(tmp_path):
    study = load_study(write_sample(tmp_path))
    cable = {k: v for k, v in study.cable.items() if k != "torsional_stiffness"}
    names = ("bending_stiffness", "torsional_stiffness")
    adrift = replace(study, gravity=np.zeros(3), cable=cable, unknowns=tuple(map(Unknown, names)), effects=())
    with pytest.raises(StudyError, match="shapes tell only ratios"):
        check_study(adrift)
    sag, again = adrift.poses
    check_study(replace(adrift, poses=(replace(sag, gravity=[0, 0, -9.81]), again)))
