"""Rules of the search that need no rod."""

from importlib import import_module

import numpy as np

from scan2flex_jax.diagnosis.refit import Refit
from scan2flex_jax.diagnosis.sensitivity import Component

search = import_module("scan2flex_jax.diagnosis.search")


def refit(log_evidence, *kinds):
    components, nothing = tuple(Component(kind, {}) for kind in kinds), np.zeros(0)
    return Refit(
        components=components, vector=nothing, shapes=[], cost=0.0, chi2=0.0, log_marginal=0.0, covariance=nothing,
        converged=True, log_evidence=log_evidence,
    )  # fmt: skip


def test_a_set_with_an_effect_too_many_gives_way_to_the_rest():
    """A second effect of no size may gain a nat by chance: it is no part of a tie, and no rival."""
    alone, more, other, pair = refit(159.2, "a"), refit(159.9, "b", "a"), refit(150.0, "b"), refit(170.0, "c", "a")
    assert search._needed([alone, more, other]) == [alone, other]
    assert search._needed([other, more]) == [other, more]  # nine nats: of this part it is needed
    assert search._needed([alone, pair]) == [alone, pair]
