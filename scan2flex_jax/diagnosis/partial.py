"""The search where no effect brings the residual down to the sensor's noise: found, though not complete.

Each model is compared with its own floor (`floors`), and a simpler one stands unless a wider one predicts poses left out
better. A set of effects is *found* when it removes much of the error in poses left out in turn, by more than the uncertainty of
that comparison, and has one size in all of them. A field along the cable (`effects.catalogue.fields`) competes with the other
effect types: where it predicts poses that had no part in it, it is physics.
"""

from dataclasses import replace

import numpy as np

from scan2flex_jax.diagnosis import confirm, floors, verdict
from scan2flex_jax.diagnosis.refit import Refit, refit
from scan2flex_jax.diagnosis.search import Found, outside, pieces, same_shapes
from scan2flex_jax.diagnosis.sensitivity import Component, Numbers
from scan2flex_jax.diagnosis.stage import test_after
from scan2flex_jax.effects.catalogue import entry_of, fields
from scan2flex_jax.fitting.least_squares import Progress

SINGLES, WIDER, BESIDE = 5, 3, 3  # refits of single kinds and of sets that are taken over, and of each round
_WORTH = 25.0  # nats of one step behind the best kind beyond which a refit cannot catch up
_MOST, _STEPS = 3, 20  # effects, and steps of a refit


