"""Settings of a decision, errors of the input that act like effects, and poses that do not settle."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from scan2flex_jax.errors import NotSettledError, Scan2FlexError, SettingsError
from scan2flex_jax.inference import Settings, explain, fit
from scan2flex_jax.inference.variants import mesh_figures, variant_of
from scan2flex_jax.posterior.decision import _first_of, errors_of_input, lead, led
from scan2flex_jax.posterior.program import Component
from scan2flex_jax.study import Unknown
from tests.fitting import scenes as cables


def test_errors_of_the_input_with_the_shapes_of_an_effect_are_known():
    """The word "always" in a condition means nothing by itself."""
    assert [s.other for s in errors_of_input(("uniform_load",))] == ["gravity"]
    assert errors_of_input(("point_mass",)) == errors_of_input(("uniform_load", "kink")) == []
    assert errors_of_input(("friction",)) == []


EXACT = {"bending_stiffness": cables.EI, "torsional_stiffness": cables.GJ}
STRONG = [1020.0, 70.0, 25.0, 12.0, 7.0, 5.5, 3.0, 1.0]  # nats by pose: as those of a pull at the tip of a real cable


@pytest.mark.parametrize(
    ("differences", "leads"),
    [
        (STRONG, True),  # 1,144 +- 998 by their plain sum
        ([-d for d in STRONG], False),
        ([300.0, 500.0, 40.0], True),
        ([1020.0, 0.3, -0.2, 0.5, -1.0, 0.1, 0.4, -0.3], False),  # a single pose
        ([200.0, -150.0, 300.0, -20.0, 90.0, -180.0], False),  # two strong rivals, each better in half of the poses
        ([300.0, 500.0, -40.0, 200.0], False),
        ([1.2, 0.8, 1.5, 0.9, 1.1, 0.7], True),
        ([0.4, -0.3, 0.6, 0.2, -0.1, 0.5], False),
        ([300.0, 500.0], False),  # two poses agree too easily
    ],
)
def test_poses_lead_together(differences, leads):
    d, s = np.array(differences), Settings()
    assert led(d, s.mistake, s.found) is leads
    assert led(1e3 * d, s.mistake, s.found) >= leads  # the stronger, the surer


def test_what_one_pose_says_is_bounded():
    """By closed form: poses that all reach the bound c sum to n c, and their standard error is c."""
    for n in (3, 4, 8):
        assert lead(np.full(n, 1e4), 5.0) == pytest.approx((5.0 * n, 5.0))
    assert lead(np.array([1e6, 1.0, 2.0]), 5.0) == pytest.approx(lead(np.array([5.0, 1.0, 2.0]), 5.0))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"discrepancy": 0.0}, "discrepancy is 0.0; it must be positive"),
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


def test_a_mesh_error_that_is_not_known_is_said_without_a_number():
    """A pose that is not solved with more elements: nothing that JSON cannot hold."""
    figures, coarse = mesh_figures(["a", "b", "c"], np.array([1e-6, np.nan, 3e-3]), 1e-4)
    assert figures == {} and coarse == ["b (not solved with more elements)", "c (3.00 mm)"]
    assert mesh_figures(["a"], np.array([1e-6]), 1e-4) == ({"mesh_error": 1e-6}, [])


@dataclass
class _Scored:
    score: float
    kinds: tuple[str, ...]

    @property
    def components(self):
        return [Component(kind, {}) for kind in self.kinds]


@pytest.mark.parametrize(
    ("tied", "first"),
    [
        ([_Scored(92.0, ("stiffness_field",)), _Scored(98.0, ("point_mass",)), _Scored(97.0, ("density_profile",))], 1),
        ([_Scored(98.0, ("stiffness_field",)), _Scored(92.0, ("tether",))], 0),
        ([_Scored(92.0, ("kink", "stiffness_field")), _Scored(98.0, ("natural_curvature", "stiffness_field"))], 0),
        ([_Scored(92.0, ("point_mass",)), _Scored(98.0, ("density_profile",))], 0),
        ([_Scored(92.0, ("stiffness_field",))], 0),
    ],
)
def test_of_tied_hypotheses_one_of_any_form_is_first_only_where_it_is_the_likeliest(tied, first):
    assert _first_of(tied) is tied[first]


def test_a_prior_is_that_which_was_given_last():
    """Whichever variant of a fit was made before; its poses are grouped like those of the variant that it is compared with."""
    found = fit(cables.measured(study := cables.study_of(), cables.exact_curves(study, EXACT), 3e-4), elements=cables.ELEMENTS)
    plain = found.posterior.score
    for log_prior in (-5.0, -5.0, -3.0):
        again = variant_of("again", found, log_prior, groups=[[0, 1], [2]])
        assert again.empty.score == pytest.approx(plain + log_prior)
    assert len(again.empty.elpd) == 2
