"""The whole loop on cases of the independent simulator: nothing missing, a clip on the cable, and its decision.

Validate poses have no part in the scores, and contradict the answer.
"""

import json
import threading
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

from scan2flex_jax.effects.catalogue import entry_of
from scan2flex_jax.examples import example_path
from scan2flex_jax.fitting import residual_function
from scan2flex_jax.fitting.least_squares import silent
from scan2flex_jax.inference import explain, fit, plan
from scan2flex_jax.inference.planning import ranked_poses
from scan2flex_jax.posterior.decision import compared, decide, leads
from scan2flex_jax.posterior.program import Component
from scan2flex_jax.posterior.recorded import replayed
from scan2flex_jax.posterior.search import Search, scored
from scan2flex_jax.posterior.settings import Settings
from scan2flex_jax.study import Clamp, MeasuredCurve, load_study, save_study
from scan2flex_jax.study.mistakes import Mistake

from . import scenes

pytestmark = pytest.mark.slow
MASS, PLACE = 0.0188707, 0.1986  # kg and m, of the clip in case t004
ELEMENTS = 40


@pytest.fixture(scope="module")
def clip():
    """Four poses of a cable with an undeclared clip, and one for validation."""
    return explain(scenes.case("t004", unseen=("p7",)), elements=ELEMENTS, mesh=False)


@pytest.fixture(scope="module")
def nothing():
    """An explanation, which leaves threads and compiled functions as they were."""
    traced = []

    @jax.jit
    def own(x):
        traced.append(x)
        return 2.0 * x

    own(jnp.ones(3))
    before, said = threading.enumerate(), []
    found = explain(scenes.case("t001"), elements=ELEMENTS, mesh=False, progress=said.append)
    own(jnp.ones(3))
    assert len(traced) == 1 and threading.enumerate() == before
    assert said[0] == "baseline fit" and said[-1] == "before and after"
    return found


def test_curves_without_noise_are_explained_to_the_mesh():
    """The curves of the packaged study solve the continuous equations to 1e-9 m; no refinement of the mesh reaches that."""
    found = explain(load_study(example_path("simulated-cable")))
    assert found.verdict == "no missing effect"
    assert found.answer.tone == "good"
    assert found.gates["mesh_error"] < 1e-5 * 0.2
    assert found.estimates["bending_stiffness"].value == pytest.approx(0.1, rel=1e-5)


def test_a_clip_is_found(clip):
    assert clip.verdict in ("explained", "tied")
    assert {r.kind for r in clip.ranking if r.verdict in ("named", "favoured", "tied")} & {"point_mass", "density_profile"}
    assert clip.significant and clip.believable
    assert clip.rms() < 0.7 * clip.rms(after=False)
    assert clip.rms("validate") < 0.7 * clip.rms("validate", after=False)
    assert clip.rms_left_out() < 0.7 * clip.rms_left_out(after=False)


def test_the_clip_is_weighed_and_placed_within_its_errors(clip):
    found = next(r for r in clip.ranking if r.kind == "point_mass")
    for name, truth in (("position", PLACE), ("mass", MASS)):
        assert found.parameters[name] == pytest.approx(truth, abs=4.0 * found.std[name])
        assert found.parameters[name] == pytest.approx(truth, rel=0.3)


def test_the_explanation_goes_round_again(clip, tmp_path):
    save_study(clip.study, tmp_path / "again")
    assert load_study(tmp_path / "again").effects == clip.study.effects
    written = json.loads(json.dumps(clip.to_json()))
    assert written["format"] == "scan2flex-result/1"
    assert written["chosen"][0]["kind"] == clip.study.effects[-1].kind
    assert [h["kinds"] for h in written["hypotheses"]] == [list(h.kinds) for h in clip.hypotheses]
    assert clip.chosen[0].kind in clip.summary()


def test_the_study_predicts_the_poses_as_the_explanation_says(clip):
    """Its effects and values are those of the refitted model, and give the same distances."""
    function, start = residual_function(clip.study, elements=ELEMENTS)
    residual, first = np.asarray(function(start)).reshape(-1, 3), 0
    for pose in clip.study.fit_poses:
        said = clip.poses[pose.name]
        own = residual[first : first + len(said.residual)]
        first += len(own)
        assert np.sqrt(np.mean(np.sum(own**2, axis=1))) == pytest.approx(said.rms, rel=1e-3)
    assert first == len(residual)


def test_the_error_before_is_that_of_the_fit(clip, nothing):
    """Of the model whose estimates stand as those before: with a discrepancy too, no gain is made of other weights."""
    assert nothing.rms(after=False) == pytest.approx(nothing.fit.rms(), rel=0.02)
    assert clip.rms(after=False) == pytest.approx(clip.fit.rms(), rel=0.05)


