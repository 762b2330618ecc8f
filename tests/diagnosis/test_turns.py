"""Other turns of some poses, or an effect with the turns of the study: which of the two explains the shapes."""

from types import SimpleNamespace

import pytest

from scan2flex_jax.diagnosis import run, verdict
from scan2flex_jax.diagnosis.search import Found
from scan2flex_jax.diagnosis.settings import USUAL
from scan2flex_jax.errors import NotSettledError
from scan2flex_jax.examples import example_path
from scan2flex_jax.study import load_study


def answer(said, likelihood=0.0, turned=()):
    """Base and search that ended with a verdict, and with this log marginal likelihood of the best model."""
    base, found = object.__new__(run._Base), object.__new__(Found)
    found.verdict, found.stage = said, SimpleNamespace(settings=USUAL)
    found.best = found.floor = SimpleNamespace(log_marginal=likelihood, kinds=("natural_curvature",))
    object.__setattr__(base, "fit", SimpleNamespace(turned=turned))
    FOUND[id(base)] = found
    return base


FOUND: dict[int, Found] = {}
STUDY = load_study(example_path("simulated-cable"))


def likelier(base, stated):
    """What `explain` goes on with; ``stated``: the base with the turns of the study, or an exception."""
    begun = []

    def begin(study, other_turns):
        assert not other_turns
        begun.append(study)
        if isinstance(stated, Exception):
            raise stated
        return stated

    chosen = run._on_likelier_turns(begin, STUDY, base, FOUND[id(base)], lambda line: None)
    return chosen, bool(begun)


@pytest.fixture(autouse=True)
def searched(monkeypatch):
    monkeypatch.setattr(run, "_searched", lambda base, say: FOUND[id(base)])


@pytest.mark.parametrize(
    ("said", "lead", "taken"),
    [
        (verdict.PARTLY, 21.0, True), (verdict.EXPLAINED, 21.0, True), (verdict.TIE, 21.0, True),
        (verdict.PARTLY, 0.5 * USUAL.lead_named, False), (verdict.UNEXPLAINED, 21.0, False), (verdict.NONE, 21.0, False),
    ],
)  # fmt: skip
def test_the_turns_of_the_study_stand_if_an_effect_found_with_them_is_likelier(said, lead, taken):
    base, stated = answer(verdict.UNEXPLAINED, 100.0, turned=("pose p1 ...", "pose p2 ...")), answer(said, 100.0 + lead)
    (chosen, found, sentences), _ = likelier(base, stated)
    assert (chosen is stated, found is FOUND[id(stated)]) == (taken, taken)
    assert bool(sentences) == taken
    if taken:
        assert "in 2 poses" in sentences[0] and "21 nats" in sentences[0] and "natural_curvature" in sentences[0]


@pytest.mark.parametrize(
    ("said", "turned"), [(verdict.UNEXPLAINED, ()), (verdict.NONE, ("pose p1 ...",)), (verdict.EXPLAINED, ("pose p1 ...",))]
)
def test_nothing_is_searched_twice_without_turned_poses_or_without_a_rest(said, turned):
    base = answer(said, turned=turned)
    (chosen, found, sentences), searched_again = likelier(base, answer(verdict.PARTLY, 50.0))
    assert chosen is base
    assert found is FOUND[id(base)]
    assert (sentences, searched_again) == ((), False)


def test_turns_of_the_study_that_do_not_settle_change_nothing():
    base = answer(verdict.PARTLY, turned=("p1",))
    (chosen, *_), searched_again = likelier(base, NotSettledError("not solved", "look at p1", {}))
    assert chosen is base
    assert searched_again
