"""The search: from the plain fit to the candidates that are worth a refit, and the refits.

Stages, each using the last: noise beside the signatures, the base in the metric of that noise, the global test, one-step
evidence of every group, refits of the best kinds, pairs when one kind is not enough, and the test again after the best.
"""

from dataclasses import dataclass

import numpy as np

from scan2flex_jax.effects.catalogue import entry_of
from scan2flex_jax.explain import evidence, families, pairs, score, verdict
from scan2flex_jax.explain.refit import Refit, refit
from scan2flex_jax.explain.residual import Complement, noise_like, orthonormal, signature_basis, whiten
from scan2flex_jax.explain.sensitivity import Bench, Component, Numbers, all_components
from scan2flex_jax.fit.noise import Noise

REFITS, PAIR_REFITS, GREEDY_REFITS = 5, 3, 2
NOISE_LAWS = 8  # noises drawn beside the estimated one, for what the test does not know of the noise
_WORTH = 12.0  # nats behind the best one-step evidence beyond which a refit cannot catch up


@dataclass
class Stage:
    """All that the scores rest on: whitened residual, groups (one per component), families, noise draws."""

    bench: Bench
    noise: Noise
    base: Refit
    components: list[Component]
    groups: list
    families: list
    white: object
    draws: np.ndarray
    y: np.ndarray
    Q: np.ndarray
    owner: np.ndarray

    def projected(self, extra=None):
        """``(y, draws, basis)`` beyond the base and ``extra`` columns."""
        Q = self.Q if extra is None else orthonormal(np.column_stack([self.Q, extra]))
        return self.white.r - Q @ (Q.T @ self.white.r), self.draws - Q @ (Q.T @ self.draws), Q


def prepare(bench: Bench, minimum, stated, seed: int = 0) -> Stage:
    """Signatures, noise, the base refitted in its metric, and the groups."""
    vector = np.r_[minimum.shared, np.asarray(minimum.local).ravel()]
    components = all_components(bench.context)
    start = minimum.evaluation.configuration
    shapes = bench.shapes((), vector)
    columns, owner = bench.catalogue_columns(vector, components, start)
    fields = families.ghost_columns(bench, vector, start)
    numbers = Numbers(bench, ())
    noise, complement = _noise(bench, shapes, numbers, vector, columns, fields, stated)
    base = refit(bench, (), noise, vector, most=6)
    white = whiten(base.shapes, bench.real, numbers, base.vector, noise)
    S, Q = -white.stack(columns), white.base
    groups = [
        score.group_of(k, S[:, owner == k], c.entry.size(bench.context), Q, c.entry.one_sided)
        for k, c in enumerate(components)
    ]
    rng = np.random.default_rng(seed)
    laws = [noise, *complement.draws(noise, NOISE_LAWS, rng)]
    draws = noise_like(white, base.shapes, laws, score.DRAWS, rng)
    found = families.families(white, fields, S, owner, components, Q)
    stage = Stage(bench, noise, base, components, groups, found, white, draws, white.r, Q, owner)
    stage.y, stage.draws, _ = stage.projected()
    return stage


def _noise(bench, shapes, numbers, vector, columns, fields, stated):
    size = np.sqrt(np.mean([np.mean(s.residual[k] ** 2) for s, k in zip(shapes, bench.real, strict=True)]))
    plain = Noise(max(size, 1e-9), 1e-3 * max(size, 1e-9), 0.05 * bench.context.length)
    white = whiten(shapes, bench.real, numbers, vector, plain)
    every = np.concatenate([white.stack(columns), white.stack(fields["curvature"]), white.stack(fields["load"])], axis=1)
    basis = signature_basis(every, white.base)
    parts = [basis[rows].reshape(-1, 2, basis.shape[1]) for rows in white.rows]
    complement = Complement(shapes, bench.real, numbers, vector, parts, bench.context.length, stated)
    return complement.estimate(), complement


def test(stage: Stage, extra=None, r=None) -> score.Test:
    """The global test, of the base or (with ``extra`` columns taken out and residual ``r``) after an effect."""
    y, draws, Q = stage.y, stage.draws, stage.Q
    groups, ghosts = stage.groups, {f.name: f.gain for f in stage.families}
    if extra is not None:
        Q = orthonormal(np.column_stack([stage.Q, extra]))
        y, draws = r - Q @ (Q.T @ r), draws - Q @ (Q.T @ draws)
        ones = [np.ones(g.X.shape[1]) for g in stage.groups]
        groups = [score.group_of(g.owner, g.X, o, Q, g.one_sided) for g, o in zip(stage.groups, ones, strict=True)]
        ghosts = {f.name: families.family_of(f.name, f.U * f.d, Q).gain for f in stage.families}
    return score.global_test(groups, ghosts, y, draws, len(y) - Q.shape[1])


