"""Moment laws of any form (`effects.catalogue.laws`), tried last and by the rules of all other effects.

A law needs room in the compiled state of every pose, and eight numbers. It is therefore tried only where it can matter: where
the effects that were found leave more than noise, or where one that is tied gives the shapes of the law under some condition.
It is refitted alone, beside the best set and the likeliest other one that is about as likely, and in those sets in the place of
an effect that it contains, each from the linear law and from the laws of the refits so far. A simpler set stands unless the one
with the law predicts poses left out better, and is likelier (`partial.leads`).
"""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from scan2flex_jax.diagnosis import confirm, floors, partial, search, verdict
from scan2flex_jax.diagnosis.choice import of_one_size
from scan2flex_jax.diagnosis.refit import Refit, configurations
from scan2flex_jax.diagnosis.search import Found, alike
from scan2flex_jax.diagnosis.sensitivity import Bench, Component, with_shapes
from scan2flex_jax.diagnosis.stage import test_after
from scan2flex_jax.effects.catalogue import laws
from scan2flex_jax.effects.entry import CatalogueEntry
from scan2flex_jax.fitting.least_squares import Progress
from scan2flex_jax.rod.effect import overriding

_STARTS = 2  # refits whose laws a law begins from, beside the linear one


def search_on(found: Found, progress: Progress) -> Found:
    """The search on from one that is not complete, or whose tie a law could be behind; unchanged where no law leads."""
    if not _may_matter(found):
        return found
    refits = []
    for entry in _undeclared(found):
        if _worth(found, entry, progress):
            refits += _refits(found, entry, progress)
    found.add(refits)
    likeliest = sorted((r for r in refits if np.isfinite(r.log_evidence)), key=lambda r: -r.log_evidence)
    best = next((r for r in likeliest if _stands(found, r)), None)
    if best is None:
        return found
    if found.floor is None:
        return _explained(found, best)
    after = partial.widened(replace(found, best=best), floors.with_fields(found.stage.of), progress)
    return found if after.verdict == verdict.UNEXPLAINED and found.verdict in verdict.FOUND else after


def _may_matter(found):
    """Whether the answer leaves more than noise, in poses that can be left out in turn, or a law may be what ties."""
    if found.stage.bench.poses.count < 2:
        return False
    if found.verdict in (verdict.UNEXPLAINED, verdict.PARTLY):
        return found.floor is not None
    kinds = {k for r in found.tied for k in r.kinds}
    return found.verdict == verdict.TIE and any(alike(e.kind, k) for e in laws() for k in kinds)


def _undeclared(found):
    """The laws that the study does not declare itself."""
    declared = {e.kind for e in found.stage.bench.problem.study.effects}
    return [entry for entry in laws() if entry.kind not in declared]


def _worth(found, entry, progress) -> bool:
    """Whether a law may lead: an effect that it contains was refitted, or one step gains enough beside the best model."""
    stage = found.stage
    if any(alike(entry.kind, k) for r in found.refits.values() for k in r.kinds):
        return True
    if found.floor is None:
        return False
    progress(f"score of {entry.kind}")
    of = floors.only(stage.of, [Component(entry.kind, entry.sites(stage.bench.context)[0])])
    value, _ = floors.scores(of, _best(found)).table()[entry.kind]
    return value > stage.settings.lead_favoured


def _best(found) -> Refit:
    """The best model without a law, as refits are compared with it."""
    return found.best if found.best.components else found.baseline


def _refits(found, entry, progress) -> list[Refit]:
    """Refits with a law: alone, and beside each likely set or in the place of an effect of it that the law contains."""
    out, tried = [], set()
    for best in _sets(found):
        kept = [k for k, c in enumerate(best.components) if not alike(entry.kind, c.kind)]
        sets = [[], kept]
        if len(best.components) == len(kept) >= partial.most_effects(found.stage):
            sets = [[]]  # no room for one more
        for held in sets:
            kinds = frozenset(best.components[k].kind for k in held)
            if kinds in tried:
                continue
            tried.add(kinds)
            progress(f"refit with {' and '.join([*(best.components[k].kind for k in held), entry.kind])}")
            ends = [_refit(found, entry, near, held, best) for near in _starts(found, entry, best)]
            out += [r for r in ends if r is not None]
    return out


def _sets(found) -> list[Refit]:
    """The best model without a law, and the likeliest other one of as many effects if it is about as likely: which of two is
    the better may depend on the law that both lack."""
    best = _best(found)
    least = best.log_evidence - found.stage.settings.lead_named
    others = [r for r in found.refits.values() if r is not best and len(r.components) == len(best.components)]
    likeliest = max(others, key=lambda r: r.log_evidence, default=None)
    return [best, likeliest] if likeliest is not None and likeliest.log_evidence > least else [best]


def _starts(found, entry, best) -> list[Refit]:
    """Refits to begin from: the best one, and the likeliest that have an energy law of their own."""
    own = [r for r in found.refits.values() if any(alike(entry.kind, k) for k in r.kinds) and np.isfinite(r.log_evidence)]
    own = sorted((r for r in own if r is not best), key=lambda r: -r.log_evidence)
    return [best, *own[:_STARTS]]


def _refit(found, entry, near, held, best) -> Refit | None:
    """A refit with a law beside the components ``held`` of the ``best`` set, from the base numbers and the law of ``near``."""
    bench = found.stage.bench
    site = entry.sites(with_shapes(bench.context, configurations(near.shapes)))[0]
    begin = [best.amplitudes(bench, k) for k in held] + [_law_of(bench, near, entry, site)]
    components = [*(best.components[k] for k in held), Component(entry.kind, site)]
    if found.floor is None:
        return search.relative(found.stage, components, begin, near)
    return partial.refit_from(found, components, near, begin)


def _law_of(bench: Bench, near: Refit, entry: CatalogueEntry, site) -> np.ndarray:
    """Amplitudes of a law that is as stiff as the effects of a refit at each strain; the linear law where they have none."""
    sizes = [jnp.asarray(near.amplitudes(bench, k)) for k in range(len(near.components))]
    parts = [c.entry.build(a, c.site, bench.context) for a, c in zip(sizes, near.components, strict=True)]
    effects = overriding([e for part in parts for e in part], "strain_energy")
    found = entry.like(effects, bench.stiffness(near), site) if effects else None
    return entry.null if found is None else np.clip(found, *entry.bounds(bench.context))


def _stands(found, r) -> bool:
    """Whether a refit with a law stands in the place of the best model, and of all that are tied with it."""
    stage = found.stage
    others = [t for t in found.tied if t.components] or [_best(found)]
    return of_one_size(stage, r) and all(partial.leads(stage, r, other) for other in others)


def _explained(found, best) -> Found:
    """The answer with a law in the place of a tie at the sensor's noise, where it leaves that noise alone."""
    stage = found.stage
    after = test_after(stage, best)
    if after.p_value <= stage.settings.level:
        return found
    scatter = {c.kind: confirm.scatter(stage, best, k) for k, c in enumerate(best.components)}
    same = {"constancy": confirm.constancy(stage, best), "unseen": confirm.unseen(stage, best)}
    said = {"lead": verdict.FAVOURED, "verdict": verdict.EXPLAINED}
    return replace(found, best=best, tied=[best], after=after, scatter=scatter, **same, **said)
