"""What a study says of a cable that remembers: where the effect acts, the times that it needs, and what still repeats."""

from dataclasses import replace

import pytest

from scan2flex_jax.errors import StudyError
from scan2flex_jax.study import EffectDeclaration, check_study, load_study, save_study
from scan2flex_jax.study.repeats import repeats

from .samples import write_sample

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