def one_step(stage: Stage):
    """Per group ``(log evidence, amplitudes)``, and per kind the averaged evidence and its best group."""
    values, amplitudes = np.full(len(stage.groups), -np.inf), []
    for g, group in enumerate(stage.groups):
        A, b = group.X.T @ group.X, group.X.T @ stage.y
        values[g] = evidence.log_evidence(A, b, group.one_sided)
        a = evidence.one_step(A, b) * stage.components[g].entry.size(stage.bench.context)
        amplitudes.append(np.clip(a, *stage.components[g].entry.bounds(stage.bench.context)))
    kinds = [c.kind for c in stage.components]
    table = {}
    for kind in dict.fromkeys(kinds):
        own = [g for g in range(len(kinds)) if kinds[g] == kind]
        table[kind] = (evidence.averaged(values[own]), max(own, key=lambda g: values[g]))
    return values, amplitudes, table


def refit_singles(stage: Stage, amplitudes, table, statistics, progress) -> list[Refit]:
    """Refits of the best kinds by evidence, and of the best by BIC; evidence relative to the base."""
    n = len(stage.y)
    order = sorted(table, key=lambda k: -table[k][0])
    worth = [k for k in order[:REFITS] if table[k][0] > table[order[0]][0] - _WORTH]
    bic = {k: evidence.bic(statistics[table[k][1]], stage.groups[table[k][1]].rank, n) for k in table}
    worth += [k for k in sorted(bic, key=lambda k: -bic[k])[:2] if k not in worth]
    best = stage.components[table[order[0]][1]].entry
    rivals = [k for k in table if k in dict(best.same_shapes) or best.kind in dict(entry_of(k).same_shapes)]
    worth += [k for k in rivals if k not in worth and bic[k] > 0.5 * bic[order[0]]]
    out = []
    for kind in worth:
        progress(f"refit with {kind}")
        g = table[kind][1]
        out.append(_relative(stage, [stage.components[g]], [amplitudes[g]]))
    return sorted(out, key=lambda r: -r.log_evidence)


def refit_pairs(stage: Stage, values, progress) -> list[Refit]:
    """Refits of the best pairs of kinds."""
    kinds = [c.kind for c in stage.components]
    out = []
    for _, i, j in pairs.best_pairs(stage.groups, stage.y, values, kinds, PAIR_REFITS):
        progress(f"refit with {kinds[i]} and {kinds[j]}")
        X = np.column_stack([stage.groups[i].X, stage.groups[j].X])
        a = evidence.one_step(X.T @ X, X.T @ stage.y)
        size = [stage.components[g].entry.size(stage.bench.context) for g in (i, j)]
        split = len(size[0])
        out.append(_relative(stage, [stage.components[i], stage.components[j]], [a[:split] * size[0], a[split:] * size[1]]))
    return sorted(out, key=lambda r: -r.log_evidence)


def one_of_each(found: list[Refit]) -> list[Refit]:
    """The best refit of each set of kinds, best first."""
    best = {}
    for r in sorted(found, key=lambda r: r.log_evidence):
        best[frozenset(r.kinds)] = r
    return sorted(best.values(), key=lambda r: -r.log_evidence)


def refit_greedy(stage: Stage, single: Refit, progress) -> list[Refit]:
    """Refits of a second kind beside the best one, ranked at that one's refit: right where the first is far from linear."""
    numbers = Numbers(stage.bench, single.components)
    white = whiten(single.shapes, stage.bench.real, numbers, single.vector, stage.noise)
    Q = orthonormal(white.J)
    y, best = white.r - Q @ (Q.T @ white.r), {}
    for g, group in enumerate(stage.groups):
        X = group.X - Q @ (Q.T @ group.X)
        A, b = X.T @ X, X.T @ y
        value, kind = evidence.log_evidence(A, b, group.one_sided), stage.components[g].kind
        if kind not in single.kinds and (kind not in best or value > best[kind][0]):
            best[kind] = value, g, evidence.one_step(A, b) * stage.components[g].entry.size(stage.bench.context)
    out = []
    for _, g, a in sorted(best.values(), key=lambda item: -item[0])[:GREEDY_REFITS]:
        progress(f"refit with {single.kinds[0]} and {stage.components[g].kind}")
        first = [single.amplitudes(stage.bench, k) for k in range(len(single.components))]
        out.append(_relative(stage, [*single.components, stage.components[g]], [*first, a]))
    return out


def same_shapes(found: Refit) -> tuple[str, ...]:
    """Kinds that shapes alone cannot tell from a refit's, under the conditions that the catalogue states."""
    return tuple(other for c in found.components for other, _ in c.entry.same_shapes)


def _relative(stage, components, amplitudes):
    found = refit(stage.bench, components, stage.noise, stage.base.vector, amplitudes)
    found.log_evidence -= stage.base.log_evidence
    for c in components:  # choices between sites that are not continuous
        discrete = {str({k: v for k, v in s.items() if k not in c.moving}) for s in c.entry.sites(stage.bench.context)}
        found.log_evidence -= np.log(len(discrete))
    return found


def test_after(stage: Stage, found: Refit) -> score.Test:
    """The global test with the effect in the model."""
    numbers = Numbers(stage.bench, found.components)
    white = whiten(found.shapes, stage.bench.real, numbers, found.vector, stage.noise)
    return test(stage, orthonormal(white.J), white.r)


def accepted(p_after: float, single: Refit, pair: Refit | None) -> bool:
    """Whether the pair is worth its second effect: the single one leaves structure, and the pair wins by three nats."""
    return pair is not None and p_after <= verdict.ALARM and pair.log_evidence > single.log_evidence + verdict.LEAD_FAVOURED
