"""Turns of poses that the fit changes: said, and the study with its own turns is a variant that pays nothing for them."""

import pytest

from scan2flex_jax.fitting.least_squares import silent
from scan2flex_jax.inference import explain
from scan2flex_jax.inference.variants import stated_turns
from tests.fitting.scenes import measured
from tests.fitting.test_branches import with_turns

from .scenes import variant_of

pytestmark = pytest.mark.slow
WRONG = {"twist-90": 1}


def test_corrected_turns_are_no_missing_effect():
    """With noise beyond the error of the mesh, which would pass for an effect."""
    study = with_turns(WRONG)
    found = explain(measured(study, [p.curve.points for p in study.poses], 3e-4), elements=40, mesh=False)
    assert found.verdict == "no missing effect" and found.believable
    assert any("pose twist-90 was solved with turns =" in s for s in found.sentences)


def test_the_turns_of_the_study_are_less_likely_where_they_are_wrong():
    study = with_turns(WRONG)
    first = variant_of(study, elements=40)
    before, settings = first.empty.score, first.settings
    stated = stated_turns(study, first, silent)
    assert first.log_prior == -settings.turn and first.empty.score == pytest.approx(before - settings.turn)
    assert stated is None or stated.empty.score < first.empty.score - settings.found
    assert stated_turns(with_turns({}), variant_of(with_turns({}), elements=40), silent) is None
