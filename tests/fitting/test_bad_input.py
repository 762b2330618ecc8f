"""What cannot be fitted is refused in one sentence."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.inference import fit
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
    "largest distance by least squares": (lambda s: s, {"distance": "hausdorff"}, "nelder-mead"),
    "no pose to fit": (all_validate, {}, 'no pose has the role "fit"'),
    "no curve": (without_curves, {}, "it has no shape: give it a centre curve, a scan, markers, or readings"),
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
