"""What is said of a model is said of the refit that is reported, and an answer without an effect carries the discrepancy."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from scan2flex_jax.diagnosis import choice, confirm, floors, score, sentences, verdict
from scan2flex_jax.diagnosis.conclusion import likely_models
from scan2flex_jax.diagnosis.refit import Refit
from scan2flex_jax.diagnosis.residual import Law
from scan2flex_jax.diagnosis.search import Found
from scan2flex_jax.diagnosis.stage import Stage
from scan2flex_jax.fitting.noise import Noise


def refit(curvature, cost=0.0):
    law = replace(Law(Noise(1e-3, 1e-4, 0.1)), curvature=curvature)
    return Refit(
        components=(), vector=np.zeros(0), shapes=[], cost=cost, chi2=0.0, log_marginal=0.0, log_evidence=0.0,
        covariance=np.zeros((0, 0)), converged=True, law=law,
    )  # fmt: skip


@pytest.fixture
def stage():
    """One whose refits have another one that is reported, of cost 1."""
    bench = SimpleNamespace(poses=SimpleNamespace(count=2))
    return SimpleNamespace(bench=bench, unseen={}, freed=lambda found: replace(found, cost=1.0), of=None)


@pytest.mark.parametrize(("curvature", "cost"), [(0.5, 1.0), (0.0, 0.0)])
def test_poses_are_left_out_of_the_refit_that_is_reported(stage, monkeypatch, curvature, cost):
    """Under the law of a discrepancy the prior draws a strong effect: a point mass was given up for the errors of a refit that
    nobody was shown. Without a discrepancy the data decide."""
    monkeypatch.setattr(confirm, "refitted", lambda bench, found: np.full(2, 10.0 + found.cost))
    found = refit(curvature)
    assert np.all(confirm.left_out(stage, found) == 10.0 + cost)
    monkeypatch.setattr(confirm, "refitted", lambda bench, found: pytest.fail("computed twice"))
    assert np.all(confirm.left_out(stage, found) == 10.0 + cost)


def test_the_distance_to_the_curves_is_that_of_the_refit_that_is_reported(stage, monkeypatch):
    monkeypatch.setattr(floors, "squares", lambda of, found: 3.0 - found.cost)
    base = refit(0.0, cost=0.5)
    assert choice.nearer(stage, refit(0.5), base)
    assert not choice.nearer(stage, refit(0.0), base)


def test_sizes_scatter_as_those_of_the_refit_that_is_reported(stage, monkeypatch):
    """Sizes of 1 and 2 in two poses of equal sensitivity scatter by 1/3 about 1.5, by 1/2 about the 1 that the prior draws."""
    numbers = SimpleNamespace(amplitudes=lambda k: np.array([0]))
    monkeypatch.setattr(confirm, "Numbers", lambda bench, components: numbers)
    monkeypatch.setattr(confirm, "Prior", lambda bench, components: SimpleNamespace(frozen=np.zeros(1, bool)))

    def white(stage, found):
        return SimpleNamespace(J=np.ones((2, 1)), r=found.vector - np.array([1.0, 2.0]), rows=[[0], [1]])

    monkeypatch.setattr(confirm, "_white", white)
    stage.freed = lambda found: replace(found, vector=np.array([1.5]))
    drawn = replace(refit(0.5), vector=np.array([1.0]))
    assert confirm.scatter(stage, drawn, 0) == pytest.approx(1 / 3)
    assert confirm.scatter(stage, replace(drawn, law=refit(0.0).law), 0) == pytest.approx(1 / 2)


def test_without_an_effect_the_intervals_carry_the_discrepancy():
    """The fit had an interval of 11 % that held the truth; the explanation, at the sensor's noise, one of 2 % that did not."""
    noise, floor = refit(0.0), refit(0.3)
    stage, test = object.__new__(Stage), object.__new__(score.Test)
    stage.base = noise
    object.__setattr__(test, "p_value", 0.2)
    found = Found(stage, test, np.zeros(0), [], {}, noise, verdict=verdict.NONE)
    assert likely_models(found) == [noise]
    found.floor = floor
    (model,) = likely_models(found)
    assert model is floor
    assert sentences.of_search(found, (), None) == ("no missing effect shows in these shapes (p = 0.200)",)
