"""The search over hypotheses: best first, from one effect to several, in every variant of the study.

To first order every component of the catalogue is scored beside a hypothesis, over a ladder of sizes of noise and discrepancy;
the best are refitted. Where the baseline model is far off, or its poses have a discrepancy, first order says little: every
effect type is refitted, nearest by distance first. Each effect of a set is exchanged for the likeliest others, and left out.
"""

from collections.abc import Iterable
from dataclasses import dataclass, field
from itertools import combinations, product
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy import special

from scan2flex_jax.effects.catalogue import catalogue, entry_of, fields, laws
from scan2flex_jax.effects.entry import CatalogueEntry
from scan2flex_jax.fitting.least_squares import Progress
from scan2flex_jax.fitting.noise import FINEST
from scan2flex_jax.posterior.likelihood import inverted
from scan2flex_jax.posterior.posterior import SIZES, Fitted, Variant, price, solved
from scan2flex_jax.posterior.program import Component
from scan2flex_jax.rod.effect import overriding

_SINGLES, _LEAST, _MORE = 6, 2, 3  # refits by their scores: of single effects, at least, and beside others
_SITES = 3  # of an effect type that are combined in pairs
_WORTH, _PART = 30.0, 0.1  # nats behind the best score, and of it: a refit does not catch up
_FAR, _NONLINEAR = 5.0, 3e-3  # baseline residual over noise, discrepancy over length, beyond which first order says little
_DISCREPANCY, _NOISE = (1.0, 0.3, 0.1, 0.03, 0.0), (1.0, 0.3, 0.1)  # ladder of scores: factors on the sizes of the hypothesis
_ELSEWHERE, _APART = (1 / 6, 1 / 2, 5 / 6), 0.2  # of the length: further starts of a place, and their least distance from it


class Scored(NamedTuple):
    """One effect type to first order beside a hypothesis: gain (nats) with its prior, best component, and amplitudes there."""

    gain: float
    component: Component
    amplitudes: np.ndarray


