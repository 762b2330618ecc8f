"""Partial explanations: the search where no effect reduces the residual to the sensor's noise.

Models are compared at their own floors (`floors`), and a simpler one is kept unless a wider one predicts poses left out better
(`choice`). A set of effects is *found* if it reduces the leave-one-pose-out error by much, and by more than the uncertainty of
that comparison, with sizes homogeneous across poses. Fields along the cable (`effects.catalogue.fields`) compete with the other
effect types: a field that predicts poses left out is physics.
"""

from dataclasses import replace

import numpy as np

from scan2flex_jax.diagnosis import confirm, floors, verdict
from scan2flex_jax.diagnosis.choice import best_of, contains, established, numbers_of
from scan2flex_jax.diagnosis.refit import Refit, again, plain_law, refit
from scan2flex_jax.diagnosis.search import Found, alike, elsewhere, outside, pieces
from scan2flex_jax.diagnosis.sensitivity import Numbers
from scan2flex_jax.diagnosis.stage import Signatures, Stage, test_after
from scan2flex_jax.effects.catalogue import catalogue, entry_of
from scan2flex_jax.fitting.least_squares import Progress

SINGLES, WIDER, PER_ROUND = 5, 3, 3  # refits of single types and of sets that are kept, and refits per round
_WORTH = 25.0  # nats of one-step evidence behind the best type: a refit does not catch up
_STEPS = 20  # iterations of a refit
_PLACE = 0.1  # of the length: effects farther apart are at different places
_NEAR = 2.0  # times the least sum of squares with unweighted distances: refits that may be as likely


def search(before: Found, progress: Progress) -> Found:
    """Continue a search at the sensor's noise that left structure in the residual; its test of the baseline model is kept."""
    stage = before.stage
    base = floors.own_floor(stage.of, stage.base, stage.noise, sharp=True)
    nearest = floors.squares(stage.of, stage.base)
    found = replace(before, floor=base, best=stage.base, refits={}, tied=[stage.base], nearest=nearest)
    singles = [r for r in before.singles if np.isfinite(r.log_evidence)]
    sets = [r for r in before.refits.values() if len(r.kinds) > 1 and np.isfinite(r.log_evidence)]
    sets.sort(key=lambda r: -r.log_evidence)
    begun = [floors.nearest(stage.of, r) for r in (*singles[:SINGLES], *sets[:WIDER])]
    for r in sorted(begun, key=lambda r: floors.squares(stage.of, r)):
        progress(f"{' and '.join(r.kinds)} against its own floor")
        found.add([_at_own_floor(found, r)])
    of = floors.with_fields(stage.of)
    scores = floors.scores(of, base)
    table = scores.table()
    found.table = {kind: value for kind, value in table.items() if not entry_of(kind).field}
    order = sorted(table, key=lambda k: -table[k][0])
    worth = [k for k in order if table[k][0] > table[order[0]][0] - _WORTH]
    likeliest = [*[k for k in worth if k in found.table][:SINGLES], *[k for k in worth if k not in found.table]]
    for kind in (k for k in likeliest if frozenset([k]) not in found.refits):
        progress(f"refit with {kind}")
        found.add([_refitted(found, stage.base, scores, table[kind][1])])
    _add_elsewhere(found, before, scores, table, progress)  # before the others are compared with the nearest one
    _add_near(found, scores, table, progress)
    _add_alike(found, scores, progress)
    _add_parts(found, progress)
    _settle(found, progress)
    _add_elsewhere(found, before, scores, table, progress)
    found.best = best_of(stage, found.refits.values(), 1)
    return widened(found, of, progress)


def widened(found: Found, of: Signatures, progress: Progress) -> Found:
    """The search on from its best set, effect by effect while a wider set predicts better, to the verdict."""
    while found.best.components and len(found.best.components) < most_effects(found.stage):
        wider = _wider(found, of, progress)
        if wider is None:
            break
        found.best = wider
        found.best = _simplified(found, of, progress)
    return _judged(found)