def test_the_table_says_what_each_hypothesis_predicts(clip):
    best, empty = clip.hypotheses[0], next(h for h in clip.hypotheses if not h.kinds)
    assert (best.relation, empty.relation) == ("best", "simpler")
    assert best.kinds == tuple(r.kind for r in clip.chosen)
    assert {h.kinds[0] for h in clip.hypotheses if h.relation == "tied"} == set(clip.chosen[0].tied_with)
    assert (empty.log_evidence, empty.elpd, empty.elpd_std) == (0.0, 0.0, 0.0)
    assert best.elpd > 2 * best.elpd_std > 0 and best.log_evidence > 10
    own = clip.decision.best.elpd - clip.decision.empty.elpd
    assert best.elpd == pytest.approx(np.sum(own))
    assert best.elpd_std == pytest.approx(2 * np.std(own, ddof=1))


def test_nothing_is_missing_where_nothing_is_missing(nothing):
    assert nothing.verdict == "no missing effect"
    assert nothing.chosen == () and nothing.believable and not nothing.significant
    assert nothing.hypotheses[0].kinds == ()
    assert nothing.rms() == pytest.approx(np.sqrt(2) * nothing.noise.total, rel=0.1)


def test_the_score_to_first_order_has_the_sign_and_the_size_of_a_refit(clip):
    first, empty = scored(clip.decision.empty)["point_mass"], clip.decision.empty
    refitted = next(h for h in clip.scored if h.kinds == ("point_mass",))
    assert first.amplitudes[0] > 0
    assert first.amplitudes[0] == pytest.approx(refitted.amplitudes(0)[0], rel=0.5)
    assert first.gain == pytest.approx(refitted.score - empty.score, rel=0.3)


def test_natural_twist_and_a_roll_of_a_clamp_are_one_class(clip):
    h = clip.decision.empty
    wanted = [Component("natural_curvature", {}), Component("clamp_rotation", {"ends": np.array([0.0, 1.0])})]
    columns, owner = h.variant.program.columns((), h.x, h.configuration, wanted)
    at = [np.flatnonzero(owner == k)[j] for k, j in ((0, 2), (1, 5))]
    twist, roll = (np.concatenate([c[..., i].ravel() for c in columns]) for i in at)
    cosine = abs(twist @ roll) / (np.linalg.norm(twist) * np.linalg.norm(roll))
    assert cosine > 0.999
    assert "clamp_rotation" in {same.other for same in entry_of("natural_curvature").same_shapes}


def test_a_pose_left_out_is_predicted_as_by_a_refit_without_it(nothing):
    """The block formula against fits of the other poses; the error is 3 mm, where that of the fit is 0.6 mm."""
    full = scenes.case("t001")
    name = full.poses[0].name
    rest = replace(full, poses=tuple(replace(p, role="validate") if p.name == name else p for p in full.poses))
    assert nothing.poses[name].left_out == pytest.approx(fit(rest, elements=ELEMENTS).poses[name].rms, rel=0.1)


def test_an_effect_of_the_cable_is_alike_in_all_poses(clip):
    assert 0.0 < max(clip.scatter.values()) < 0.5


def test_the_equivalent_load_points_down_where_the_clip_is(clip):
    """0.0189 kg, 0.185 N, at 0.199 m: what the smooth field has there is downward and, over its width, near that size."""
    f = clip.load
    near = np.argmin(np.abs(f.s - PLACE))
    assert f.mean[near, 2] + f.std[near, 2] < 0
    width = f.s[1] - f.s[0]
    around = np.abs(f.s - PLACE) < 2.5 * width
    assert np.sum(f.mean[around, 2]) * width == pytest.approx(-9.81 * MASS, rel=0.6)
    assert len(clip.pose_loads) == 4


def test_a_coarse_mesh_is_refined_before_anything_is_looked_for():
    found = explain(scenes.case("t001"), elements=8)
    assert found.gates["elements"] > 8
    assert found.gates["mesh_error"] < found.settings.mesh_share * found.noise.total
    assert found.verdict == "no missing effect"


def test_a_plan_ranks_poses_that_were_not_scanned(clip):
    ranked = plan(clip)
    assert len(ranked.rivals) >= 2
    solved = [c for c in ranked.candidates if not c.note]
    assert len(solved) >= 8
    for c in solved:
        assert c.parameters > 0
        for pair, lead in c.settles.items():
            assert lead >= c.lead_now[pair] - 1e-6  # one more pose never reduces the lead
    worth = [round(c.worth, 1) for c in solved]
    assert worth == sorted(worth, reverse=True)
    assert solved[0].words in ranked.summary()
    least = {pair: max(c.settles[pair] for c in solved) for pair in solved[0].settles}
    assert set(ranked.alike) == {pair for pair, lead in least.items() if lead < clip.settings.tied}


def test_a_plan_says_which_rivals_no_pose_tells_apart(clip):
    """An effect beside itself: whatever the pose, neither leads."""
    [best, *_] = clip.singles
    twins = 2 * [(best.components[0], best.amplitudes(0))]
    ranked = ranked_poses(clip.decision.empty, twins, [(p.name, p) for p in clip.study.fit_poses[:2]])
    assert ranked.alike == ((best.kinds[0], best.kinds[0]),)
    assert f"no pose below tells {best.kinds[0]} from {best.kinds[0]}" in ranked.summary()


