"""Likely mistakes of the input beside missing effects: which of the two explains the shapes (`diagnosis.run`)."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from scan2flex_jax.diagnosis import run, verdict
from scan2flex_jax.diagnosis.memory import MemoryTest
from scan2flex_jax.diagnosis.remembered import Remembering
from scan2flex_jax.diagnosis.search import Found
from scan2flex_jax.diagnosis.settings import USUAL
from scan2flex_jax.examples import example_path
from scan2flex_jax.fitting import Fit
from scan2flex_jax.study import load_study
from scan2flex_jax.study.mistakes import Mistake, without

AFTER = 10e-3  # m: what the corrected study leaves
STUDY = load_study(example_path("simulated-cable"))


def answer(said, left):
    """A search that ended with this verdict and this RMS distance (m) of the shapes of its best model nearest to the curves."""
    found = object.__new__(Found)
    bench = SimpleNamespace(poses=SimpleNamespace(count=len(STUDY.fit_poses)))
    found.verdict, found.best, found.stage = said, None, SimpleNamespace(left=left, bench=bench)
    return found


@pytest.fixture(autouse=True)
def nearest(monkeypatch):
    """The shapes nearest to the curves are as near as `answer` says."""
    monkeypatch.setattr(run.report, "nearest_rms", lambda stage, found: stage.left)


@pytest.fixture(scope="module")
def likely():
    alike = Mistake("the sign of the rolls", "turn them the other way", STUDY, before=40e-3, after=1.2 * AFTER)
    return (Mistake("gravity points along another axis", "turn it", STUDY, before=40e-3, after=AFTER), alike)


@pytest.mark.parametrize(
    ("said", "left", "outdone"),
    [
        (verdict.EXPLAINED, 0.3 * AFTER, True), (verdict.PARTLY, 0.8 * AFTER, True), (verdict.TIE, 0.8 * AFTER, True),
        (verdict.PARTLY, 0.95 * AFTER, False), (verdict.PARTLY, 1.1 * AFTER, False),
        (verdict.UNEXPLAINED, 0.3 * AFTER, False), (verdict.UNSOLVED, 0.3 * AFTER, False),
    ],
)  # fmt: skip
def test_an_effect_must_be_found_and_leave_less_than_the_corrected_study(likely, said, left, outdone):
    assert run._outdone(likely, answer(said, left), USUAL) is outdone


@pytest.mark.parametrize(("left", "outdone"), [(1.4 * AFTER, True), (1.6 * AFTER, False)])
def test_an_effect_that_explains_all_poses_alike_outdoes_leaving_one_out(left, outdone):
    """A tether left 3.2 mm in five poses that differ, each in its own way; four of them alone left 2.8 mm without it."""
    alone = replace(without(STUDY, STUDY.fit_poses[0]), before=40e-3, after=AFTER)
    assert run._outdone((alone,), answer(verdict.PARTLY, left), USUAL) is outdone
    assert run._outdone((alone,), answer(verdict.UNEXPLAINED, left), USUAL) is False


@pytest.mark.parametrize(("left", "outdone"), [(0.8 * AFTER, True), (0.95 * AFTER, False)])
def test_memory_may_outdo_a_mistake_too(likely, left, outdone):
    """Poses that depend on those before them look like poses whose input is wrong."""

    class Fitted(Fit):
        def rms(self, role: str = "fit") -> float:
            return left

    found, test = answer(verdict.UNEXPLAINED, AFTER), MemoryTest("friction", 80.0, (20.0,) * 19, {"share": 0.5}, 6.0)
    memory = Remembering(test, (AFTER, left), object.__new__(Fitted))
    assert run._outdone(likely, found, USUAL, memory) is outdone
    assert run._outdone(likely, found, USUAL, Remembering(test, (AFTER, left))) is False
