"""Settings of a decision, errors of the input that act like effects, and poses that do not settle."""

from dataclasses import replace

import pytest

from scan2flex_jax.errors import NotSettledError, Scan2FlexError, SettingsError
from scan2flex_jax.inference import Settings, explain, fit
from scan2flex_jax.inference.decision import errors_of_input
from scan2flex_jax.study import Unknown
from tests.fitting import scenes as cables


def test_errors_of_the_input_with_the_shapes_of_an_effect_are_known():
    """The word "always" in a condition means nothing by itself."""
    assert [s.other for s in errors_of_input(("uniform_load",))] == ["gravity"]
    assert errors_of_input(("point_mass",)) == errors_of_input(("uniform_load", "kink")) == []
    assert errors_of_input(("friction",)) == []


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"slab": 0.0}, "slab is 0.0; it must be positive"),
        ({"surprise": float("nan")}, "surprise is nan"),
        ({"stated": -1.0}, "stated is -1.0"),
        ({"found": 6.0, "named": 5.0}, "found exceeds named"),
    ],
)
def test_bad_settings_are_refused_by_name(wrong, said):
    with pytest.raises(SettingsError, match=said):
        Settings(**wrong)


def limp():
    """A cable too limp for twenty elements."""
    return cables.study_of((Unknown("torsional_stiffness"),), poses=("plane",), bending_stiffness=1e-9)


@pytest.mark.slow
def test_poses_that_do_not_settle_are_an_answer_and_other_refusals_are_not():
    settings = Settings(found=4.5)
    found = explain(limp(), elements=20, settings=settings)
    assert (found.verdict, found.settings) == ("not in equilibrium", settings)
    assert found.fit is None and found.decision is None and not found.believable
    (said,) = found.sentences
    assert said.startswith("no values in the range let every pose settle")
    with pytest.raises(NotSettledError, match=r"no values in the range let every pose settle .*plane"):
        fit(limp(), elements=20)
    assert found.to_json()["messages"] == [said] and said in found.summary()
    with pytest.raises(Scan2FlexError, match="unknown"):
        explain(replace(limp(), unknowns=()))
