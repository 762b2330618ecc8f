"""What a study says of single poses: effects that act in some of them, gravity, time, and what the cable remembers."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.errors import StudyError
from scan2flex_jax.study import EffectDeclaration, Unknown, check_study, describe, load_study, save_study, study_warnings
from scan2flex_jax.study.repeats import repeats

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


FRICTION = EffectDeclaration("friction", {"share": 0.4, "slip_curvature": 1.0})
RELAXATION = EffectDeclaration("relaxation", {"share": 0.2, "time_constant": 60.0})


@pytest.fixture
def study(tmp_path):
    whole = load_study(write_sample(tmp_path / "a"))
    return replace(whole, effects=(), unknowns=tuple(u for u in whole.unknowns if "." not in u.name))


def timed(study, *times, effects=(RELAXATION,)):
    poses = tuple(replace(p, time=t) for p, t in zip(study.poses, times, strict=True))
    return replace(study, poses=poses, effects=effects)


def test_memory_is_read_and_written_back(study, tmp_path):
    whole = timed(study, 0.0, 12.0, effects=(FRICTION, RELAXATION))
    check_study(whole)
    save_study(whole, tmp_path / "b")
    assert load_study(tmp_path / "b") == whole
    assert whole.history_dependent
    assert not study.history_dependent


@pytest.mark.parametrize(
    ("effect", "sentence"),
    [
        (replace(FRICTION, poses=("sag",)), "friction acts from pose to pose: leave the key out"),
        (EffectDeclaration("friction", {"share": 1.2, "slip_curvature": 1.0}), "got 1.2: give a fraction, from 0 to 1"),
        (EffectDeclaration("friction", {"share": 0.5}), "friction needs its slip_curvature"),
        (RELAXATION, "relaxation needs the time of every pose, and pose 'sag' has none"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_in_one_sentence(study, effect, sentence):
    with pytest.raises(StudyError, match=sentence):
        check_study(replace(study, effects=(effect,)))


def test_poses_stand_in_the_order_of_their_times(study):
    check_study(timed(study, 0.0, 0.0))
    with pytest.raises(StudyError, match="has the time 1 s, before that of pose 'sag', 3 s: list the poses in the order"):
        check_study(timed(study, 3.0, 1.0))
    check_study(timed(study, 3.0, 1.0, effects=(FRICTION,)))  # friction asks for no times


def test_one_friction_is_enough(study):
    with pytest.raises(StudyError, match="two effects are of kind friction"):
        check_study(replace(study, effects=(FRICTION, FRICTION)))


def test_poses_with_a_past_do_not_repeat_one_another(study):
    """The same clamps hold two shapes; a cable that was straightened before both has none."""
    first = study.poses[0]
    twice = replace(study, poses=(first, replace(first, name="again", repeat_of="sag")), effects=())
    assert repeats(twice) == (("sag", "again"),)
    remembers = replace(twice, effects=(FRICTION,))
    assert repeats(remembers) == ()
    fresh = replace(remembers, poses=(first, replace(remembers.poses[1], reset=True)))
    assert repeats(fresh) == (("sag", "again"),)
