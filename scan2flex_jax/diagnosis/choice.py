"""Which of several refits stands: likelihood, poses left out, and simplicity.

The likelihood rests on the assumed law of the discrepancy. Between an effect and a wider one that contains it, poses left out
therefore decide, whatever the likelihoods: the simpler one stands unless the wider one predicts them better.
"""

from collections.abc import Iterable

import numpy as np

from scan2flex_jax.diagnosis import confirm
from scan2flex_jax.diagnosis.refit import Refit
from scan2flex_jax.diagnosis.search import alike, pieces
from scan2flex_jax.diagnosis.sensitivity import Component

_TELLING = 3  # poses from which on those left out say which of two effects to keep


def best_of(stage, refits: Iterable[Refit], count: int) -> Refit:
    """The likeliest refit of ``count`` effects, or one as likely that predicts poses left out better, or a simpler one.

    Of those whose sizes are the same in all poses, where there are any; without any refit the baseline model.
    """
    own = [r for r in refits if len(r.components) == count and np.isfinite(r.log_evidence)]
    own = [r for r in own if of_one_size(stage, r) and not pieces(r)] or own
    if not own:
        return stage.base
    order = sorted(own, key=lambda r: -r.log_evidence)
    best, most = order[0], order[0].log_evidence
    for other in (r for r in order[1:] if r.log_evidence > most - stage.settings.lead_named):
        said = confirm.compared(stage, other, best)
        simpler = size(other) < size(best) and other.log_evidence > best.log_evidence - stage.settings.lead_favoured
        if (said.better and not contains(other, best)) or (simpler and not said.worse):
            best = other
    if stage.bench.poses.count < _TELLING:
        return best
    for other in order:
        if contains(best, other) and not confirm.compared(stage, best, other).better:
            best = other
    return best


def contains(wider: Refit, simpler: Refit) -> bool:
    """Whether one effect of a set is a wider one that gives the shapes of an effect of another set, all others alike."""
    more, less = set(wider.kinds) - set(simpler.kinds), set(simpler.kinds) - set(wider.kinds)
    if len(more) != 1 or len(less) != 1 or size(wider) <= size(simpler):
        return False
    return alike(more.pop(), less.pop())


def size(r: Refit) -> int:
    """How many numbers the effects of a refit have; a field counts as more than any kind."""
    return sum(numbers_of(c) for c in r.components)


def numbers_of(component: Component) -> int:
    """How many numbers of an effect a refit moves."""
    return len(component.entry.amplitudes) + len(component.moving)


def of_one_size(stage, r: Refit) -> bool:
    """Whether each effect of a refit has one size in all poses, as far as sizes are estimated."""
    sizes = (confirm.scatter(stage, r, k) for k in range(len(r.components)))
    return all(s is None or s <= stage.settings.most_scatter for s in sizes)
