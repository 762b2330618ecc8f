"""Moment laws compete last, where they can matter, and by the rules of all other effects."""

from dataclasses import replace
from types import SimpleNamespace

import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax.diagnosis import moment_laws, verdict
from scan2flex_jax.diagnosis.search import Found
from scan2flex_jax.diagnosis.settings import USUAL
from scan2flex_jax.diagnosis.slots import empty_slots
from scan2flex_jax.effects.catalogue import catalogue, entry_of, fields, laws
from scan2flex_jax.effects.moment_law import tangent
from tests.effects import scene

from .test_kinds import refitted

STIFFNESS = jnp.diag(jnp.array([1e5, 1e5, 1e4, 0.02, 0.02, 0.015]))
SLIP, RATIO = 2.0, 0.3


def test_no_state_of_a_study_has_room_for_a_law_before_it_is_tried():
    kinds = {entry.kind for entry in laws()}
    assert kinds == {"bending_law", "torsion_law"}
    assert not kinds & {entry.kind for entry in (*catalogue(), *fields())}
    assert not kinds & set(empty_slots(scene.CONTEXT))


def test_a_law_begins_as_stiff_as_the_effects_of_another_refit():
    soft = entry_of("nonlinear_bending").build(jnp.array([1.0 - RATIO]), {"slip_curvature": SLIP}, scene.CONTEXT)
    entry, site = entry_of("bending_law"), {"most": 8.0}
    at = jnp.linspace(1.0, 8.0, 8)
    found = tangent(at, at, jnp.exp(jnp.cumsum(jnp.asarray(entry.like(soft, STIFFNESS, site)))))
    np.testing.assert_allclose(found, RATIO + (1 - RATIO) * (1 + (at / SLIP) ** 2) ** -1.5, rtol=1e-4)
    np.testing.assert_allclose(entry_of("torsion_law").like(soft, STIFFNESS, site), np.zeros(8), atol=1e-12)


def test_a_law_that_another_effect_lets_fall_begins_nearly_flat():
    """At a ratio below zero the moment falls: a law cannot, and begins with a slope of a thousandth."""
    falling = entry_of("nonlinear_bending").build(jnp.array([1.5]), {"slip_curvature": SLIP}, scene.CONTEXT)
    steps = entry_of("bending_law").like(falling, STIFFNESS, {"most": 8.0})
    assert np.all(np.isfinite(steps))
    assert np.exp(np.sum(steps)) == pytest.approx(1e-3, rel=1e-3)


def ended(said, *tied, floor=None, poses=4):
    """A search that ended with this verdict and these tied kinds."""
    found = Found.__new__(Found)
    found.stage = SimpleNamespace(bench=SimpleNamespace(poses=SimpleNamespace(count=poses)))
    found.verdict, found.tied, found.floor, found.refits = said, [refitted(kind) for kind in tied], floor, {}
    return found


@pytest.mark.parametrize(
    "found",
    [
        ended(verdict.NONE),
        ended(verdict.EXPLAINED, "nonlinear_bending"),
        ended(verdict.TIE, "kink", "natural_curvature"),
        ended(verdict.UNEXPLAINED, floor=object(), poses=1),
    ],
)
def test_a_complete_answer_and_a_single_pose_are_left_as_they_are(found):
    assert moment_laws.search_on(found, print) is found


@pytest.mark.parametrize(
    "found",
    [
        ended(verdict.PARTLY, "kink", floor=object()),
        ended(verdict.UNEXPLAINED, "kink", floor=object()),
        ended(verdict.TIE, "kink", "nonlinear_bending"),
    ],
)
def test_what_is_left_and_what_a_law_could_be_behind_is_tried(found, monkeypatch):
    tried = []
    monkeypatch.setattr(moment_laws, "_undeclared", lambda found: tried.append(found) or [])
    assert moment_laws.search_on(found, print) is found
    assert tried == [found]


@pytest.mark.parametrize(
    ("others", "tried"),
    [
        ({"kink": 3.0, "tether": 1.0}, ["natural_curvature", "kink"]),
        ({"kink": -USUAL.lead_named - 0.1}, ["natural_curvature"]),
        ({}, ["natural_curvature"]),
    ],
)
def test_a_law_is_tried_beside_the_likeliest_other_set_if_it_is_about_as_likely(others, tried):
    found = ended(verdict.PARTLY, "natural_curvature", floor=object())
    found.stage.settings, (found.best,) = USUAL, found.tied
    found.refits = {frozenset(r.kinds): r for r in (found.best, replace(refitted("kink", "point_mass"), log_evidence=20.0))}
    found.refits |= {frozenset([k]): replace(refitted(k), log_evidence=lead) for k, lead in others.items()}
    assert [k for r in moment_laws._sets(found) for k in r.kinds] == tried
