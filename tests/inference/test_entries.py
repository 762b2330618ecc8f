"""Entries of the catalogue in the search: one complete table of prior odds, and where moment laws start from."""

import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax.effects.catalogue import catalogue, entry_of
from scan2flex_jax.effects.moment_law import tangent
from scan2flex_jax.posterior.posterior import price
from scan2flex_jax.posterior.search import contained
from scan2flex_jax.posterior.settings import ODDS, USUAL
from tests.effects.scene import CONTEXT

STIFFNESS = jnp.diag(jnp.array([1e5, 1e5, 1e4, 0.02, 0.02, 0.015]))
SLIP, RATIO = 2.0, 0.3


def test_every_effect_type_that_is_searched_for_has_its_odds():
    assert set(ODDS) == {entry.kind for entry in catalogue()}
    assert all(0 < odds <= 1 for odds in ODDS.values())


def test_a_tether_costs_more_than_a_bend_by_its_odds_alone():
    tether, bend = (price(entry_of(kind), CONTEXT, USUAL) for kind in ("tether", "natural_curvature"))
    places = len({str({k: v for k, v in s.items() if k != "position"}) for s in entry_of("tether").sites(CONTEXT)})
    np.testing.assert_allclose(tether - bend - np.log(places), np.log(1.0 / ODDS["tether"]))


def test_a_field_is_no_partner_of_what_it_contains():
    assert contained("stiffness_field", ("stiffness_taper",))
    assert contained("stiffness_profile", ("kink", "stiffness_field"))
    assert not contained("stiffness_taper", ("stiffness_profile",))
    assert not contained("stiffness_field", ("natural_curvature",))


def test_a_law_begins_as_stiff_as_the_effects_of_another_refit():
    soft = entry_of("nonlinear_bending").build(jnp.array([1.0 - RATIO]), {"slip_curvature": SLIP}, CONTEXT)
    entry, site = entry_of("bending_law"), {"most": 8.0}
    at = jnp.linspace(1.0, 8.0, 8)
    found = tangent(at, at, jnp.exp(jnp.cumsum(jnp.asarray(entry.like(soft, STIFFNESS, site)))))
    np.testing.assert_allclose(found, RATIO + (1 - RATIO) * (1 + (at / SLIP) ** 2) ** -1.5, rtol=1e-4)
    np.testing.assert_allclose(entry_of("torsion_law").like(soft, STIFFNESS, site), np.zeros(8), atol=1e-12)


def test_a_law_that_another_effect_lets_fall_begins_nearly_flat():
    """At a ratio below zero the moment falls: a law cannot, and begins with a slope of a thousandth."""
    falling = entry_of("nonlinear_bending").build(jnp.array([1.5]), {"slip_curvature": SLIP}, CONTEXT)
    steps = entry_of("bending_law").like(falling, STIFFNESS, {"most": 8.0})
    assert np.all(np.isfinite(steps))
    assert np.exp(np.sum(steps)) == pytest.approx(1e-3, rel=1e-3)
