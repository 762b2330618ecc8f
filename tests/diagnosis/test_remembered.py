"""Memory that a study does not declare: its score without refits, and what `explain` answers about it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from scan2flex_jax.diagnosis import remembered, verdict
from scan2flex_jax.diagnosis.memory import MemoryTest, declaring
from scan2flex_jax.diagnosis.result import Explanation, PoseChange, Ranked
from scan2flex_jax.diagnosis.search import Found
from scan2flex_jax.effects import Friction, Relaxation
from scan2flex_jax.fitting import fit
from scan2flex_jax.study import load_study, save_study
from tests.diagnosis.test_memory import study_with

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


@pytest.fixture(scope="module")
def in_place():
    """An answer without memory to poses with friction, and the one in its place."""
    study = study_with(0.6, 5)
    plain, fitted = fit(study), fit(declaring(study, "friction", {"share": 0.6, "slip_curvature": 2.0}))
    poses = {
        name: PoseChange(
            role=p.role, rms_before=p.rms, rms=0.9 * p.rms, worst=p.worst, stable=p.stable, s=p.s, residual_before=p.residual,
            residual=0.9 * p.residual, measured=p.measured, modelled=p.modelled, left_out_before=2 * p.rms, left_out=p.rms,
        ) for name, p in plain.poses.items()
    }  # fmt: skip
    ranking = (Ranked("kink", {"position": 0.5}, 9.0, 0.01, verdict.TIED, ("point_mass",)),)
    before = Explanation(
        study=study, verdict=verdict.UNEXPLAINED, fit=plain, p_value=0.01, ranking=ranking, estimates=plain.estimates,
        poses=poses, gates={"elements": 40, "constancy": 0.3}, settle=("kink: look at it",),
    )  # fmt: skip
    memory = remembered.Remembering(NAMED, (plain.rms(), fitted.rms()), fitted)
    return plain, fitted, remembered.answered(before, memory, ("told",))


@pytest.mark.slow
def test_memory_in_the_place_of_an_answer_has_parameters_errors_and_poses(in_place):
    plain, fitted, answer = in_place
    (found,) = answer.chosen
    assert answer.added == answer.chosen == answer.ranking[:1]
    assert (found.kind, found.verdict, found.log_evidence, found.p_value) == ("friction", verdict.NAMED, 74.0, 0.05)
    assert found.parameters == {name: fitted.estimates[f"friction.{name}"].value for name in ("share", "slip_curvature")}
    assert all(std > 0 for std in found.std.values())
    assert (answer.ranking[1].verdict, answer.ranking[1].tied_with) == (verdict.TOO_LITTLE, ())
    assert answer.estimates == {"bending_stiffness": fitted.estimates["bending_stiffness"]}
    assert (answer.rms(after=False), answer.rms()) == (pytest.approx(plain.rms()), pytest.approx(fitted.rms()))
    assert answer.rms() < answer.rms_left_out() < answer.rms_left_out(after=False)
    assert answer.gates == {"elements": 40}
    assert answer.settle == ()


@pytest.mark.slow
def test_memory_is_the_whole_explanation_only_where_it_leaves_noise(in_place):
    _, fitted, answer = in_place
    noise = not fitted.discrepancy.curvature and not fitted.misfits
    assert answer.verdict == (verdict.EXPLAINED if noise else verdict.PARTLY)
    assert ("; the remaining error is noise" in answer.sentences[0]) is noise
    assert answer.sentences[0].startswith("something is missing (p = 0.010); friction explains")
    assert answer.sentences[-1] == "told"
    assert answer.answer.belief.startswith("yes, with friction" if noise else "with care: friction removes most of the error")


@pytest.mark.slow
def test_the_study_of_the_answer_declares_the_memory_for_another_search(in_place, tmp_path):
    save_study(in_place[2].study, tmp_path / "found")
    saved = load_study(tmp_path / "found")
    assert [e.kind for e in saved.effects] == ["friction"]
    assert {"friction.share", "friction.slip_curvature"} <= set(saved.unknown_names)