def search(before: Found, progress: Progress) -> Found:
    """The search on from one at the sensor's noise that left structure; its test of the baseline model stands."""
    stage = before.stage
    base = floors.own_floor(stage.of, stage.base, stage.noise)
    found = replace(before, floor=base, best=stage.base, refits={}, tied=[stage.base])
    singles = [r for r in before.singles if np.isfinite(r.log_evidence)]
    sets = sorted((r for r in before.refits.values() if len(r.kinds) > 1), key=lambda r: -r.log_evidence)
    for r in (*singles[:SINGLES], *sets[:WIDER]):
        progress(f"{' and '.join(r.kinds)} against its own floor")
        found.add([floors.own_floor(stage.of, r, stage.noise).over(base, stage.bench.context)])
    scores = floors.scores(stage.of, base)
    table = scores.table(stage.components)
    found.table = table
    order = sorted(table, key=lambda k: -table[k][0])[:SINGLES]
    for kind in (k for k in order if frozenset([k]) not in found.refits and table[k][0] > table[order[0]][0] - _WORTH):
        progress(f"refit with {kind}")
        found.add([_refitted(found, stage.base, scores, table[kind][1])])
    for entry in fields():
        progress(f"refit with {entry.kind}")
        found.add([_field(found, entry)])
    found.best = _best(found, 1)
    most = min(_MOST, (stage.bench.poses.count + 1) // 2)
    while found.best.components and len(found.best.components) < most:
        wider = _wider(found, progress)
        if wider is None:
            break
        found.best = wider
    return _judged(found)


def _refitted(found, near: Refit, scores, g) -> Refit:
    """One component more beside a refit, from its one-step amplitude, then at its own floor."""
    stage, numbers = found.stage, Numbers(found.stage.bench, near.components)
    held = [near.amplitudes(stage.bench, k) for k in range(len(near.components))]
    components = [*near.components, stage.components[g]]
    end = refit(stage.bench, components, stage.law, near.vector[: numbers.base], [*held, scores.amplitudes[g]], most=_STEPS)
    return floors.own_floor(stage.of, end, stage.noise).over(found.floor, stage.bench.context)


def _field(found, entry) -> Refit:
    """A field along the cable, refitted from nothing."""
    stage = found.stage
    end = refit(stage.bench, [Component(entry.kind, {})], stage.law, stage.base.vector, [entry.null])
    return floors.own_floor(stage.of, end, stage.noise).over(found.floor, stage.bench.context)


def _best(found, count) -> Refit:
    """The likeliest refit of ``count`` effects, or a simpler or better predicting one that is as likely."""
    own = [r for r in found.refits.values() if len(r.components) == count and np.isfinite(r.log_evidence)]
    if not own:
        return found.stage.base
    best = max(own, key=lambda r: r.log_evidence)
    near = [r for r in own if r.log_evidence > best.log_evidence - verdict.LEAD_NAMED and r is not best]
    for other in sorted(near, key=lambda r: -r.log_evidence):
        said = confirm.compared(found.stage, other, best)
        simpler = size(other) < size(best) and other.log_evidence > best.log_evidence - verdict.LEAD_FAVOURED
        if said.better or (simpler and not said.worse):
            best = other
    return best


def size(r: Refit) -> int:
    """How many numbers the effects of a refit have; a field counts as more than any kind."""
    return sum(len(c.entry.amplitudes) + len(c.moving) for c in r.components)


def _wider(found, progress) -> Refit | None:
    """The best set with one effect more, where it leads and predicts poses left out better; None where there is none."""
    stage, best = found.stage, found.best
    scores = floors.scores(stage.of, best)
    table = scores.table(stage.components, skip=best.kinds)
    order = sorted(table, key=lambda k: -table[k][0])[:BESIDE]
    for kind in (k for k in order if table[k][0] > verdict.LEAD_FAVOURED):
        progress(f"refit with {' and '.join(best.kinds)} and {kind}")
        found.add([_refitted(found, best, scores, table[kind][1])])
    wider = _best(found, len(best.components) + 1)
    if wider is stage.base or wider.log_evidence < best.log_evidence + verdict.LEAD_NAMED:
        return None
    said = confirm.compared(stage, wider, best)
    return wider if said.better and said.ratio < verdict.MUCH else None


def _judged(found: Found) -> Found:
    """Ties, the two questions (found? complete?) and the verdict."""
    stage, best = found.stage, found.best
    found.tied, found.lead, found.verdict = [best], verdict.TOO_LITTLE, verdict.UNEXPLAINED
    if not best.components:
        return found
    found.unseen, found.constancy = confirm.unseen(stage, best), None
    found.after = test_after(stage, best)
    found.scatter = {c.kind: confirm.scatter(stage, best, k) for k, c in enumerate(best.components)}
    said = confirm.compared(stage, best, stage.base)
    varies = any(s is not None and s > verdict.ONE_SIZE for s in found.scatter.values())
    if best.log_evidence < verdict.LEAD_NAMED or not said.better or said.ratio > verdict.MUCH or varies or pieces(best):
        return found
    found.tied = [best, *_rivals(found)]
    other = [r for r in found.refits.values() if not (set(r.kinds) <= set(best.kinds) or set(best.kinds) <= set(r.kinds))]
    leads = [r.log_evidence for r in other]
    lead = best.log_evidence - max(leads, default=-np.inf)
    found.lead = verdict.NAMED if lead > verdict.LEAD_NAMED else verdict.FAVOURED
    if len(found.tied) > 1 or outside(best):
        found.lead, found.verdict = verdict.TIED, verdict.TIE
    else:
        found.verdict = verdict.PARTLY if best.law.curvature else verdict.EXPLAINED
    return found


def _rivals(found) -> list[Refit]:
    """The sets of as many effects that are as likely, or give the same shapes, and do not predict poses left out worse."""
    best, out = found.best, []
    for r in found.refits.values():
        if r is best or len(r.components) != len(best.components) or any(entry_of(k).field for k in r.kinds):
            continue
        alike = len(r.kinds) == 1 and (r.kinds[0] in same_shapes(best) or best.kinds[0] in same_shapes(r))
        near = verdict.LEAD_NAMED if alike else verdict.LEAD_FAVOURED
        said = confirm.compared(found.stage, r, best)
        contained = alike and size(r) > size(best) and not said.better  # the simpler one of two that are nested stands
        if r.log_evidence > best.log_evidence - near and not said.worse and not contained:
            out.append(r)
    return sorted(out, key=lambda r: -r.log_evidence)
