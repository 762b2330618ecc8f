"""Memory that a study does not declare: its score without refits, and what `explain` answers about it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from scan2flex_jax.diagnosis import remembered, verdict
from scan2flex_jax.diagnosis.memory import MemoryTest
from scan2flex_jax.diagnosis.result import Explanation
from scan2flex_jax.diagnosis.search import Found
from scan2flex_jax.effects import Friction, Relaxation

K = np.diag([1e5, 1e5, 1e4, 0.02, 0.02, 0.015])
NAMED = MemoryTest("friction", 80.0, (20.0,) * 19, {"share": 0.5}, 6.0)
DENIED = replace(NAMED, others=(20.0,) * 18 + (79.0,))


def natural(effect, path, places, reset=(False, False), held=(0.0, 0.0)):
    """Natural curvature about d2 of one element, per order and pose, for poses of these curvatures."""
    excess = np.zeros((len(path), 1, 6))
    excess[:, 0, 4] = path
    known = excess, np.tile(K, (len(path), 1, 1, 1)), np.array(places), np.array(held), np.array(reset)
    return np.asarray(remembered._natural(effect, *known))[:, :, 0, 4]


def test_a_slider_acts_like_the_natural_curvature_that_it_takes_off_the_moment():
    """Of share 1 it leaves the moment EI clip(k - q, -slip, slip) of EI k: the difference is that of a natural curvature."""
    effect = Friction(1.0, 1.0, spread=(1.0,), rounding=1e-9)
    found = natural(effect, [3.0, 1.0], [[0, 1], [1, 0]])
    np.testing.assert_allclose(found, [[2.0, 2.0], [2.0, 0.0]], atol=1e-7)  # after 3.0 it pulls back with all its force
    straightened = natural(effect, [3.0, 1.0], [[0, 1]], reset=(False, True))
    np.testing.assert_allclose(straightened, [[2.0, 0.0]], atol=1e-7)


def test_relaxation_acts_like_the_part_of_the_last_bend_that_crept_away():
    found = natural(Relaxation(1.0, 60.0), [2.0, 0.5], [[0, 1]], held=(60.0, 0.0))
    np.testing.assert_allclose(found, [[0.0, 2.0 * (1.0 - np.exp(-1.0))]])


@pytest.mark.parametrize(
    ("scored", "worth"),
    [
        ([9.0] + [1.0] * 19, True),
        ([9.0] + [9.5] * 3 + [1.0] * 16, True),
        ([9.0] + [9.5] * 4 + [1.0] * 15, False),
        ([2.0] + [0.0] * 19, False),
    ],
)
def test_few_other_orders_may_score_as_well(monkeypatch, scored, worth):
    """The score is blunter than the test by refits, and only decides whether that is run."""
    monkeypatch.setattr(remembered, "scores", lambda stage, kind: np.array(scored))
    assert remembered._worth(None, "friction") is worth


def searched(said, kinds=(), poses=6, remembers=False, stated=3e-4):
    study = SimpleNamespace(remembers=remembers, fit_poses=[None] * poses)
    stage = SimpleNamespace(bench=SimpleNamespace(problem=SimpleNamespace(study=study)), of=SimpleNamespace(stated=stated))
    found = object.__new__(Found)
    found.stage, found.verdict, found.tied = stage, said, [SimpleNamespace(kinds=kinds)]
    return found


@pytest.mark.parametrize(
    ("found", "matters"),
    [
        (searched(verdict.UNEXPLAINED), True),
        (searched(verdict.PARTLY, ("kink",)), True),
        (searched(verdict.TIE, ("memory_set",)), True),
        (searched(verdict.EXPLAINED, ("memory_set",)), True),
        (searched(verdict.EXPLAINED, ("kink",)), False),
        (searched(verdict.TIE, ("kink",)), False),
        (searched(verdict.EXPLAINED, ("kink",), stated=None), True),  # an estimated noise may contain what friction does
        (searched(verdict.NONE, stated=None), False),
        (searched(verdict.NONE), False),
        (searched(verdict.UNSOLVED), False),
        (searched(verdict.UNEXPLAINED, poses=4), False),
        (searched(verdict.UNEXPLAINED, remembers=True), False),
    ],
)
def test_memory_is_tried_where_more_than_noise_is_left_or_a_set_is_found(found, matters):
    assert remembered._may_matter(found) is matters


@pytest.mark.parametrize(
    ("turn", "times", "kinds"),
    [
        (0.1, [None, None], ["friction"]),
        (1.0, [None, None], ["friction", "torsion_friction"]),
        (0.0, [0.0, 60.0], ["friction", "relaxation"]),
        (0.0, [0.0, None], ["friction"]),
    ],
)
def test_twist_and_times_decide_which_memory_the_poses_can_show(monkeypatch, turn, times, kinds):
    """``turn`` (rad) over the length, in both poses."""
    strained = np.zeros((2, 10, 6))
    strained[..., 5] = turn / 0.8
    monkeypatch.setattr(remembered, "_strained", lambda stage: (strained, None))
    study = SimpleNamespace(poses=[SimpleNamespace(time=time) for time in times])
    bench = SimpleNamespace(problem=SimpleNamespace(study=study), context=SimpleNamespace(length=0.8))
    assert remembered._possible(SimpleNamespace(bench=bench)) == kinds


def test_the_answer_says_what_the_orders_show_and_how_a_set_compares():
    found, kept = searched(verdict.UNEXPLAINED), searched(verdict.EXPLAINED, ("memory_set",))
    say, Remembering = remembered.said_of, remembered.Remembering
    assert say(None, found) == ()
    (denied,) = say(Remembering(DENIED), kept)
    assert denied.startswith("memory is not established, other orders of the poses fit as well")
    tested = Remembering(NAMED, (4.0e-3, 0.5e-3))
    assert say(tested, found)[1] == "the best model without memory leaves 4.00 mm, friction 0.50 mm"
    assert say(tested, kept)[1] == "memory_set, which keeps a part of the pose before only, leaves 4.00 mm, friction 0.50 mm"


def test_an_answer_without_memory_stays_where_memory_leaves_no_less():
    answer = object.__new__(Explanation)
    assert remembered.answered(answer, remembered.Remembering(NAMED, (1e-3, 1e-3)), ()) is answer
    assert remembered.answered(answer, remembered.Remembering(DENIED), ()) is answer
