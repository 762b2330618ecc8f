"""Which of several models stands where poses differ each in its own way (`diagnosis.choice`)."""

from types import SimpleNamespace

import numpy as np
import pytest

from scan2flex_jax.diagnosis import confirm, floors, partial, score, search, sentences
from scan2flex_jax.diagnosis.choice import best_of, established, fewer_are_likelier
from scan2flex_jax.diagnosis.confirm import Comparison
from scan2flex_jax.diagnosis.refit import Refit
from scan2flex_jax.diagnosis.residual import Law
from scan2flex_jax.diagnosis.sensitivity import Component
from scan2flex_jax.diagnosis.settings import USUAL
from scan2flex_jax.diagnosis.stage import Stage
from scan2flex_jax.fitting.noise import Noise

ERRORS = {  # mm, of four poses left out in turn
    "equal": (10.0, 10.0, 10.0, 10.0), "half": (5.0, 5.0, 5.0, 5.0),
    "one pose": (0.1, 10.0, 10.0, 10.0), "lost again": (4.0, 4.0, 16.0, 16.0), "double": (20.0, 20.0, 20.0, 20.0),
}  # fmt: skip


def model(*kinds, nats, errors="equal", scatter=0.0, off=1.0):
    places = {"kink": {"position": 0.3, "width": 0.01}, "point_mass": {"position": 0.3}, "point_load": {"position": 0.3},
              "density_profile": {"position": 0.3, "width": 0.05}}  # fmt: skip
    components = tuple(Component(kind, places.get(kind, {})) for kind in kinds)
    found = Refit(
        components=components, vector=np.zeros(0), shapes=[], cost=0.0, chi2=0.0, log_marginal=nats, log_evidence=nats,
        covariance=np.zeros((0, 0)), converged=True, law=Law(Noise(1.0, 1.0, 1.0)),
    )  # fmt: skip
    found.errors, found.scatter, found.off = ERRORS[errors], scatter, off
    return found


@pytest.fixture
def stage(monkeypatch):
    """One at which the errors of models in poses left out are given."""
    monkeypatch.setattr(confirm, "left_out", lambda stage, r: 1e-3 * np.array(r.errors))
    monkeypatch.setattr(confirm, "scatter", lambda stage, r, k: r.scatter)
    monkeypatch.setattr(floors, "squares", lambda of, r: r.off)
    bench = SimpleNamespace(poses=SimpleNamespace(count=4))
    return SimpleNamespace(base=model(nats=0.0, off=2.0), bench=bench, settings=USUAL, of=None)


@pytest.fixture
def best(stage):
    """`best_of` among models."""

    def choose(*models):
        return best_of(stage, models, len(models[0].kinds)).kinds

    return choose


def test_the_likeliest_stands_where_poses_left_out_do_not_tell(best):
    assert best(model("point_load", nats=50.0), model("anisotropic_bending", nats=44.0)) == ("point_load",)


def test_one_as_likely_that_predicts_better_stands(best):
    assert best(model("anisotropic_bending", nats=50.0), model("uniform_load", nats=46.0, errors="half")) == ("uniform_load",)


def test_a_simpler_effect_stands_however_likely_a_wider_one_is(best):
    """A force contains a mass, and its sideways part may gain any number of nats."""
    assert best(model("point_load", nats=400.0), model("point_mass", nats=50.0)) == ("point_mass",)


def test_a_wider_effect_stands_where_it_predicts_better(best):
    assert best(model("point_load", nats=60.0, errors="half"), model("point_mass", nats=50.0)) == ("point_load",)
    assert best(model("point_load", nats=60.0, errors="lost again"), model("point_mass", nats=50.0)) == ("point_mass",)


def test_in_sets_too(best):
    wide = model("nonlinear_bending", "kink", nats=60.0)
    assert best(wide, model("nonlinear_bending", "natural_curvature", nats=30.0)) == ("nonlinear_bending", "natural_curvature")
    assert best(wide, model("uniform_load", "natural_curvature", nats=30.0)) == wide.kinds


def test_sets_whose_sizes_differ_between_poses_stand_back(best):
    assert best(model("uniform_load", nats=50.0, scatter=0.9), model("point_mass", nats=30.0)) == ("point_mass",)
    assert best(model("uniform_load", nats=50.0, scatter=0.9)) == ("uniform_load",)  # and are told why they are not named


def test_two_that_make_one_property_vary_are_pieces_of_a_field(best):
    pieces, whole = model("point_mass", "density_taper", nats=50.0), model("point_mass", "uniform_load", nats=30.0)
    assert best(pieces, whole) == whole.kinds


def test_a_wider_effect_ties_only_where_it_is_likelier(stage):
    """A heavy span contains a mass: the mass is kept, and is tied with the span if the shapes favour the span."""

    def rivals(nats):
        mass, span = model("point_mass", nats=50.0), model("density_profile", nats=nats)
        refits = {frozenset(r.kinds): r for r in (mass, span)}
        return [r.kinds for r in partial._rivals(SimpleNamespace(best=mass, refits=refits, stage=stage))]

    assert rivals(49.0) == rivals(52.0) == []
    assert rivals(54.0) == [("density_profile",)]


