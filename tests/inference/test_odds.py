"""Prior odds of effect types: one table, complete, in the price of a hypothesis."""

import numpy as np

from scan2flex_jax.effects.catalogue import catalogue, entry_of
from scan2flex_jax.inference.posterior import price
from scan2flex_jax.inference.search import contained
from scan2flex_jax.inference.settings import ODDS, USUAL
from tests.effects.scene import CONTEXT


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
