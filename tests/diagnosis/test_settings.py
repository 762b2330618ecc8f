"""Settings of the diagnosis: they reach the verdict, they are stored, and bad ones are refused by name."""

from importlib import import_module
from types import SimpleNamespace

import pytest

from scan2flex_jax.diagnosis import DiagnosisSettings, explain, verdict
from scan2flex_jax.diagnosis.confirm import Comparison
from scan2flex_jax.errors import NotSettledError
from scan2flex_jax.examples import example_path
from scan2flex_jax.study import load_study


def test_the_lead_that_names_is_a_setting():
    two = [verdict.Candidate(("a",), 20.0), verdict.Candidate(("b",), 16.0)]
    assert verdict.leading(two) == "favoured"
    assert verdict.leading(two, settings=DiagnosisSettings(lead_named=3.5)) == "named"
    assert verdict.leading(two, settings=DiagnosisSettings(lead_named=9.0, lead_favoured=8.0)) == "tied"
    assert verdict.ties(two, DiagnosisSettings(lead_named=9.0, lead_favoured=8.0)) == [0, 1]


def test_thresholds_of_visibility_explanation_and_comparison_are_settings():
    """A whitened length of 2, two nats over the baseline, and poses left out that are predicted 10 % better."""
    assert [verdict.of_kind(0.0, 2.0, DiagnosisSettings(visible=v)) for v in (3.0, 1.0)] == ["inconclusive", "absent"]
    assert verdict.of_kind(4.0, 2.0, DiagnosisSettings(visible=3.0)) == "too little", "a refit shows what one step does not"
    one, test, clean = [verdict.Candidate(("kink",), 2.0)], SimpleNamespace(p_value=0.001), SimpleNamespace(p_value=0.5)
    settings = DiagnosisSettings(lead_favoured=1.5), DiagnosisSettings(lead_favoured=1.5, least_evidence=2.5)
    assert [verdict.whole(test, clean, one, settings=s) for s in settings] == ["explained", "unexplained"]
    assert [Comparison(0.1, 0.01, 0.9, least).better for least in (0.05, 0.2)] == [True, False]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"level": 0.0}, "level is 0.0; it must be positive"),
        ({"level": 1.5}, "probabilities, below 1"),
        ({"most_left": float("nan")}, "most_left is nan"),
        ({"lead_favoured": 6.0}, "lead_favoured exceeds lead_named"),
        ({"noise_factor": 1.0}, "noise_factor is 1.0; it must exceed 1"),
    ],
)
def test_bad_settings_are_refused_by_name(wrong, said):
    with pytest.raises(ValueError, match=said):
        DiagnosisSettings(**wrong)


def test_they_are_kept_where_nothing_is_concluded(monkeypatch):
    def unsettled(*_, **__):
        raise NotSettledError("no pose settles", "try others", {})

    monkeypatch.setattr(import_module("scan2flex_jax.diagnosis.run"), "_base", unsettled)
    found = explain(load_study(example_path("simulated-cable")), settings=DiagnosisSettings(level=0.01))
    assert (found.verdict, found.settings.level) == ("not in equilibrium", 0.01)
