"""Rules of the search that need no rod."""

from dataclasses import replace
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest

from scan2flex_jax.diagnosis import DiagnosisSettings
from scan2flex_jax.diagnosis.refit import Refit
from scan2flex_jax.diagnosis.residual import Law
from scan2flex_jax.diagnosis.sensitivity import Component
from scan2flex_jax.effects.catalogue import entry_of
from scan2flex_jax.fitting.noise import Noise
from tests.effects import scene

search = import_module("scan2flex_jax.diagnosis.search")


def refit(log_evidence, *kinds, log_marginal=0.0):
    components, nothing = tuple(Component(kind, {}) for kind in kinds), np.zeros(0)
    return Refit(
        components=components, vector=nothing, shapes=[], cost=0.0, chi2=0.0, log_marginal=log_marginal, covariance=nothing,
        converged=True, law=Law(Noise(1e-3, 1e-4, 0.05)), log_evidence=log_evidence,
    )  # fmt: skip


def test_a_set_with_an_effect_too_many_gives_way_to_the_rest():
    """A second effect of no size may gain a nat by chance: it is no part of a tie, and no rival."""
    alone, more, other, pair = refit(159.2, "a"), refit(159.9, "b", "a"), refit(150.0, "b"), refit(170.0, "c", "a")
    stage = SimpleNamespace(settings=DiagnosisSettings())
    assert search._needed(stage, [alone, more, other]) == [alone, other]
    assert search._needed(stage, [other, more]) == [other, more]  # nine nats: of this part it is needed
    assert search._needed(stage, [alone, pair]) == [alone, pair]


@pytest.mark.parametrize(("kind", "candidates"), [("tether", 1), ("elastic_clamp", 3)])
def test_log_evidence_is_over_the_base_and_pays_for_the_choice_of_a_site(kind, candidates):
    """Places that a refit moves are paid for by their range; of the ends of a cable one of three sets was chosen."""
    base = refit(0.0, log_marginal=-1000.0)
    component = Component(kind, entry_of(kind).sites(scene.CONTEXT)[0])
    found = replace(refit(np.nan, log_marginal=-975.0), components=(component,))
    assert found.over(base, scene.CONTEXT).log_evidence == pytest.approx(25.0 - np.log(candidates))
    assert base.over(base, scene.CONTEXT).log_evidence == 0.0


@pytest.mark.parametrize(("reached", "expected"), [(0.68, [0.15]), (0.5, [0.15, 0.85]), (0.0, [0.5, 0.85])])
def test_the_likeliest_effect_is_refitted_from_places_far_from_the_one_reached(monkeypatch, reached, expected):
    """A string that is slack in some poses has a minimum in each part of the cable, which its scores do not rank."""
    length, places = 1.2, np.linspace(0.05, 1.0, 20)
    components = [Component("kink", {"position": 0.3}), *(Component("tether", {"position": length * p}) for p in places)]
    stage = SimpleNamespace(components=components, bench=SimpleNamespace(context=SimpleNamespace(length=length)), base="base")
    best = replace(refit(700.0), components=(Component("tether", {"position": length * reached}),))
    found = SimpleNamespace(best=best, amplitudes=[None] * len(components))
    monkeypatch.setattr(search, "relative", lambda stage, components, amplitudes, near: (*components, near))
    started = search._refit_elsewhere(stage, found, lambda message: None)
    assert [c.site["position"] / length for c, _ in started] == pytest.approx(expected)
    assert {(c.kind, near) for c, near in started} == {("tether", "base")}
    found.best = replace(best, components=(Component("clamp_rotation", {}),))
    assert search._refit_elsewhere(stage, found, lambda message: None) == []


@pytest.fixture
def single(monkeypatch):
    """A search that has found a tether, tied with a force, and that refits any effect whose score exceeds what is asked for."""
    found = object.__new__(search.Found)
    found.stage = SimpleNamespace(settings=DiagnosisSettings(), of=None, noise=None)
    found.best, found.refits, found.scattered = refit(40.0, "tether"), {}, False
    found.add([found.best, refit(38.0, "point_load"), refit(20.0, "kink")])
    scores = {"tether": 0.0, "point_load": 0.0}  # of a kink beside them, over each

    def one_more(stage, first, count, progress, known=None, settled=frozenset(), least=-np.inf):
        step = scores[first.kinds[0]]
        return [refit(first.log_evidence + step, *first.kinds, "kink")] if step > least else []

    monkeypatch.setattr(search, "refit_with_one_more", one_more)
    found.values = None
    monkeypatch.setattr(search, "refit_pairs", lambda stage, values, progress: [])
    monkeypatch.setattr(search.floors, "gain_of_discrepancy", lambda of, r, noise: 0.0)
    monkeypatch.setattr(search, "_settled", lambda stage, found, wider, lead, progress: wider)
    return found, scores


@pytest.mark.parametrize(
    ("p_value", "steps", "expected"),
    [
        (0.5, {"tether": 6.0}, ("tether", "kink")), (0.5, {"tether": 4.0}, None), (0.01, {"tether": 4.0}, ("tether", "kink")),
        (0.5, {"point_load": 8.0}, ("point_load", "kink")), (0.5, {"point_load": 6.0}, None), (0.01, {"tether": 2.0}, None),
    ],
)  # fmt: skip
def test_a_second_effect_that_leads_is_added_where_the_test_of_the_residual_sees_nothing(single, p_value, steps, expected):
    """A plane beside which a heavy span led by 22 nats was left alone, as the test had a p-value of 0.08; the rival beside
    which a second effect leads need not be the likeliest one."""
    found, scores = single
    scores |= steps
    found.after = SimpleNamespace(p_value=p_value)
    wider = search._widened(found, lambda message: None)
    assert (wider and wider.kinds) == expected
