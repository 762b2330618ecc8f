"""The search: from scores to refits, from one effect to several, and the ties with the best.

Each round refits the candidates of highest score: single effect types first, then pairs (from one Gram matrix, or given the
best single effect), then a third effect given the best pair. A wider set is accepted if it leads by three nats where the test
of the residual is significant, by five where it is not, and loses as much without any of its effects (backward check). Each
effect of a pair is exchanged for the likeliest others given the rest, and for the same one elsewhere along the cable: the
scores at the baseline fit, which propose a pair, may have wrong sites and types where two strong effects combine.
"""

from dataclasses import dataclass, field

import numpy as np

from scan2flex_jax.diagnosis import confirm, evidence, floors, pairs, verdict
from scan2flex_jax.diagnosis.families import POSE_LOADS
from scan2flex_jax.diagnosis.refit import Refit, again, refit
from scan2flex_jax.diagnosis.residual import orthonormal, whiten
from scan2flex_jax.diagnosis.score import Test
from scan2flex_jax.diagnosis.sensitivity import Numbers
from scan2flex_jax.diagnosis.stage import Stage, one_step, test, test_after
from scan2flex_jax.effects.catalogue import catalogue, entry_of
from scan2flex_jax.effects.entry import CatalogueEntry, SameShapes

REFITS, MORE_REFITS, PAIR_REFITS, GREEDY_REFITS, EXCHANGES = 5, 6, 4, 3, 4
_EXCHANGED = 2  # size of the sets whose effects are exchanged
_ELSEWHERE = 0.05  # of the length: a refit reaches nearer positions by itself
_PLACES, _APART = (1 / 6, 1 / 2, 5 / 6), 0.2  # of the length: starts along the cable, and their least distance from a result
_WORTH = 12.0  # nats behind the best one-step evidence: a refit does not catch up
_STRONG = 500.0  # nats: above it, one-step evidence is unreliable, and so is the order of effect types


@dataclass
class Found:
    """Result of a search: the test, one-step evidence per effect type (``table``: value and best group), refits by their types
    (``parts``: those that were also started from a wider set; ``minima``: those of one effect from several places;
    ``nearest``: the least sum of squares (m^2) of refits of one effect with unweighted distances), the ``best`` one (the base
    if nothing is missing), the p-value of its homogeneity across poses (``constancy``), its leave-one-pose-out error over that
    of the base (``unseen``), the likeliest discrepancy ``field`` with its evidence, those ``tied`` with it, the ``scatter`` of
    its sizes between poses, whether poses are ``scattered`` more than two effects explain, the base at its own ``floor`` if
    models are compared at theirs, the verdict, and the verdict on the best (``lead``)."""

    stage: Stage
    test: Test
    values: np.ndarray
    amplitudes: list
    table: dict
    best: Refit
    refits: dict[frozenset, Refit] = field(default_factory=dict)
    tied: list[Refit] = field(default_factory=list)
    after: Test | None = None
    constancy: float | None = None
    unseen: float | None = None
    scatter: dict[str, float | None] = field(default_factory=dict)
    scattered: bool = False
    floor: Refit | None = None
    parts: set[frozenset[str]] = field(default_factory=set)
    minima: list[Refit] = field(default_factory=list)
    nearest: float = np.inf
    field: tuple[str, float] = ("", 0.0)
    lead: str = verdict.ABSENT
    verdict: str = verdict.NONE

    @property
    def singles(self) -> list[Refit]:
        """Refits of one effect, best first."""
        return sorted((r for r in self.refits.values() if len(r.kinds) == 1), key=lambda r: -r.log_evidence)

    @property
    def baseline(self) -> Refit:
        """The baseline model for comparisons: at its own floor if the refits are at theirs."""
        return self.floor or self.stage.base

    def add(self, refits) -> None:
        """Keep the best refit of each set of effect types."""
        for r in refits:
            key = frozenset(r.kinds)
            if key not in self.refits or r.log_evidence > self.refits[key].log_evidence:
                self.refits[key] = r

    def widest(self, count: int) -> Refit | None:
        """The best refit of ``count`` effects."""
        own = [r for r in self.refits.values() if len(r.kinds) == count]
        return max(own, key=lambda r: r.log_evidence, default=None)


