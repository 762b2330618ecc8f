"""A stated noise stays the noise: what is left far beyond it is not noise, whatever its correlation."""

from types import SimpleNamespace

import numpy as np
import pytest

from scan2flex_jax.diagnosis import explain, run, sentences, verdict
from scan2flex_jax.diagnosis.residual import Law
from scan2flex_jax.diagnosis.search import Found
from scan2flex_jax.diagnosis.settings import DiagnosisSettings
from scan2flex_jax.diagnosis.stage import Signatures
from scan2flex_jax.examples import example_path
from scan2flex_jax.fitting.answer import BAD
from scan2flex_jax.fitting.noise import Noise
from scan2flex_jax.study import load_study

STATED = 3e-4  # m


def signatures(stated, poses=6, points=50, **settings):
    of = object.__new__(Signatures)
    of.stated, of.settings = stated, DiagnosisSettings(**settings)
    real = [np.ones(points, bool)] * poses
    of.bench = SimpleNamespace(poses=SimpleNamespace(count=poses), context=SimpleNamespace(length=1.0), real=real)
    return of


@pytest.mark.parametrize(
    ("white", "correlated", "conspicuous"),
    [(1e-4, 5e-3, True), (1e-4, 1e-3, False), (2e-3, 5e-3, False)],  # smooth and large; small; not smooth
)
def test_smooth_noise_of_some_thousandths_of_the_length_is_not_the_sensor_s_unless_stated(white, correlated, conspicuous):
    """Two photographs traced to 0.1 mm of a wire of 1.5 m: 11 mm left by a tether, alike over 80 mm, had been "noise"."""
    noise = Noise(white, correlated, 0.05)
    assert signatures(None).conspicuous(noise) is conspicuous
    assert signatures(None).more_than_noise(Law(noise)) is conspicuous
    assert signatures(noise.total).conspicuous(noise) is False


def test_a_smooth_residual_of_a_single_photograph_is_not_noise():
    """In one pose a discrepancy and an effect are the same: the search goes on at the noise that a discrepancy leaves."""
    found = explain(load_study(example_path("red-wire")))
    assert found.verdict == verdict.UNEXPLAINED and found.answer.tone == BAD
    assert found.noise.total < 2e-3 and found.p_value < 0.01
    np.testing.assert_allclose(found.rms(after=False), found.fit.rms(), rtol=0.02)
    assert found.rms() < 0.5 * found.rms(after=False)


def test_two_markers_do_not_show_that_millimetres_are_noise():
    """A weight placed 55 mm from the tip, with 6 mm left at two markers a pose, had been "explained"."""
    for large, noise in ((True, Noise(3e-3, 0.0, 0.05)), (False, Noise(1e-3, 0.0, 0.05))):
        assert signatures(None, points=2).conspicuous(noise) is large
        assert signatures(None, points=20).conspicuous(noise) is False
        assert signatures(noise.total, points=2).conspicuous(noise) is False


@pytest.mark.parametrize(
    ("white", "correlated", "exceeds"),
    [(1.0, 0.0, False), (1.0, 1.5, False), (1.0, 2.6, True), (0.0, 2.1, True), (2.1, 0.0, True)],
)
def test_white_or_correlated_noise_beyond_twice_the_stated_one_is_not_the_sensor_s(white, correlated, exceeds):
    noise = Noise(white * STATED, correlated * STATED, 0.1)
    assert signatures(STATED).exceeds(noise) is exceeds
    assert signatures(None).exceeds(noise) is False
    assert signatures(STATED, beyond_stated=4.0).exceeds(noise) is False


def test_an_effect_that_leaves_more_than_the_stated_noise_does_not_explain_all(monkeypatch):
    """The answer is then left to the search at each model's own floor, where poses may differ and memory is tried."""
    monkeypatch.setattr(run.floors, "gain_of_discrepancy", lambda of, best, noise: 0.0)
    found = object.__new__(Found)
    found.best, found.verdict = None, verdict.EXPLAINED
    found.stage = SimpleNamespace(noise=Noise(STATED, 2.6 * STATED, 0.1))
    assert run._poses_differ(signatures(STATED), found)
    assert not run._poses_differ(signatures(STATED, poses=1), found)  # in a single pose, discrepancy and effect are the same
    assert not run._poses_differ(signatures(None), found)


@pytest.mark.parametrize(
    ("said", "correlated", "ends"),
    [
        (verdict.EXPLAINED, 1.0, "explains it; the remaining error is noise"),
        (verdict.TIE, 1.0, "explains it; the remaining error is noise"),
        (verdict.PARTLY, 2.6, "explains most of it; the remaining error exceeds the noise"),
        (verdict.TIE, 2.6, "explains most of it; the remaining error exceeds the noise"),
    ],
)
def test_sentence_and_verdict_agree_on_whether_the_rest_is_noise(said, correlated, ends):
    found = object.__new__(Found)
    found.verdict, found.test = said, SimpleNamespace(p_value=0.001)
    found.stage = SimpleNamespace(of=signatures(STATED))
    found.best = SimpleNamespace(law=Law(Noise(STATED, correlated * STATED, 0.1)))
    found.minima = []
    assert sentences.of_search(found, [SimpleNamespace(kind="point_mass", tied_with=())], None)[0].endswith(ends)