@pytest.mark.parametrize(("errors", "better"), [("half", True), ("one pose", False), ("lost again", False), ("equal", False)])
def test_better_needs_most_poses_and_the_whole(errors, better):
    """One pose alone does not decide, nor a gain in poses of small error that is lost in those of large error."""
    a, b = np.array(ERRORS[errors]), np.array(ERRORS["equal"])
    logs = np.log(b / a)
    said = Comparison(float(np.mean(logs)), float(np.std(logs, ddof=1) / 2), float(np.sqrt(np.sum(a**2) / np.sum(b**2))))
    assert said.better is better
    assert Comparison(-said.gain, said.std, 1.0 / said.ratio).worse is better


@pytest.mark.parametrize(
    ("nats", "errors", "scatter", "found"),
    [
        (20.0, "half", 0.0, True), (20.0, "equal", 0.0, False), (20.0, "one pose", 0.0, False),
        (3.0, "half", 0.0, False), (20.0, "half", 0.9, False),
        (60.0, "equal", 0.0, True), (60.0, "one pose", 0.0, True), (60.0, "double", 0.0, False), (60.0, "equal", 0.9, False),
    ],
)  # fmt: skip
def test_an_effect_is_found_by_poses_left_out_or_by_overwhelming_evidence(stage, nats, errors, scatter, found):
    """Few poses, or poses of which one alone shows the effect, hardly predict one another, whatever the evidence."""
    assert established(stage, model("point_mass", nats=nats, errors=errors, scatter=scatter), stage.base) is found


def test_an_effect_whose_shapes_are_farther_off_is_not_found(stage):
    """A field that left 30 of 11 mm had been likelier by 76 nats, under a discrepancy three times as large, and was named."""
    assert not established(stage, model("point_mass", nats=76.0, errors="half", off=2.1), stage.base)
    assert established(stage, model("point_mass", nats=76.0, errors="half", off=1.9), stage.base)


def test_a_likelier_effect_whose_shapes_are_farther_off_does_not_stand(best):
    """On two photographs a curvature profile that left 10 of 6 mm was likelier by 13 nats than a law that left 3 mm."""
    assert best(model("point_load", nats=90.0, off=2.1), model("kink", nats=77.0)) == ("kink",)
    assert best(model("point_load", nats=90.0, off=2.1)) == ("point_load",)


@pytest.mark.parametrize(
    ("alone", "nothing", "stands"), [(40.0, -100.0, True), (49.0, 49.0, True), (51.0, -100.0, False), (40.0, 51.0, False)],
)  # fmt: skip
def test_further_effects_do_not_take_the_place_of_a_discrepancy(stage, monkeypatch, alone, nothing, stands):
    """A tether and a clamp's turn beside a wrong scale brought the residual to the sensor's noise; the scale alone was likelier
    by 8 nats, with the discrepancy that each pose truly had."""
    monkeypatch.setattr(floors, "own_floor", lambda of, r, noise: r)
    stage.noise, stage.base.log_marginal = None, nothing
    best, other = model("scan_scale", "tether", nats=50.0), model("kink", nats=90.0)
    refits = [best, other, model("scan_scale", nats=alone)]
    assert fewer_are_likelier(stage, [best], refits) is not stands
    assert fewer_are_likelier(stage, [best, other], refits) is False  # the other one of a tie stands
    stage.bench.poses.count = 1  # in a single pose, discrepancy and effect are the same
    assert not fewer_are_likelier(stage, [best], [model("scan_scale", nats=90.0)])


@pytest.mark.parametrize(("nothing", "stands"), [(54.0, True), (56.0, False)])
def test_a_discrepancy_takes_the_place_of_a_single_effect_with_the_lead_of_a_name(stage, monkeypatch, nothing, stands):
    """Different stiffness in two directions was two nats less likely than a discrepancy of each pose, and "unexplained"."""
    monkeypatch.setattr(floors, "own_floor", lambda of, r, noise: r)
    stage.noise, stage.base.log_marginal = None, nothing
    best = model("anisotropic_bending", nats=50.0)
    assert fewer_are_likelier(stage, [best], [best]) is not stands


@pytest.mark.parametrize(("nothing", "errors", "stands"), [(54.0, "half", True), (56.0, "half", False), (51.0, "equal", False)])
def test_a_set_that_predicts_poses_left_out_stands_against_a_discrepancy_that_is_hardly_likelier(
    stage, monkeypatch, nothing, errors, stands
):
    """A discrepancy predicts no pose: what two effects say of poses left out decides where likelihoods are about equal."""
    monkeypatch.setattr(floors, "own_floor", lambda of, r, noise: r)
    stage.noise, stage.base.log_marginal = None, nothing
    best = model("anisotropic_bending", "kink", nats=50.0, errors=errors)
    assert fewer_are_likelier(stage, [best], [best]) is not stands


