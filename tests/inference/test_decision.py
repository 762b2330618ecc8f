"""The decisions on real hypotheses, and the settings with their thresholds."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from scan2flex_jax.errors import Scan2FlexError, SettingsError
from scan2flex_jax.fitting.least_squares import silent
from scan2flex_jax.inference import Settings, explain
from scan2flex_jax.inference.decision import compared, decide, errors_of_input, leads
from scan2flex_jax.inference.search import Search
from scan2flex_jax.study import Unknown
from scan2flex_jax.study.mistakes import Mistake
from tests.fitting import scenes as cables


def nobody(h):
    """No validate pose is surprised."""
    return {}


def search_of(clip, *kinds):
    """The search of an explanation, with hypotheses of these effects alone."""
    search = Search([clip.decision.empty.variant], silent)
    for h in clip.scored:
        if not kinds or h.kinds in ((), *((k,) for k in kinds)):
            search.add(h)
    return search


@pytest.mark.slow
def test_a_lead_exceeds_its_standard_error_and_the_least_difference(clip):
    best, empty = clip.decision.best, clip.decision.empty
    d = best.elpd - empty.elpd
    difference, error = compared(best, empty)
    assert (difference, error) == (pytest.approx(np.sum(d)), pytest.approx(np.sqrt(len(d)) * np.std(d, ddof=1)))
    assert difference > 2 * error and leads(best, empty, 0.9 * difference) and not leads(best, empty, 1.1 * difference)
    assert not leads(empty, best, 1e-9) and compared(best, best) == (0.0, 0.0) and not leads(best, best, 1e-9)


@pytest.mark.slow
def test_verdicts_follow_from_the_rivals_and_the_validate_poses(clip):
    decided = decide(search_of(clip), [], False, nobody)
    assert (decided.verdict, decided.best.kinds) == (clip.verdict, clip.decision.best.kinds)
    alone = search_of(clip, "point_mass")
    assert decide(alone, [], False, nobody).verdict == "explained"
    contradicted = decide(alone, [], False, lambda h: {"p7": 5.0})
    assert (contradicted.verdict, contradicted.surprised) == ("partly explained", {"p7": 5.0})
    tied = decide(search_of(clip, "point_mass", "point_load"), [], False, nobody)
    assert tied.verdict == "tied"
    assert {h.kinds for h in (tied.best, *tied.tied)} == {("point_mass",), ("point_load",)}
    assert decide(alone, [], True, nobody).verdict == "not in equilibrium"
    without = decide(search_of(clip, "no such effect"), [], False, nobody)
    assert without.verdict == "unexplained"  # the poses have a discrepancy
    assert without.best is clip.decision.empty


@pytest.mark.slow
def test_a_mistake_stands_unless_effects_lead_over_it(clip):
    mistake = Mistake("gravity points along another axis", "turn it", clip.study, before=40e-3, after=1e-3)
    best, empty = clip.decision.best, clip.decision.empty
    for as_good, stands in ((best, True), (empty, False)):
        decided = decide(search_of(clip), [(mistake, as_good)], False, nobody)
        assert decided.mistakes == ((mistake,) if stands else ())
        assert (decided.verdict == "unexplained") is stands


@pytest.mark.slow
def test_the_probability_that_nothing_is_missing_is_that_of_the_paired_differences(clip):
    """Of Student's t, as poses are few, unless a discrepancy of the poses says it more clearly."""
    alone = search_of(clip, "point_mass")
    (h,) = (h for h in clip.scored if h.kinds == ("point_mass",))
    paired = stats.ttest_rel(h.elpd, clip.decision.empty.elpd, alternative="greater").pvalue
    found = decide(alone, [], False, nobody).p_value
    assert found == pytest.approx(min(paired, np.exp(-clip.decision.empty.gain())), rel=1e-6)


def test_errors_of_the_input_with_the_shapes_of_an_effect_are_known():
    """The word "always" in a condition means nothing by itself."""
    assert [s.other for s in errors_of_input(("uniform_load",))] == ["gravity"]
    assert errors_of_input(("point_mass",)) == errors_of_input(("uniform_load", "kink")) == []
    assert errors_of_input(("friction",)) == []


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"found": 0.0}, "found is 0.0; it must be positive"),
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


def test_poses_that_do_not_settle_are_an_answer_and_other_refusals_are_not():
    settings = Settings(found=4.5)
    found = explain(limp(), elements=20, settings=settings)
    assert (found.verdict, found.settings) == ("not in equilibrium", settings)
    assert found.fit is None and found.decision is None and not found.believable
    (said,) = found.sentences
    assert said.startswith("no values in the range let every pose settle")
    assert found.to_json()["messages"] == [said] and said in found.summary()
    with pytest.raises(Scan2FlexError, match="unknown"):
        explain(replace(limp(), unknowns=()))