@dataclass
class Search:
    """All hypotheses tried, by variant and effect types; ``scores`` of each effect type beside the empty ones."""

    variants: list[Variant]
    say: Progress
    found: dict[tuple, Fitted] = field(default_factory=dict)
    scores: dict[str, Scored] = field(default_factory=dict)
    grown: set[tuple] = field(default_factory=set)
    compared: set[tuple] = field(default_factory=set)

    def __post_init__(self):
        """The hypotheses without effects."""
        for variant in self.variants:
            self.add(variant.empty)

    def add(self, h: Fitted | None) -> None:
        """Keep the likeliest end of each hypothesis, unless it has become another one (a tether without stiffness, a force)."""
        kept = h is not None and np.isfinite(h.score) and not _degenerate(h)
        if h is not None and kept and (h.key not in self.found or h.score > self.found[h.key].score):
            self.found[h.key] = h

    @property
    def ranked(self) -> list[Fitted]:
        """All hypotheses, the likeliest first."""
        return sorted(self.found.values(), key=lambda h: -h.score)

    @property
    def causes(self) -> list[Fitted]:
        """Those without a field: a field describes, and is not built upon."""
        return [h for h in self.ranked if not describes(h)]

    def best(self, variant: Variant | None = None, count: int | None = None) -> Fitted | None:
        """The likeliest hypothesis of a variant, of so many effects."""
        own = (h for h in self.causes if variant in (None, h.variant) and count in (None, len(h.components)))
        return next(own, None)

    def run(self) -> "Search":
        """The whole search."""
        for variant in self.variants:
            self._singles(variant)
            self._empty_again(variant)
        self._widen()
        self._laws()
        return self

    def _widen(self):
        """Sets of effects, as far as they lead."""
        first = self.variants[0]
        most = min(first.settings.most_effects, (first.program.poses.count + 1) // 2)
        while True:
            best = self.causes[0]
            count = len(best.components)
            behind = first.settings.tied + _PART * max(best.score - best.variant.empty.score, 0.0) * (count == 1)
            near = [h for h in self.causes if h.score > best.score - behind]
            todo = [h for h in near if len(h.components) == count and 0 < count < most and h.key not in self.grown]
            if not todo:
                break
            for h in todo[:3]:
                self._grow(h)
            if self.causes[0] is not best and len(self.causes[0].components) > 1:
                self._exchange(self.causes[0])
        self._reduce()

    def extend(self, variant: Variant) -> None:
        """Search one more variant too."""
        self.variants.append(variant)
        self.add(variant.empty)
        self._singles(variant)
        self._empty_again(variant)
        self._widen()

    def _singles(self, v: Variant):
        """Single effects by their scores; where the best leaves a discrepancy in the first variant, all effects and fields."""
        screen = Screen(v.empty)
        table = screen.singles()
        self.scores |= {k: s for k, s in table.items() if k not in self.scores or s.gain > self.scores[k].gain}
        order, top = list(table), next(iter(table.values())).gain
        noise = min(v.likelihood.noise(v.empty.u).total, v.likelihood.stated or np.inf)  # a poor fit takes its error for noise
        far = v.off > _FAR * max(noise, FINEST * v.length)
        if not far and not v.empty.discrepant and top < -v.settings.tied:  # nothing gains, and first order is close enough
            order = order[:_LEAST]
        keep = [k for k in order[:_SINGLES] if table[k].gain > top - _WORTH - _PART * max(top, 0)]
        for kind in keep:
            self._refit(v.empty, table[kind], unweighted=far)
        self._similar(v)
        if self._leaves_discrepancy(v):
            least = max(h.score for h in self.found.values() if h.variant is v) - v.empty.score
            for pair in screen.pairs()[:_MORE]:
                if pair[0].gain > least + v.settings.found:
                    self._refit_both(v, *pair)
        if far and v is self.variants[0]:
            self._every(v, table, keep)
        if v is self.variants[0] and self._leaves_discrepancy(v):
            if not far and v.empty.scattered() > _NONLINEAR * v.length:
                self._every(v, table, keep)
            for e in fields():
                self._refit(v.empty, Scored(0.0, Component(e.kind, {}), e.null), unweighted=far)

    def _empty_again(self, v: Variant):
        """The hypothesis without effects from where the best single effect ended: what a descent missed is no effect."""
        best = self.best(v, 1)
        if best is None or v.held or best.score <= v.empty.score:
            return
        self.say(f"without {best.kinds[0]}")
        shapes = v.program.shapes((), best.x[: best.index.base], best.configuration)
        again = v.refitted((), [], best.x, shapes, best.u, unweighted=False) if solved(shapes) else None
        if again is not None and again.score > v.empty.score + v.settings.tied:
            v.empty = again
            self.add(again)
            self.scores |= Screen(again).singles()

    def _leaves_discrepancy(self, v: Variant) -> bool:
        """Whether the likeliest hypothesis of a variant has a discrepancy."""
        best = self.best(v)
        return best is None or best.discrepant

    def _every(self, v: Variant, table, but):
        """Every other effect type, where first order says little."""
        nearest = min(h.squares for h in self.found.values() if h.variant is v)
        for kind in (k for k in table if k not in but):
            h = self._refit(v.empty, table[kind], unweighted=True, nearest=nearest)
            nearest = min(nearest, h.squares) if h else nearest
        self._elsewhere(v, table)
        self._similar(v)

    def _refit(self, h: Fitted, s: Scored, *, unweighted: bool, nearest: float = np.inf, u=None) -> Fitted | None:
        """A hypothesis with one more effect."""
        names = " and ".join((*h.kinds, s.component.kind))
        self.say(f"{names}: {s.gain:.1f} nats to first order" if np.isfinite(s.gain) and s.gain else names)
        begin = [*(h.amplitudes(k) for k in range(len(h.components))), s.amplitudes]
        end = h.variant.refitted(
            (*h.components, s.component), begin, h.x, h.shapes, u, unweighted=unweighted, nearest=nearest, within=h.squares
        )
        self.add(end)
        return end

    def _refit_both(self, v: Variant, first: Scored, second: Scored):
        """A pair of effects from its score."""
        components = (first.component, second.component)
        self.say(f"{' and '.join(c.kind for c in components)}: {first.gain:.1f} nats to first order")
        begin = [first.amplitudes, second.amplitudes]
        self.add(v.refitted(components, begin, v.empty.x, v.empty.shapes, None, unweighted=False))

    def _laws(self):
        """Moment laws of any form, alone and in the place of an effect of the best set that they contain: where that set leaves
        a discrepancy, or something near it gives the shapes of a law. Each begins linear, and from the laws that it contains.
        """
        best = self.causes[0]
        v, near = best.variant, [h for h in self.causes if h.score > best.score - best.variant.settings.named]
        declared = {e.kind for e in v.study.effects}
        for e in (e for e in laws() if e.kind not in declared and v.program.poses.count > 1):
            contained = [h for h in near if any(same_shapes(e.kind, k) for k in h.kinds)]
            if not (best.discrepant or contained):
                continue
            held = [k for k, c in enumerate(best.components) if not same_shapes(e.kind, c.kind)]
            site = e.sites(v.context)[0]
            begun = [e.null, *(a for h in contained[:1] if (a := _as_law(h, e, site)) is not None)]
            for kept in ([], held) if 0 < len(held) < v.settings.most_effects else ([],):
                components = [*(best.components[k] for k in kept), Component(e.kind, site)]
                self.say(" and ".join(c.kind for c in components))
                for a in begun:
                    begin = [*(best.amplitudes(k) for k in kept), a]
                    self.add(v.refitted(components, begin, best.x, best.shapes, best.u, unweighted=False))

    def _similar(self, v: Variant):
        """The kinds that may give the shapes of the best single effect, from its place and its base parameters."""
        first = self.best(v, 1)
        place = None if first is None else first.components[0].site.get("position")
        if first is None or place is None or first.key in self.compared or first.score < v.empty.score:
            return
        self.compared.add(first.key)
        for kind in (e.kind for e in catalogue() if e.kind != first.kinds[0] and same_shapes(e.kind, first.kinds[0])):
            sites = [s for s in entry_of(kind).sites(v.context) if "position" in s]
            if sites:
                c = Component(kind, min(sites, key=lambda s: abs(s["position"] - place)))
                start = next((s.amplitudes for k, s in self.scores.items() if k == kind), c.entry.null)
                self.say(f"{kind} at the place of {first.kinds[0]}")
                for u, unweighted in ((first.u, False), (None, True)):
                    self.add(v.refitted([c], [start], first.x, first.shapes, u, unweighted=unweighted))

    def _elsewhere(self, v: Variant, table):
        """The best single effect from other places along the cable."""
        first = self.best(v, 1)
        if first is None or "position" not in first.components[0].site:
            return
        entry, place = first.components[0].entry, first.components[0].site["position"] / v.length
        sites = entry.sites(v.context)
        for x in _ELSEWHERE:
            if abs(x - place) > _APART:
                site = min(sites, key=lambda s: abs(s["position"] / v.length - x))
                self._refit(v.empty, Scored(0.0, Component(entry.kind, site), table[entry.kind].amplitudes), unweighted=True)

    def _grow(self, h: Fitted):
        """Refits with one more effect; those that gain little are in the intervals of what was found."""
        self.grown.add(h.key)
        others = [(kind, s) for kind, s in scored(h).items() if not contained(kind, h.kinds)]
        for kind, s in others[:_MORE]:
            key = h.variant.name, frozenset((*h.kinds, kind))
            if s.gain > -h.variant.settings.tied and not (key in self.found and self.found[key].converged):
                self._refit(h, s, unweighted=False, u=h.u)

    def _part(self, h: Fitted, dropped: int) -> Fitted | None:
        """The hypothesis without one of its effects."""
        rest = [k for k in range(len(h.components)) if k != dropped]
        key = h.variant.name, frozenset(h.kinds[k] for k in rest)
        if key not in self.found or key not in self.grown:
            self.say(f"without {h.kinds[dropped]}")
            begin = [h.amplitudes(k) for k in rest]
            self.add(h.variant.refitted([h.components[k] for k in rest], begin, h.x, h.shapes, h.u, unweighted=False))
        return self.found.get(key)

    def _exchange(self, h: Fitted):
        """Each effect of a set exchanged for the likeliest others given the rest, where that explains anything by itself."""
        while True:
            for k in range(len(h.components)):
                rest = self._part(h, k)
                if rest is not None and rest.key not in self.grown and rest.score > h.variant.empty.score:
                    self._grow(rest)
            best = self.best(h.variant, len(h.components))
            if best is None or best is h:
                return
            h = best

    def _reduce(self):
        """The best set without each of its effects."""
        while True:
            best = self.causes[0]
            for k in range(len(best.components) if len(best.components) > 1 else 0):
                self._part(best, k)
            if self.causes[0] is best:
                return


def same_shapes(a: str, b: str) -> bool:
    """Whether two effect types give the same shapes by the catalogue."""
    return any(s.other == y for x, y in ((a, b), (b, a)) for s in entry_of(x).same_shapes)


def contained(kind: str, kinds: Iterable[str]) -> bool:
    """Whether an effect type and one of others are the same thing in two forms: the stiffness along a cable, and a taper."""
    return any(same_shapes(kind, k) and (entry_of(kind).varies or entry_of(k).varies) for k in kinds)


def _degenerate(h: Fitted) -> bool:
    """Whether an effect has lost what sets it apart: a one-sided amplitude is zero where others of either sign act."""
    for k, c in enumerate(h.components):
        a, one_sided = h.amplitudes(k), np.array(c.entry.one_sided)
        if np.any(a[one_sided] <= 0.0) and np.any(a[~one_sided]):
            return True
    return False


def describes(h: Fitted) -> bool:
    """Whether a hypothesis has a field of arbitrary form along the cable, which describes a residual and names no cause."""
    return any(c.entry.field and not c.entry.late for c in h.components)


def _as_law(h: Fitted, entry: CatalogueEntry, site) -> np.ndarray | None:
    """Amplitudes of a law that is as stiff at each strain as the effects of a hypothesis; None where they have no law."""
    v = h.variant
    parts = [c.entry.build(jnp.asarray(h.amplitudes(k)), c.site, v.context) for k, c in enumerate(h.components)]
    effects = overriding([e for part in parts for e in part], "strain_energy")
    stiffness = np.asarray(v.program.rods((), h.x[: h.index.base], h.shapes[:1])[0][0].section.stiffness[0])
    found = entry.like(effects, stiffness, site) if effects else None
    return None if found is None else np.clip(found, *entry.bounds(v.context))


class Screen:
    """Every effect type that is not in a hypothesis, at every site, to first order beside it: over a ladder of sizes of noise
    and discrepancy the log likelihood, and information and score of all amplitudes in units of their sizes, with the
    parameters of the hypothesis eliminated."""

    def __init__(self, h: Fitted):
        """One back-substitution for each amplitude and site."""
        v = self.variant = h.variant
        self.wanted = [Component(e.kind, s) for e in catalogue() if e.kind not in h.kinds for s in e.sites(v.context)]
        columns, owner = v.program.columns(h.components, h.x, h.configuration, self.wanted)
        S, lin = v.rows.of(h.shapes, columns), h.linear
        self.kinds: dict[str, list[int]] = {}
        for j, c in enumerate(self.wanted):
            self.kinds.setdefault(c.kind, []).append(j)
        self.spans = [np.flatnonzero(owner == j) for j in range(len(self.wanted))]
        size = np.zeros(len(owner))
        for c, span in zip(self.wanted, self.spans, strict=True):
            size[span] = c.entry.size(v.context)
        self.ladder = []
        for fb, fc in product(_DISCREPANCY, _NOISE):
            change = np.array([0.0, np.log(fc), 0.0, np.log(fb) if fb else -20.0, 0.0])
            u = np.clip(h.u + change, *np.transpose(v.likelihood.bounds))
            alone = v.likelihood(u, lin, gradient=False) - v.settings.discrepancy * v.likelihood.discrepant(u)
            wr, wX, wS = v.likelihood.white(u, lin, S)
            A, g = lin.normal(wr, wX)
            cross = lin.crossed(wX, wS)
            flat, projected = wS.reshape(-1, wS.shape[2]), inverted(A)[1] @ cross
            b = -(flat.T @ wr.ravel() - projected.T @ g) * size
            self.ladder.append((alone, (flat.T @ flat - cross.T @ projected) * np.outer(size, size), b))
        self.base = max(alone for alone, *_ in self.ladder)
        self.best: dict[str, tuple[np.ndarray, np.ndarray]] = {}

    def singles(self) -> dict[str, Scored]:
        """Each effect type at its best site, the best type first."""
        out, v = {}, self.variant
        for kind, own in self.kinds.items():
            entry, at = entry_of(kind), np.stack([self.spans[j] for j in own])
            best, amplitudes = np.full(len(own), -np.inf), np.zeros(at.shape)
            for alone, M, b in self.ladder:
                values, a = evidence(M[at[:, :, None], at[:, None]], b[at], entry.one_sided)
                amplitudes = np.where((alone + values > best)[:, None], a, amplitudes)
                best = np.maximum(best, alone + values)
            self.best[kind] = best, amplitudes
            k, cost = int(np.argmax(best)), price(entry, v.context, v.settings)
            gain = float(special.logsumexp(best) - np.log(len(best)) - self.base - cost)
            out[kind] = Scored(gain, self.wanted[own[k]], self._bounded(own[k], amplitudes[k]))
        return dict(sorted(out.items(), key=lambda item: -item[1].gain))

    def pairs(self) -> list[tuple[Scored, Scored]]:
        """Pairs of effect types, each at one of its best sites, by their gain together; that is the gain of the first."""
        singles, out = self.singles(), []
        near = {kind: np.argsort(-self.best[kind][0])[:_SITES] for kind in singles}
        for first, second in combinations(singles, 2):
            if contained(first, (second,)):
                continue
            e, f = entry_of(first), entry_of(second)
            sites = [(self.kinds[first][p], self.kinds[second][q]) for p in near[first] for q in near[second]]
            at, most = np.stack([np.r_[self.spans[i], self.spans[j]] for i, j in sites]), (-np.inf, 0, np.zeros(0))
            for alone, M, b in self.ladder[-len(_NOISE) :]:  # without a discrepancy
                values, a = evidence(M[at[:, :, None], at[:, None]], b[at], (*e.one_sided, *f.one_sided))
                k = int(np.argmax(values))
                most = max(most, (alone + float(values[k]), k, a[k]), key=lambda found: found[0])
            value, k, a = most
            cost = sum(price(x, self.variant.context, self.variant.settings) for x in (e, f))
            gain = value - self.base - cost - np.log(len(self.kinds[first]) * len(self.kinds[second]) / len(sites))
            (i, j), split = sites[k], len(e.amplitudes)
            parts = [Scored(gain, self.wanted[n], self._bounded(n, x)) for n, x in ((i, a[:split]), (j, a[split:]))]
            out.append((parts[0], parts[1]))
        return sorted(out, key=lambda pair: -pair[0].gain)

    def _bounded(self, j: int, amplitudes) -> np.ndarray:
        """Amplitudes of a component in their own units, within their bounds."""
        entry, context = self.wanted[j].entry, self.variant.context
        return np.clip(amplitudes * entry.size(context), *entry.bounds(context))


def scored(h: Fitted) -> dict[str, Scored]:
    """Every effect type that is not in a hypothesis to first order beside it, the best first."""
    return Screen(h).singles()


def evidence(M, b, one_sided) -> tuple[np.ndarray, np.ndarray]:
    """Log Bayes factors (k,) of columns of unit size with information ``M`` (k, a, a) and scores ``b`` (k, a), averaged over
    sizes, and amplitudes (k, a)."""
    d, V = np.linalg.eigh(M)
    d, vb, t = np.maximum(d, 0.0), np.einsum("kij,ki->kj", V, b), np.array(SIZES)[:, None, None]
    own = d + t**-2
    values = 0.5 * np.sum(vb**2 / own, axis=2) - 0.5 * np.sum(np.log(t**2 * own), axis=2)
    if any(one_sided):
        mean, sd = np.einsum("kij,tkj->tki", V, vb / own), np.sqrt(np.einsum("kij,tkj->tki", V**2, 1.0 / own))
        values += np.sum((np.log(2.0) + special.log_ndtr(mean / sd)) * np.array(one_sided), axis=2)
    likeliest = np.array(SIZES)[np.argmax(values, axis=0)]
    return special.logsumexp(values, axis=0) - np.log(len(t)), np.einsum("kij,kj->ki", V, vb / (d + likeliest[:, None] ** -2))