def refits_made(monkeypatch, *models):
    """The effect types that `partial._add_alike` refits, with their places."""
    made = []

    def refit_from(found, components, near, begin):
        made.append((components[0].kind, components[0].site["position"], near.kinds))
        return model(components[0].kind, nats=0.0)

    monkeypatch.setattr(partial, "refit_from", refit_from)
    components = [Component("density_profile", {"position": x, "width": 0.1}) for x in (0.2, 0.58, 0.9)]
    scores = SimpleNamespace(components=components, values=np.zeros(3), amplitudes=[np.ones(1)] * 3)
    stage = SimpleNamespace(bench=SimpleNamespace(context=SimpleNamespace(length=1.0)))
    singles, kept = sorted(models, key=lambda r: -r.log_evidence), []
    found = SimpleNamespace(
        singles=singles, table={"density_profile": (0.0, 0), "tether": (0.0, 0), "point_mass": (0.0, 0)}, stage=stage,
        refits={frozenset(r.kinds): r for r in models}, add=kept.extend,
    )  # fmt: skip
    partial._add_alike(found, scores, lambda said: None)
    assert len(kept) == len(made)
    return made


def at(found, place):
    """A model whose effect is at another place."""
    found.components[0].site["position"] = place
    return found


def test_effects_alike_are_refitted_at_the_place_of_the_likeliest(monkeypatch):
    """The refit of a heavy span of 5 times the density had started, and stayed, at the other end of the cable, and a point mass
    was named at the span's place."""
    mass, span = at(model("point_mass", nats=50.0), 0.6), model("density_profile", nats=20.0)
    assert refits_made(monkeypatch, mass, at(span, 0.2)) == [("density_profile", 0.58, ("point_mass",))]
    assert refits_made(monkeypatch, mass) == [("density_profile", 0.58, ("point_mass",))]  # not refitted before
    assert refits_made(monkeypatch, mass, at(span, 0.55)) == []
    assert refits_made(monkeypatch, model("anisotropic_bending", nats=50.0)) == []


def searched(best, *minima):
    """A search whose best model is at one of its minima along a cable of 2 m."""
    stage, test = object.__new__(Stage), object.__new__(score.Test)
    stage.bench, stage.of = SimpleNamespace(context=SimpleNamespace(length=2.0)), SimpleNamespace(settings=USUAL)
    return search.Found(stage, test, np.zeros(0), [], {}, best, minima=[best, *minima])


def test_an_effect_that_is_as_likely_elsewhere_is_said_to_be():
    """A light span at 0.55 m gave the shapes of a heavy one at 1.4 m on a cable five times as stiff, with a narrow interval."""
    light, heavy = at(model("density_profile", nats=66.4), 0.55), at(model("density_profile", nats=66.3), 1.4)
    same, near = at(model("density_profile", nats=66.4), 0.56), at(model("density_profile", nats=66.0), 1.5)
    unlikely = at(model("density_profile", nats=50.0), 1.0)
    found = searched(light, same, near, heavy, unlikely)
    assert search.minima_elsewhere(found) == [heavy]
    assert sentences._elsewhere(found) == ("density_profile at 1.4 m is about as likely: the intervals include it",)
    assert sentences._elsewhere(searched(light, same)) == ()
    assert search.minima_elsewhere(searched(model("anisotropic_bending", nats=50.0))) == []
    assert search.minima_elsewhere(searched(model("kink", "point_mass", nats=50.0))) == []


def test_the_likeliest_effect_is_refitted_from_its_one_step_estimate_and_from_other_places(monkeypatch):
    begun = []

    def refit_from(found, components, near, begin):
        place = components[0].site["position"]
        begun.append((place, near))
        return at(model("point_mass", nats=60.0 if place > 0.7 else -np.inf), place)

    monkeypatch.setattr(partial, "refit_from", refit_from)
    components = [Component("point_mass", {"position": x}) for x in np.linspace(0.05, 0.95, 19)]
    scores = SimpleNamespace(components=components, amplitudes=[np.ones(1)] * 19)
    first, base, kept = at(model("point_mass", nats=50.0), 0.5), model(nats=0.0), []
    stage = SimpleNamespace(bench=SimpleNamespace(context=SimpleNamespace(length=1.0)), base=base)
    found = SimpleNamespace(singles=[first], stage=stage, minima=[], add=kept.extend)
    before, table = SimpleNamespace(refits={frozenset(["point_mass"]): first}), {"point_mass": (4.0, 5)}  # at 0.3
    partial._add_elsewhere(found, before, scores, table, lambda said: None)
    assert [near for _, near in begun] == [base, base, base]
    np.testing.assert_allclose([x for x, _ in begun], [0.3, 0.15, 0.85])
    assert [r.log_evidence for r in found.minima] == [50.0, 60.0] and kept == found.minima
    partial._add_elsewhere(found, before, scores, table, lambda said: None)
    assert len(begun) == 3  # once
    begun.clear()
    found.minima, before.refits = [], {}  # it was refitted from there already
    partial._add_elsewhere(found, before, scores, table, lambda said: None)
    np.testing.assert_allclose([x for x, _ in begun], [0.15, 0.85])