def most_effects(stage: Stage) -> int:
    """How many effects a set may have: no more than the poses can tell apart."""
    return min(stage.settings.most_effects, (stage.bench.poses.count + 1) // 2)


def leads(stage: Stage, wider: Refit, best: Refit) -> bool:
    """Whether a wider model replaces the best one: it predicts poses left out better, and is likelier."""
    against = confirm.compared(stage, wider, best)
    likelier = wider.log_evidence > best.log_evidence + stage.settings.lead_named
    certain = against.gain > stage.settings.certain_gain * against.std and wider.log_evidence > best.log_evidence
    return against.better and (likelier or certain)


def _add_near(found, scores, table, progress) -> None:
    """Refit the other effect types with unweighted distances, and keep those about as near to the curves as the nearest known
    one: where the baseline model is far off, the one-step score of a strong effect may be the lowest of all."""
    stage = found.stage
    rest = [k for k in sorted(found.table, key=lambda k: -table[k][0]) if frozenset([k]) not in found.refits]
    progress("refits with all other effect types")
    unit = plain_law(stage.bench, stage.bench.off).noise.total
    for kind in rest:
        g, least = table[kind][1], _NEAR * found.nearest / unit**2  # about the cost of one that is kept
        begun = _plain(found, [scores.components[g]], stage.base, [scores.amplitudes[g]], least)
        if _near(found, begun):
            found.add([_at_own_floor(found, begun)])


def _add_alike(found, scores, progress) -> None:
    """Refit the effect types that may give the shapes of the likeliest single one, from its place along the cable and its base
    parameters, if theirs is another place: the one-step estimate of a strong effect may be at the wrong one."""
    if not found.singles:
        return
    first = found.singles[0]
    place = first.components[0].site.get("position")
    if place is None:
        return
    near = _PLACE * found.stage.bench.context.length
    for kind in (k for k in found.table if alike(k, *first.kinds)):
        here = [g for g, c in enumerate(scores.components) if c.kind == kind and "position" in c.site]
        known = found.refits.get(frozenset([kind]))
        if not here or (known and abs(known.components[0].site["position"] - place) < near):
            continue
        progress(f"refit with {kind} at the place of {first.kinds[0]}")
        away = np.array([abs(scores.components[g].site["position"] - place) for g in here])
        g = max((g for g, d in zip(here, away, strict=True) if d < away.min() + 1e-9), key=lambda g: scores.values[g])
        found.add([refit_from(found, [scores.components[g]], first, [scores.amplitudes[g]])])


def _add_parts(found, progress) -> None:
    """Refit each effect of a set that is likelier than all single ones, starting from the likeliest such set: one-step evidence
    may rank a strong effect far too low."""
    bench, most = found.stage.bench, max((r.log_evidence for r in found.singles), default=0.0)
    sets, tried = sorted((r for r in found.refits.values() if len(r.kinds) > 1), key=lambda r: -r.log_evidence), set()
    for wider in (r for r in sets if r.log_evidence > most + found.stage.settings.lead_named):
        for k, component in enumerate(wider.components):
            known = found.refits.get(frozenset([component.kind]))
            if component.kind not in tried and (known is None or not known.converged):
                tried.add(component.kind)
                progress(f"refit with {component.kind} alone")
                found.add([refit_from(found, [component], wider, [wider.amplitudes(bench, k)])])


def _settle(found, progress) -> None:
    """Continue the refits of single effects that are about as likely as the likeliest one and have not converged."""
    stage = found.stage
    near = stage.settings.lead_named
    least = max(near, max((r.log_evidence for r in found.singles), default=0.0) - near)
    for r in [r for r in found.singles if not r.converged and r.log_evidence > least]:
        progress(f"refit with {r.kinds[0]}, continued")
        end = again(stage.bench, r, r.law, most=_STEPS)
        found.add([_at_own_floor(found, end)])


def _add_elsewhere(found, before, scores, table, progress) -> None:
    """Refit the likeliest single effect from its one-step estimate at the floors, if so far it was continued from the search at
    the sensor's noise alone, and from other places along the cable, and keep its minima: a light span may give the shapes of a
    heavy one elsewhere on a cable several times as stiff."""
    if not found.singles or any(r.kinds == found.singles[0].kinds for r in found.minima):
        return
    first = found.singles[0]
    (kind,) = first.kinds
    places = elsewhere(scores.components, first, found.stage.bench.context.length)
    starts = [(g, "another place") for g in places]
    if frozenset(first.kinds) in before.refits and table[kind][1] not in places:
        starts.insert(0, (table[kind][1], "its one-step estimate"))
    found.minima = [first]
    for g, where in starts:
        progress(f"refit with {kind} from {where}")
        end = refit_from(found, [scores.components[g]], found.stage.base, [scores.amplitudes[g]])
        if np.isfinite(end.log_evidence):
            found.minima.append(end)
    found.add(found.minima)


def _refitted(found, near: Refit, scores, g) -> Refit:
    """A refit with one more component, starting from its one-step estimate."""
    held = [near.amplitudes(found.stage.bench, k) for k in range(len(near.components))]
    return refit_from(found, [*near.components, scores.components[g]], near, [*held, scores.amplitudes[g]])


def refit_from(found: Found, components, near: Refit, begin) -> Refit:
    """A refit from the base parameters of another: with unweighted distances, then at its own floor."""
    return _at_own_floor(found, _plain(found, components, near, begin))


def _plain(found, components, near: Refit, begin, least: float = np.inf) -> Refit:
    """A refit with unweighted distances from the base parameters of another, given up far above the cost ``least``."""
    bench = found.stage.bench
    base = near.vector[: Numbers(bench, near.components).base]
    return refit(bench, components, plain_law(bench, bench.off), base, begin, most=_STEPS, least=least)


def _at_own_floor(found, plain: Refit) -> Refit:
    """A refit with unweighted distances, continued at its own floor."""
    stage = found.stage
    end = floors.own_floor(stage.of, plain, stage.noise, plain=True, sharp=_near(found, plain))
    return end.over(found.baseline, stage.bench.context)


def _near(found, plain: Refit) -> bool:
    """Whether a refit with unweighted distances is about as near to the curves as the nearest of one effect so far,
    itself included, which ``found`` keeps."""
    if not np.isfinite(plain.cost):
        return False
    squares = floors.squares(found.stage.of, plain)
    if len(plain.kinds) == 1 and not entry_of(*plain.kinds).field:
        found.nearest = min(found.nearest, squares)
    return squares < _NEAR * found.nearest


def _simplified(found, of, progress) -> Refit:
    """The best set after exchanging each of its effects for simpler ones that give the same shapes under some condition."""
    best = None
    while best is not found.best and len(found.best.components) > 1:
        best = found.best
        for k, c in enumerate(best.components):
            rest = found.refits.get(frozenset(best.kinds[:k] + best.kinds[k + 1 :]))
            simpler = [e.kind for e in catalogue() if alike(e.kind, c.kind) and e.kind not in best.kinds]
            simpler = [kind for kind in simpler if rest and frozenset([*rest.kinds, kind]) not in found.refits]
            if not simpler:
                continue
            scores = floors.scores(of, rest)
            table = scores.table()
            for kind in (kind for kind in simpler if numbers_of(scores.components[table[kind][1]]) < numbers_of(c)):
                progress(f"refit with {' and '.join(rest.kinds)} and {kind}")
                found.add([_refitted(found, rest, scores, table[kind][1])])
        found.best = best_of(found.stage, found.refits.values(), len(best.components))
    return found.best


def _wider(found, of, progress) -> Refit | None:
    """The best set with one more effect, if it leads and predicts poses left out better; otherwise None."""
    stage, best = found.stage, found.best
    scores = floors.scores(of, best)
    table = scores.table(skip=best.kinds)
    order = sorted(table, key=lambda k: -table[k][0])[:PER_ROUND]
    for kind in (k for k in order if table[k][0] > stage.settings.lead_favoured):
        progress(f"refit with {' and '.join(best.kinds)} and {kind}")
        found.add([_refitted(found, best, scores, table[kind][1])])
    wider = best_of(stage, found.refits.values(), len(best.components) + 1)
    if wider is stage.base:
        return None
    much = confirm.compared(stage, wider, best).ratio < stage.settings.most_left
    return wider if much and leads(stage, wider, best) else None


def _judged(found: Found) -> Found:
    """Ties and the verdict: is an effect found, and is the explanation complete?"""
    stage, best, settings = found.stage, found.best, found.stage.settings
    found.tied, found.lead, found.verdict = [best], verdict.TOO_LITTLE, verdict.UNEXPLAINED
    if not best.components:
        return found
    found.unseen = found.constancy = None  # those of the search at the sensor's noise
    found.after = test_after(stage, best)
    found.scatter = {c.kind: confirm.scatter(stage, best, k) for k, c in enumerate(best.components)}
    if pieces(best) or not established(stage, best, found.baseline):
        return found
    found.tied = [best, *_rivals(found)]
    other = [r for r in found.refits.values() if not (set(r.kinds) <= set(best.kinds) or set(best.kinds) <= set(r.kinds))]
    leads = [r.log_evidence for r in other]
    lead = best.log_evidence - max(leads, default=-np.inf)
    found.lead = verdict.NAMED if lead > settings.lead_named else verdict.FAVOURED
    if len(found.tied) > 1 or outside(best):
        found.lead, found.verdict = verdict.TIED, verdict.TIE
    else:
        found.verdict = verdict.PARTLY if stage.of.more_than_noise(best.law) else verdict.EXPLAINED
    return found


def _rivals(found) -> list[Refit]:
    """Sets of as many effects that are as likely, or give the same shapes, and predict poses left out no worse."""
    best, settings, out = found.best, found.stage.settings, []
    for r in found.refits.values():
        if r is best or len(r.components) != len(best.components) or any(entry_of(k).field for k in r.kinds):
            continue
        near = settings.lead_named if len(r.kinds) == 1 and alike(*r.kinds, *best.kinds) else settings.lead_favoured
        if r.log_evidence <= best.log_evidence - near:
            continue  # before its refits without each pose are made
        against = confirm.compared(found.stage, r, best)
        wider = contains(r, best) and not against.better  # of two nested effects that are as likely, the simpler one is kept
        least = best.log_evidence + (settings.lead_favoured if wider else -near)
        if r.log_evidence > least and not against.worse:
            out.append(r)
    return sorted(out, key=lambda r: -r.log_evidence)
