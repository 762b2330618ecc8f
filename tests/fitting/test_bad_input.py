"""What cannot be fitted is refused in one sentence."""

from dataclasses import replace

import equinox as eqx
import numpy as np
import pytest

from scan2flex_jax.errors import NotSettledError, Scan2FlexError
from scan2flex_jax.fitting.least_squares import Minimum
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.inference import fit
from scan2flex_jax.statics.verdict import SOLVED, UNBALANCED
from scan2flex_jax.study import Unknown

from . import scenes


def without_curves(study):
    return replace(study, poses=tuple(replace(p, curve=None) for p in study.poses))


def all_validate(study):
    return replace(study, poses=tuple(replace(p, role="validate") for p in study.poses))


REFUSED = {
    "no unknowns": (lambda s: replace(s, unknowns=()), {}, "nothing to fit"),
    "unknown method": (lambda s: s, {"method": "simplex"}, "method 'simplex' is not known: use one of least-squares"),
    "unknown distance": (lambda s: s, {"distance": "chamfer"}, "distance 'chamfer' is not known: use one of normal"),
    "no pose to fit": (all_validate, {}, 'no pose has the role "fit"'),
    "no curve": (without_curves, {}, "it has no shape: give it a centre curve, a scan, or markers"),
    "guess of zero": (
        lambda s: replace(s, unknowns=(Unknown("bending_stiffness", guess=0.0), s.unknowns[1])),
        {},
        "unknown.bending_stiffness.guess: got 0: give a value above zero",
    ),
}


@pytest.mark.parametrize("name", list(REFUSED))
def test_one_sentence(name):
    change, options, sentence = REFUSED[name]
    with pytest.raises(Scan2FlexError) as caught:
        fit(change(scenes.example()), **options)
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


def test_poses_that_do_not_settle_are_told_apart_by_the_type_of_the_error():
    """With the poses and their reasons as fields; a refusal of the study is another error."""
    problem = Problem(scenes.example(), 8)
    names = [pose.name for pose in problem.study.fit_poses]
    codes = np.where(np.arange(len(names)) == 1, UNBALANCED, SOLVED)
    evaluation = problem.evaluator(problem.starts()[0], derivative=False)
    evaluation = evaluation._replace(verdict=eqx.tree_at(lambda v: v.code, evaluation.verdict, codes))
    with pytest.raises(NotSettledError) as caught:
        problem._finite(Minimum(problem.starts()[0], np.zeros((len(names), 0)), evaluation, np.inf, 0, False))
    assert caught.value.reasons == {names[1]: "the forces do not balance"}
    assert str(caught.value) == (
        f"no values in the range let every pose settle ({names[1]}: the forces do not balance): "
        "check clamps, length and turns of these poses"
    )
    with pytest.raises(Scan2FlexError) as refused:
        fit(replace(scenes.example(), unknowns=()))
    assert not isinstance(refused.value, NotSettledError)


def test_clamps_too_far_apart_name_the_pose():
    """A stiff cable of 1 m between clamps 1.6 m apart, past the checks of the reader: no values let it settle there."""
    study = scenes.study_of(poses=("plane",))
    far = replace(study.poses[0].end, position=np.array([1.6, 0.0, 0.0]))
    study = replace(study, poses=(replace(study.poses[0], end=far),))
    try:
        f = fit(study, elements=scenes.ELEMENTS)
    except Scan2FlexError as error:
        assert "plane" in str(error) and "\n" not in str(error)
    else:
        assert f.valid is not True and f.rms() > 0.05  # settled by stretching: nothing like the measured shape