def search(stage: Stage, progress=lambda message: None) -> Found:
    """Test, search and verdict at one estimate of the noise."""
    progress("test")
    values, amplitudes, table = one_step(stage)
    found = Found(stage, test(stage), values, amplitudes, table, stage.base, tied=[stage.base])
    if found.test.p_value > stage.settings.level:
        return found
    found.add(refit_singles(stage, found, progress))
    found.best = found.widest(1) or stage.base
    found.after = test_after(stage, found.best)
    for more in (refit_more_singles, _refit_elsewhere):
        if found.after.p_value <= stage.settings.level and (refits := more(stage, found, progress)):
            found.add(refits)
            found.best = found.widest(1) or stage.base
            found.after = test_after(stage, found.best)
    most = min(stage.settings.most_effects, (stage.bench.poses.count + 1) // 2)
    while len(found.best.kinds) < most and (wider := _widened(found, progress)) is not None:
        found.best, found.after = wider, test_after(stage, wider)
    if found.scattered:
        found.verdict = verdict.UNEXPLAINED
        return found
    rivals = _needed(stage, _of_one_size(stage, found))
    candidates = [verdict.Candidate(r.kinds, r.log_evidence, r.chi2, same_shapes(r), outside(r), pieces(r)) for r in rivals]
    found.tied = [rivals[i] for i in verdict.ties(candidates, stage.settings)]
    first = found.tied[0]
    if first is not found.best and len(first.kinds) == len(found.best.kinds):
        found.best, found.after = first, test_after(stage, first)
    found.scatter = {c.kind: confirm.scatter(stage, found.best, k) for k, c in enumerate(found.best.components)}
    found.constancy, found.unseen = confirm.constancy(stage, found.best), confirm.unseen(stage, found.best)
    fields = {f.name: float(f.gain(stage.y[:, None])[0]) for f in stage.families if f.name != POSE_LOADS}
    found.field = max(fields.items(), key=lambda item: item[1])
    found.lead = verdict.leading(candidates, found.field[1], stage.settings)
    rest = found.constancy, found.field[1], found.unseen
    found.verdict = verdict.whole(found.test, found.after, candidates, *rest, settings=stage.settings)
    return found


def _of_one_size(stage, found) -> list[Refit]:
    """The refits, without likely ones whose size varies between poses if another likely one is homogeneous."""
    rivals = list(found.refits.values())
    best = max(r.log_evidence for r in rivals)
    near = [r for r in rivals if r.log_evidence > best - stage.settings.lead_named]
    unlike = [r for r in near if verdict.varies(confirm.constancy(stage, r), stage.settings)]
    return [r for r in rivals if r not in unlike] if len(unlike) < len(near) else rivals


def _needed(stage, rivals: list[Refit]) -> list[Refit]:
    """The refits, without sets of which a subset is as likely."""

    def spare(r, part):
        return set(part.kinds) < set(r.kinds) and part.log_evidence > r.log_evidence - stage.settings.lead_favoured

    return [r for r in rivals if not any(spare(r, part) for part in rivals)]


def _widened(found: Found, progress) -> Refit | None:
    """The best set with one more effect, if that is needed; None also where poses are ``scattered``.

    The test looks for anything that may be missing, and may overlook a second effect that is much weaker than the first. Where
    it takes the residual for noise, one more effect must lead by as much as a name needs, beside one of the sets that are tied.
    """
    stage, count = found.stage, len(found.best.kinds) + 1
    structure = found.after is not None and found.after.p_value <= stage.settings.level
    lead = stage.settings.lead_favoured if structure else stage.settings.lead_named
    if structure and count == 2 and found.widest(2) is None:  # once: the scores of pairs do not change
        found.add(refit_pairs(stage, found.values, progress))
    settled = {kinds for kinds, r in found.refits.items() if r.converged}
    for first in [found.best] if structure else _about_as_likely(found):
        least = -np.inf if structure else found.best.log_evidence + lead - first.log_evidence
        found.add(refit_with_one_more(stage, first, GREEDY_REFITS, progress, settled=settled, least=least))
    wider = found.widest(count)
    if wider is None:
        return None
    if structure and count == 2:  # above it no set of effects reaches the sensor's noise: left to `partial`
        found.scattered = floors.gain_of_discrepancy(stage.of, wider, stage.noise) > stage.settings.scattered
    if found.scattered or wider.log_evidence <= found.best.log_evidence + lead:
        return None
    needed = _settled(stage, found, wider, lead, progress) or found.widest(count - 1)  # the set without the spare effect
    return None if needed is found.best else needed


def _about_as_likely(found) -> list[Refit]:
    """The best set, and those of as many effects that are tied with it."""
    least = found.best.log_evidence - found.stage.settings.lead_favoured
    same = [r for r in found.refits.values() if len(r.kinds) == len(found.best.kinds) and r.log_evidence > least]
    return sorted(same, key=lambda r: -r.log_evidence)


def _settled(stage, found, wider, lead, progress) -> Refit | None:
    """The best set of as many effects after backward check and exchanges; None if the set without one of its effects is less
    than ``lead`` nats behind."""
    tried: set[frozenset] = set()
    while True:
        for dropped in range(len(wider.kinds)):
            rest = _without(stage, found, wider, dropped, progress)
            if rest.log_evidence > wider.log_evidence - lead:
                return None
            if len(wider.kinds) == _EXCHANGED and frozenset(rest.kinds) not in tried:
                tried.add(frozenset(rest.kinds))
                found.add(refit_with_one_more(stage, rest, EXCHANGES, progress, wider))
        best = found.widest(len(wider.kinds))
        if best is wider:
            return wider
        wider = best


def _without(stage, found, wider, dropped, progress) -> Refit:
    """The refit of a set without one of its effects, kept for the ties."""
    rest = [k for k in range(len(wider.kinds)) if k != dropped]
    key = frozenset(wider.kinds[k] for k in rest)
    if key not in found.parts:  # one from the baseline model may have been given up, or ended in another minimum
        found.parts.add(key)
        progress(f"refit without {wider.kinds[dropped]}")
        components, new = [wider.components[k] for k in rest], key not in found.refits
        found.add([relative(stage, components, [wider.amplitudes(stage.bench, k) for k in rest], wider)])
        if new and len(rest) == 1:  # the effect of a wider set may be elsewhere
            found.add([_single(stage, found, components[0].kind, progress)])
    return found.refits[key]


def refit_singles(stage: Stage, found: Found, progress) -> list[Refit]:
    """Refits of the best effect types by evidence and by BIC; evidence relative to the base."""
    n, table, statistics = len(stage.y), found.table, found.test.T
    order = sorted(table, key=lambda k: -table[k][0])
    top = table[order[0]][0]
    worth = [k for k in order[:REFITS] if table[k][0] > top - _WORTH or top > _STRONG]
    bic = {k: evidence.bic(statistics[table[k][1]], stage.groups[table[k][1]].rank, n) for k in table}
    worth += [k for k in sorted(bic, key=lambda k: -bic[k])[:2] if k not in worth]
    rivals = [k for k in table if alike(k, order[0])]
    worth += [k for k in rivals if k not in worth and bic[k] > 0.5 * bic[order[0]]]
    return [_single(stage, found, kind, progress) for kind in worth]


def alike(a: str, b: str) -> bool:
    """Whether, by the catalogue, one of two effect types gives the shapes of the other under some condition."""
    return any(same.other == other for kind, other in ((a, b), (b, a)) for same in entry_of(kind).same_shapes)


def refit_more_singles(stage: Stage, found: Found, progress) -> list[Refit]:
    """Refits of further effect types, if structure remains and effects are too strong for one-step evidence."""
    order = sorted(found.table, key=lambda k: -found.table[k][0])
    if found.table[order[0]][0] <= _STRONG:
        return []
    rest = [k for k in order if frozenset([k]) not in found.refits]
    return [_single(stage, found, kind, progress) for kind in rest[:MORE_REFITS]]


def _refit_elsewhere(stage, found, progress):
    """Refits of the likeliest effect type from other places along the cable, if structure remains: where an effect is strong,
    or acts in some poses only, its minima may be far apart, and the one of the highest score is not the lowest."""
    out = []
    for g in elsewhere(stage.components, found.best, stage.bench.context.length):
        progress(f"refit with {found.best.kinds[0]} from another place")
        out.append(relative(stage, [stage.components[g]], [found.amplitudes[g]], stage.base))
    return out


def elsewhere(components, reached, length: float) -> list[int]:
    """Indices of ``components`` of the effect type of a refit, at places along the cable (``length``, m) apart from its own;
    empty without a place."""
    place = reached.components[0].site.get("position") if reached.components else None
    if place is None:
        return []
    own = [g for g, c in enumerate(components) if c.kind == reached.kinds[0]]
    at = np.array([components[g].site["position"] for g in own]) / length
    return [own[int(np.argmin(np.abs(at - x)))] for x in _PLACES if abs(x - place / length) > _APART]


def _single(stage, found, kind, progress):
    progress(f"refit with {kind}")
    g = found.table[kind][1]
    return relative(stage, [stage.components[g]], [found.amplitudes[g]])


def refit_pairs(stage: Stage, values, progress) -> list[Refit]:
    """Refits of the best pairs of effect types."""
    kinds = [c.kind for c in stage.components]
    out = []
    for _, i, j in pairs.best_pairs(stage.groups, stage.y, values, kinds, PAIR_REFITS):
        progress(f"refit with {kinds[i]} and {kinds[j]}")
        X = np.column_stack([stage.groups[i].X, stage.groups[j].X])
        a = evidence.one_step(X.T @ X, X.T @ stage.y)
        size = [stage.components[g].entry.size(stage.bench.context) for g in (i, j)]
        split = len(size[0])
        out.append(relative(stage, [stage.components[i], stage.components[j]], [a[:split] * size[0], a[split:] * size[1]]))
    return out


def refit_with_one_more(
    stage: Stage, first: Refit, count: int, progress, known: Refit | None = None, settled: frozenset | set = frozenset(),
    least: float = -np.inf,
) -> list[Refit]:
    """Refits of one more effect given a refit, ranked by scores at that refit, since effects are far from linear.

    Only those whose scores exceed ``least`` (nats) are refitted. Types in ``known``, a set that contains ``first``, are
    refitted only elsewhere along the cable; ``settled`` sets are not refitted again.
    """
    numbers = Numbers(stage.bench, first.components)
    white = whiten(first.shapes, stage.bench.real, numbers, first.vector, stage.law)
    Q = orthonormal(white.J)
    y = white.r - Q @ (Q.T @ white.r)
    best: dict = {}
    for g, group in enumerate(stage.groups):
        X = group.X - Q @ (Q.T @ group.X)
        A, b = X.T @ X, X.T @ y
        value, kind = evidence.log_evidence(A, b, group.one_sided), stage.components[g].kind
        if kind not in first.kinds and (kind not in best or value > best[kind][0]):
            best[kind] = value, g, evidence.one_step(A, b) * stage.components[g].entry.size(stage.bench.context)
    order = [k for k in sorted(best, key=lambda k: -best[k][0]) if _is_new(stage, stage.components[best[k][1]], known)]
    out = []
    order = [k for k in order[:count] if best[k][0] > least and frozenset((*first.kinds, k)) not in settled]
    for _, g, a in (best[k] for k in order):
        progress(f"refit with {' and '.join(first.kinds)} and {stage.components[g].kind}")
        held = [first.amplitudes(stage.bench, k) for k in range(len(first.components))]
        out.append(relative(stage, [*first.components, stage.components[g]], [*held, a]))
    return out


def _is_new(stage, component, known) -> bool:
    """Whether a component is absent from a known set, or is elsewhere along the cable."""
    same = [c for c in known.components if c.kind == component.kind] if known else []
    apart = _ELSEWHERE * stage.bench.context.length
    return not same or bool(abs(component.site.get("position", 0.0) - same[0].site.get("position", 0.0)) > apart)


def minima_elsewhere(found: Found) -> list[Refit]:
    """Refits of the effect of the best model at another place along the cable that are about as likely."""
    best = found.best
    if not found.minima or len(best.components) != 1 or "position" not in best.components[0].site:
        return []
    length = found.stage.bench.context.length
    place, least = best.components[0].site["position"], best.log_evidence - found.stage.settings.lead_favoured
    likely = [r for r in found.minima if r.kinds == best.kinds and r.log_evidence > least]
    out: list[Refit] = []
    for r in sorted(likely, key=lambda r: -r.log_evidence):
        known = [place, *(o.components[0].site["position"] for o in out)]
        if all(abs(r.components[0].site["position"] - x) > _APART * length for x in known):
            out.append(r)
    return out


def same_shapes(found: Refit) -> tuple[str, ...]:
    """Effect types indistinguishable by shapes from those of a refit, under the conditions of the catalogue."""
    return tuple(same.other for c in found.components for same in c.entry.same_shapes)


def pieces(found: Refit) -> bool:
    """Whether two effects of a refit vary the same property along the cable."""
    varied = [c.entry.varies for c in found.components if c.entry.varies is not None]
    return len(set(varied)) < len(varied)


def rival_field(found: Found) -> tuple[str, ...]:
    """The discrepancy field that is nearly as likely as the best effects, in words; they may be part of it."""
    name, evidence_ = found.field
    return (f"field of {name}",) if evidence_ > found.best.log_evidence - found.stage.settings.lead_favoured else ()


def outside(found: Refit) -> tuple[str, ...]:
    """Errors of the study's input that always give the shapes of the single effect of a refit."""
    if len(found.components) != 1:
        return ()
    return tuple(same.other for same in errors_of_the_study(found.components[0].entry))


def errors_of_the_study(entry: CatalogueEntry) -> list[SameShapes]:
    """Errors of the study's input that always give the shapes of an entry."""
    kinds = {e.kind for e in catalogue()}
    return [same for same in entry.same_shapes if same.always and same.other not in kinds]


def relative(stage, components, amplitudes, near=None):
    """A refit with its evidence over the base, starting from the same model under another noise, from the base parameters of
    ``near``, or from the base."""
    before = stage.known.get(frozenset(c.kind for c in components))
    if before is not None and np.isfinite(before.cost) and near is None:
        found = again(stage.bench, before, stage.law, stage.least)
    else:
        guess = (near or stage.base).vector
        found = refit(stage.bench, components, stage.law, guess, amplitudes, least=stage.least)
    stage.least = min(stage.least, found.cost)
    return found.over(stage.base, stage.bench.context)
