"""Choice between refits: likelihood, leave-one-pose-out error, and simplicity.

The likelihood depends on the assumed covariance of the discrepancy. Between an effect and a wider one that contains it, the
leave-one-pose-out error therefore decides: the simpler one is kept unless the wider one has a smaller error.
"""

import functools
from collections.abc import Iterable

import numpy as np

from scan2flex_jax.diagnosis import confirm, floors
from scan2flex_jax.diagnosis.refit import Refit
from scan2flex_jax.diagnosis.search import alike, pieces
from scan2flex_jax.diagnosis.sensitivity import Component


def best_of(stage, refits: Iterable[Refit], count: int) -> Refit:
    """The likeliest refit of ``count`` effects, or one about as likely that predicts poses left out better or is simpler.

    Refits nearer to the curves than the baseline model come first, and of these the ones with sizes homogeneous across poses.
    Without any refit, the baseline model.
    """
    own = [r for r in refits if len(r.components) == count and np.isfinite(r.log_evidence)]
    own = [r for r in own if nearer(stage, r, stage.base)] or own
    own = [r for r in own if of_one_size(stage, r) and not pieces(r)] or own
    if not own:
        return stage.base
    order = sorted(own, key=lambda r: -r.log_evidence)
    best, most = order[0], order[0].log_evidence
    for other in (r for r in order[1:] if r.log_evidence > most - stage.settings.lead_named):
        against = confirm.compared(stage, other, best)
        simpler = size(other) < size(best) and other.log_evidence > best.log_evidence - stage.settings.lead_favoured
        if (against.better and not contains(other, best)) or (simpler and not against.worse):
            best = other
    if stage.bench.poses.count < stage.settings.telling_poses:
        return best
    for other in order:
        if contains(best, other) and not confirm.compared(stage, best, other).better:
            best = other
    return best


def contains(wider: Refit, simpler: Refit) -> bool:
    """Whether two sets differ in one effect, that of ``wider`` with more parameters and the shapes of that of ``simpler``."""
    more, less = set(wider.kinds) - set(simpler.kinds), set(simpler.kinds) - set(wider.kinds)
    if len(more) != 1 or len(less) != 1 or size(wider) <= size(simpler):
        return False
    return alike(more.pop(), less.pop())


def size(r: Refit) -> int:
    """Number of effect parameters of a refit; a field has more than any other effect type."""
    return sum(numbers_of(c) for c in r.components)


def numbers_of(component: Component) -> int:
    """Number of parameters of an effect that a refit estimates."""
    return len(component.entry.amplitudes) + len(component.moving)


def of_one_size(stage, r: Refit) -> bool:
    """Whether each estimated size of a refit is homogeneous across poses."""
    sizes = (confirm.scatter(stage, r, k) for k in range(len(r.components)))
    return all(s is None or s <= stage.settings.most_scatter for s in sizes)


def predicts(stage, best: Refit, baseline: Refit) -> bool:
    """Whether poses left out are predicted much better by one refit than by another."""
    against = confirm.compared(stage, best, baseline)
    return against.better and against.ratio <= stage.settings.most_left


def established(stage, best: Refit, baseline: Refit) -> bool:
    """Whether effects of one size in all poses are found: they come nearer to the curves, and poses left out are predicted much
    better, or the evidence is overwhelming and they are predicted no worse."""
    settings, against = stage.settings, confirm.compared(stage, best, baseline)
    overwhelming = best.log_evidence > settings.overwhelming and not against.worse
    certain = best.log_evidence >= settings.lead_named and (predicts(stage, best, baseline) or overwhelming)
    return certain and nearer(stage, best, baseline) and of_one_size(stage, best)


def fewer_are_likelier(stage, tied: Iterable[Refit], refits: Iterable[Refit]) -> bool:
    """Whether of each model that is tied at the sensor's noise some of the effects, or none, are likelier with a discrepancy of
    each pose than all of them: effects that are not there may bring the residual to noise in the place of a discrepancy.

    A single effect must be outdone by as much as a name needs, and so must a set that predicts poses left out much better; any
    other set, chosen among hundreds, must be the likelier one itself.
    """
    if stage.bench.poses.count < 2:
        return False
    kept = [stage.base, *refits]

    @functools.cache
    def likelihood(r):
        return floors.own_floor(stage.of, r, stage.noise).log_marginal

    def least(r, best):
        telling = len(best.kinds) == 1 or predicts(stage, best, r)
        return stage.settings.lead_named if telling else 0.0

    def outdone(best):
        fewer = sorted((r for r in kept if set(r.kinds) < set(best.kinds)), key=lambda r: -len(r.kinds))
        leads = ((r, likelihood(r) - likelihood(best)) for r in fewer)
        return any(lead > 0.0 and lead > least(r, best) for r, lead in leads)  # predictions only of those that are likelier

    return all(outdone(r) for r in tied)


def nearer(stage, r: Refit, baseline: Refit) -> bool:
    """Whether the shapes of a refit are nearer to the curves than those of the baseline model: under a large discrepancy of
    each pose, shapes that are farther off may be likelier."""
    return floors.squares(stage.of, confirm.reported(stage, r)) < floors.squares(stage.of, baseline)