def test_an_explanation_continues_from_the_search_of_an_earlier_one(clip):
    """As another process does, from numbers alone: the same table, verdict and values."""
    said, record = [], json.loads(json.dumps(clip.record))
    study = scenes.case("t004", unseen=("p7",))
    again = explain(study, elements=ELEMENTS, mesh=False, record=record, progress=said.append)
    assert "hypotheses of an earlier search" in said and "search" not in said
    assert again.verdict == clip.verdict
    assert [h.kinds for h in again.hypotheses[:4]] == [h.kinds for h in clip.hypotheses[:4]]
    for h, old in zip(again.hypotheses[:4], clip.hypotheses[:4], strict=True):
        assert h.log_evidence == pytest.approx(old.log_evidence, abs=0.1)
    for name, e in again.estimates.items():
        assert e.value == pytest.approx(clip.estimates[name].value, rel=1e-4)
        assert e.std == pytest.approx(clip.estimates[name].std, rel=1e-2)
    assert plan(again).candidates[0].words == plan(clip).candidates[0].words


def test_a_record_of_another_study_is_not_used(clip, nothing):
    other = nothing.decision.empty.variant
    assert replayed(clip.record, other, silent) is None
    assert replayed({**clip.record, "elements": 41}, clip.decision.empty.variant, silent) is None
    assert replayed({"elements": ELEMENTS, "hypotheses": [{}], "scores": {}}, other, silent) is None


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


def test_a_lead_exceeds_its_standard_error_and_the_least_difference(clip):
    best, empty = clip.decision.best, clip.decision.empty
    d = best.elpd - empty.elpd
    difference, error = compared(best, empty)
    bounded = np.append(np.clip(d, -Settings().mistake, Settings().mistake), 0.0)
    assert (difference, error) == (pytest.approx(np.sum(bounded)), pytest.approx(np.sqrt(len(d) + 1) * np.std(bounded, ddof=1)))
    assert difference > 2 * error and leads(best, empty, 0.9 * difference) and not leads(best, empty, 1.1 * difference)
    assert not leads(empty, best, 1e-9) and compared(best, best) == (0.0, 0.0) and not leads(best, best, 1e-9)


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


def test_a_mistake_stands_unless_effects_lead_over_it(clip):
    mistake = Mistake("gravity points along another axis", "turn it", clip.study, before=40e-3, after=1e-3)
    best, empty = clip.decision.best, clip.decision.empty
    for as_good, stands in ((best, True), (empty, False)):
        decided = decide(search_of(clip), [(mistake, as_good)], False, nobody)
        assert decided.mistakes == ((mistake,) if stands else ())
        assert (decided.verdict == "unexplained") is stands


def test_the_probability_is_that_of_the_bounded_paired_differences(clip):
    """Of Student's t, with one more pose that says nothing."""
    alone = search_of(clip, "point_mass")
    (h,) = (h for h in clip.scored if h.kinds == ("point_mass",))
    bounded = np.append(np.clip(h.elpd - clip.decision.empty.elpd, -5.0, 5.0), 0.0)
    paired = stats.ttest_1samp(bounded, 0.0, alternative="greater").pvalue
    assert decide(alone, [], False, nobody).p_value == pytest.approx(paired, rel=1e-6)


UNSEEN = {"t001": "p5", "t004": "p7"}
ASIDE = np.array([0.03, -0.04, 0.05])  # m


def curve_aside(pose):
    return replace(pose, curve=MeasuredCurve(pose.curve.points + ASIDE))


def clamp_aside(pose):
    return replace(pose, end=Clamp(pose.end.position - ASIDE, pose.end.quaternion))


def changed(name, change):
    study = scenes.case(name, unseen=(UNSEEN[name],))
    return replace(study, poses=tuple(change(p) if p.role == "validate" else p for p in study.poses))


def test_a_validate_pose_that_is_predicted_surprises_nobody(clip):
    assert clip.surprised == {} and clip.believable
    assert clip.poses["p7"].role == "validate" and clip.poses["p7"].left_out is None


@pytest.mark.parametrize(("name", "change"), [("t004", clamp_aside), ("t001", curve_aside)])
def test_a_validate_pose_that_is_off_contradicts_the_answer(name, change, clip):
    found = explain(changed(name, change), elements=40, mesh=False)
    pose = UNSEEN[name]
    assert list(found.surprised) == [pose]
    assert found.surprised[pose] > found.settings.surprise
    assert found.verdict != "explained"
    assert not found.believable and found.answer.tone == "bad"
    assert f"{pose}, which was not fitted," in found.answer.belief
    assert all(e.low is None and e.high is None for e in found.estimates.values())
    assert set(found.to_json()["contradicted_by"]) == {pose}
    if name == "t004":  # and it had no part in the scores
        assert [h.log_evidence for h in found.hypotheses] == pytest.approx([h.log_evidence for h in clip.hypotheses], abs=1e-6)
