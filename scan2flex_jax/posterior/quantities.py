"""What a hypothesis says: estimates, poses before and after, predictions, the parameters of its effects, where a cause acts."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import special  # `scipy.stats` imports for longer than a whole fit lasts

from scan2flex_jax.effects.catalogue import entry_of
from scan2flex_jax.effects.distributed_load import DistributedLoad
from scan2flex_jax.fitting.discrepancy import Discrepancy, most_likely_part
from scan2flex_jax.fitting.parameters import layout_of
from scan2flex_jax.geometry.fields import POINTS, smooth_root
from scan2flex_jax.posterior.determined import Uncertainty, ends, listed, uncertainty
from scan2flex_jax.posterior.estimate import NORMAL_95, Estimate, estimate_of
from scan2flex_jax.posterior.law import KINDS, STIFFNESS, Law, law_at
from scan2flex_jax.posterior.likelihood import inverted, without
from scan2flex_jax.posterior.loops import Loop, loops_of
from scan2flex_jax.posterior.posterior import Fitted, configuration, solved
from scan2flex_jax.posterior.priors import Prior
from scan2flex_jax.posterior.program import Component
from scan2flex_jax.posterior.rows import Rows
from scan2flex_jax.statics.verdict import SOLVED
from scan2flex_jax.study.kinds import kind_format, kind_names, split_name
from scan2flex_jax.study.model import EffectDeclaration, Study, Unknown

_FEWEST_FREEDOM = 2  # degrees of freedom of an interval: from two poses, one would be no interval
_ANY, _HELD = 1e-4, 3.0  # precision of an effect of any size over the usual one; growth of a standard error that it may cause


def parameters_of(h: Fitted, k: int) -> dict:
    """Component ``k`` in the format's parameters."""
    c = h.components[k]
    return c.entry.parameters(h.amplitudes(k), c.site, h.variant.context)


def spreads_of(h: Fitted, k: int) -> dict:
    """Standard errors of the parameters of component ``k``, by differences along its amplitudes and sites."""
    c, at = h.components[k], np.r_[h.index.amplitudes(k), h.index.site(k)]
    split, x = len(c.entry.amplitudes), h.x[at]

    def flat(v):
        site = c.site | dict(zip(c.moving, (float(value) for value in v[split:]), strict=True))
        return {n: np.asarray(p, float) for n, p in c.entry.parameters(v[:split], site, h.variant.context).items()}

    total = {name: np.zeros_like(v) for name, v in flat(x).items()}
    values, vectors = np.linalg.eigh(np.nan_to_num(h.covariance[np.ix_(at, at)]))
    for v, u in zip(np.sqrt(np.maximum(values, 0.0)), vectors.T, strict=True):
        up, down = flat(x + 1e-3 * v * u), flat(x - 1e-3 * v * u)
        with np.errstate(invalid="ignore"):
            total = {n: t + np.nan_to_num((up[n] - down[n]) / 2e-3) ** 2 for n, t in total.items()}
    return {name: np.sqrt(t) for name, t in total.items()}


def estimates(best: Fitted, averaged: tuple[Fitted, ...]) -> dict[str, Estimate]:
    """Values at the best hypothesis; intervals average over all likely ones, by their evidence.

    With a discrepancy they are those of Student's t with one degree of freedom fewer than poses: its size is known from the
    scatter between them (Cameron and Miller, "A practitioner's guide to cluster-robust inference", 2015, section VI).
    """
    v, out, layout = best.variant, {}, best.variant.program.layout
    hypotheses, weights, freedom = _averaging(best, averaged)
    own = known(best)
    for slot in layout.slots:
        here, S = slice(slot.at, slot.at + slot.size), slot.sums
        lost = ~own.identifiable[here]
        shifts = [np.log(_rescaled(h).get(slot.name, 1.0)) if slot.log else 0.0 for h in hypotheses]
        shift = dict(zip(map(id, hypotheses), shifts, strict=True))[id(best)]
        centre = S @ best.x[here] + shift
        moves = [S @ h.x[here] + d - centre for h, d in zip(hypotheses, shifts, strict=True)]
        mine = np.where(lost, 0.0, own.covariance[here, here])
        covariances = [mine if h is best else h.covariance[here, here] for h in hypotheses]
        variances = [np.diag(S @ C @ S.T) for C in covariances]
        spread = np.sqrt(sum(w * (a + m**2) for w, a, m in zip(weights, variances, moves, strict=True)))
        out[slot.name] = estimate_of(
            slot, centre, np.where(lost, np.inf, spread), own=best.x[here], determined=bool(np.all(own.determined[here])),
            seen=not np.any(lost), vaguest=v.settings.vaguest_interval, freedom=freedom,
        )  # fmt: skip
    return out


def _averaging(best: Fitted, averaged: tuple[Fitted, ...]) -> tuple[list[Fitted], np.ndarray, float]:
    """Hypotheses over which an interval averages, their weights, and its degrees of freedom."""
    hypotheses = [h for h in averaged if h is best or _comparable(h, best)]
    hypotheses = hypotheses if best in hypotheses else [best, *hypotheses]
    weights = np.exp(np.array([h.score for h in hypotheses]) - max(h.score for h in hypotheses))
    weights = np.maximum(weights, [float(h is best) for h in hypotheses])
    discrepant = any(h.discrepant for h in hypotheses)
    freedom = float(max(len(best.variant.groups) - 1, _FEWEST_FREEDOM)) if discrepant else np.inf
    return hypotheses, weights / weights.sum(), freedom


def averaging(best: Fitted, averaged: tuple[Fitted, ...]) -> tuple[list[Fitted], np.ndarray, float]:
    """Hypotheses over which an interval averages, their weights, and the quantile of its two-sided 95 %."""
    hypotheses, weights, freedom = _averaging(best, averaged)
    return hypotheses, weights, NORMAL_95 if np.isinf(freedom) else float(special.stdtrit(freedom, 0.975))


def _comparable(h: Fitted, best: Fitted) -> bool:
    """Whether a hypothesis has the unknowns of another, in their places: memory has more, after them."""
    ours, theirs = best.variant.program.layout.slots, h.variant.program.layout.slots
    return [s.name for s in theirs[: len(ours)]] == [s.name for s in ours]


def known(h: Fitted) -> Uncertainty:
    """Which unknowns the poses determine, and their covariance, without the weak priors that only hold the others in place."""
    v, (wr, wX) = h.variant, h.variant.likelihood.white(h.u, h.linear)
    layout, prior = v.program.layout, Prior(v.program, h.components, h.wider)
    A, _ = h.linear.normal(wr, wX)
    A -= np.diag(np.where(prior.frozen, 0.0, prior.weak + prior.width))
    meaningless, said = ends(v.study, layout, h.x[: layout.unknowns], v.length)
    held = _held_by_size(h, A, prior) & ~meaningless
    if np.any(held):
        names = listed([label for label, one in zip(layout.labels, held, strict=True) if one])
        said.append(f"beside {listed([k.replace('_', ' ') for k in h.kinds])} of any size these poses do not determine {names}")
    found = uncertainty(layout, A, meaningless | held)
    return replace(found, sentences=(*found.sentences, *said))


def _held_by_size(h: Fitted, A: np.ndarray, prior: Prior) -> np.ndarray:
    """Mask of the unknowns that only the usual size of an effect holds: their standard errors grow where it may have any size.
    The amplitudes of fields and laws are many, and defined by their prior."""
    n, change = h.index, np.zeros(len(A))
    for k, c in enumerate(h.components):
        if not (c.entry.field or c.entry.varies):
            at = n.amplitudes(k)
            change[at] = np.where(prior.frozen[at], 0.0, (1.0 - _ANY) * prior.precision[at])
    own = slice(h.variant.program.layout.unknowns)
    usual, free = (np.diag(inverted(B)[1])[own] for B in (A, A - np.diag(change)))
    return free > _HELD**2 * usual


def _rescaled(h):
    factors: dict = {}
    for k, c in enumerate(h.components):
        factors |= c.entry.rescaled(h.amplitudes(k), c.site, h.variant.context)
    return factors


def surprise(h: Fitted, most: float) -> dict[str, float]:
    """The validate poses whose distance exceeds ``most`` times what the hypothesis expects of it, and by how many times."""
    return {name: ratio for name, ratio in ratios(h).items() if ratio > most}


def ratios(h: Fitted) -> dict[str, float]:
    """Per validate pose its distance over that which the hypothesis expects, from noise, discrepancy, tolerances, and the
    errors of the parameters; infinite without an equilibrium."""
    v, n, found, poses = h.variant, h.index, h.predicted, h.variant.study.validate_poses
    good = [i for i, shape in enumerate(found) if solved([shape])]
    out = dict.fromkeys((pose.name for pose in poses), np.inf)
    if v.held_out is None or not good:
        return out
    shared = np.r_[np.arange(n.shared), np.arange(n.base, n.count)]
    free = ~Prior(v.program, h.components, h.wider).frozen[shared]
    V = h.covariance[np.ix_(shared, shared)] * np.outer(free, free)
    program, shapes = v.held_out.only(good), [found[i] for i in good]
    rows, x = Rows(shapes, program), v.unseen_vector(h, program)
    r = rows.of(shapes, [s.residual[:, :, None] for s in shapes])[:, :, 0]
    X = rows.of(shapes, [s.columns for s in shapes])
    C, _ = v.likelihood.on(rows).covariance(h.u, rows.of(shapes, program.scatter(h.components, x, configuration(shapes))))
    local = np.isin(np.arange(X.shape[2]), n.shared + np.arange(n.local))
    J, own = X[:, :, ~local], X[:, :, local]
    variance = np.einsum("pnn->pn", C) + np.einsum("pni,ij,pnj->pn", J, V, J) + np.sum(own**2, axis=2)
    real = rows.measured
    ratio = np.sqrt(np.sum(r**2 * real, axis=1) / np.sum(variance * real, axis=1))
    return out | {poses[i].name: float(value) for i, value in zip(good, ratio, strict=True)}


def left_out(h: Fitted) -> np.ndarray:
    """Per pose the RMS distance (m) between its measured points and their prediction from the other poses, to first order."""
    v, lin, out = h.variant, h.linear, np.full(len(h.shapes), np.nan)
    wr, wX = v.likelihood.white(h.u, lin)
    for group, _, d in without(lin, wr, wX, v.groups):
        for i in group:
            shape, keep = h.shapes[i], v.program.poses.seen[i]
            if not np.any(keep):
                continue
            moved = shape.residual[keep] + shape.columns[keep] @ d[lin.at[i]]
            out[i] = np.sqrt(np.mean(np.sum(moved**2, axis=1)))
    return out


@dataclass(frozen=True)
class Field:
    """A field along the cable: ``s`` (k,) m, posterior ``mean`` and ``std`` (k, 3) in ``unit``."""

    s: np.ndarray
    mean: np.ndarray
    std: np.ndarray
    unit: str

    def to_json(self) -> dict:
        """Lists."""
        return {"s": self.s.tolist(), "mean": self.mean.tolist(), "std": self.std.tolist(), "unit": self.unit}


def equivalent_loads(h: Fitted) -> tuple[Field, tuple[Field, ...]]:
    """The load (N/m, scan frame) that would cause the residual of a hypothesis, common to all poses and of each pose: where an
    effect acts, not which. A Gaussian process along the cable whose size is the likeliest; balance holds by construction.
    """
    v, entry = h.variant, entry_of(DistributedLoad.kind)
    columns, _ = v.program.columns(h.components, h.x, h.configuration, [Component(entry.kind, {})])
    wr, wX, wS = v.likelihood.white(h.u, h.linear, v.rows.of(h.shapes, columns))
    A, g = h.linear.normal(wr, wX)
    _, inverse = inverted(A)
    size, root = entry.size(v.context), smooth_root(POINTS, 3)

    def of(poses):
        cross, S, y = np.zeros((len(A), wS.shape[2])), 0.0, 0.0
        for i in poses:
            cross[h.linear.at[i]] += wX[i].T @ wS[i]
            S, y = S + wS[i].T @ wS[i], y + wS[i].T @ wr[i]
        M, b = (S - cross.T @ inverse @ cross) * np.outer(size, size), -(y - cross.T @ inverse @ g) * size
        d, V = np.linalg.eigh(0.5 * (M + M.T))
        d, vb, t = np.maximum(d, 0.0), V.T @ b, np.geomspace(1e-3, 1e2, 60)[:, None]
        gain = np.sum(0.5 * vb**2 * t**2 / (1 + d * t**2) - 0.5 * np.log1p(d * t**2), axis=1)
        best = float(t[np.argmax(gain), 0])
        P = root * size
        mean = P @ (V @ (vb * best**2 / (1 + d * best**2)))
        std = np.sqrt(np.sum((P @ V) ** 2 * best**2 / (1 + d * best**2), axis=1))
        s = np.linspace(0.0, v.length, POINTS)
        return Field(s, mean.reshape(POINTS, 3), std.reshape(POINTS, 3), "N/m")

    every = range(len(h.linear.at))
    return of(every), tuple(of([i]) for i in every)


def discrepancy_of(h: Fitted) -> Discrepancy:
    """The discrepancy of the poses given a hypothesis."""
    v = h.variant
    if not h.discrepant:
        return Discrepancy(length=v.length)
    columns, moved, b, noise = [], [], float(np.exp(h.u[3])), v.likelihood.noise(h.u)
    for i, Z in enumerate(v.program.scatter(h.components, h.x, h.configuration)):
        keep, bins = v.program.poses.seen[i], v.rows.bins[i][: v.rows.points[i]]
        if not bins:
            continue
        at = np.concatenate([g[:1] for g in bins])
        columns.append(Z[keep])
        shape = h.shapes[i]
        moved.append(most_likely_part(b, Z[at], shape.residual[at], noise.covariance(shape.s[at])))
    return Discrepancy(b, v.length, tuple(columns), tuple(moved))


def scatter_of(h: Fitted) -> dict[str, float]:
    """Relative scatter between poses of the size of each effect: weighted deviation of the size that fits each pose by itself,
    to first order, all other parameters fixed; none for one pose and for sizes that are not estimated."""
    out: dict[str, float] = {}
    wr, wX = h.variant.likelihood.white(h.u, h.linear)
    for k, c in enumerate(h.components):
        at = h.index.amplitudes(k)
        size = h.x[at]
        if c.entry.continuation or not np.any(size) or len(wr) < 2:
            continue
        where = [[list(own).index(a) for a in at] for own in h.linear.at]
        column = np.stack([X[:, w] @ size for X, w in zip(wX, where, strict=True)])
        weight = np.sum(column**2, axis=1)
        if not np.any(weight):
            continue
        change = -np.sum(column * wr, axis=1) / np.maximum(weight, 1e-300)
        mean = np.sum(weight * change) / np.sum(weight)
        value = float(np.sqrt(np.sum(weight * (change - mean) ** 2) / np.sum(weight)))
        out |= {f"{c.kind}.{name}": value for name in parameters_of(h, k) if name not in (*c.site, "s")}
    return out


def declared(study: Study, estimates: dict[str, Estimate], more: Sequence[tuple[str, dict]] = ()) -> Study:
    """The study with the estimates as values and guesses, and ``more`` effects."""
    cable, effects = dict(study.cable), list(study.effects)
    for name, estimate in estimates.items():
        kind, number, parameter = split_name(name)
        places = study.effects_of(name)
        if kind and (number or len(places) == sum(e.kind == kind for e in effects)):  # else the name means those without it
            for i in places:
                effects[i] = replace(effects[i], parameters={**effects[i].parameters, parameter: estimate.value})
        elif not kind:
            cable[name] = estimate.value
    unknowns = tuple(replace(u, guess=estimates[u.name].value) for u in study.unknowns)
    add = tuple(EffectDeclaration(kind, parameters) for kind, parameters in more if kind in kind_names())
    unknowns = tuple(_numbered(study, u) if u.name.startswith(tuple(f"{e.kind}." for e in add)) else u for u in unknowns)
    return replace(study, cable=cable, unknowns=unknowns, effects=(*effects, *add))


def _numbered(study, unknown):
    """An unknown of an effect whose kind is added once more, under the number of its effect."""
    kind, number, _ = split_name(unknown.name)
    places = study.effects_of(unknown.name)
    if number or len(places) > 1:
        return unknown
    number = sum(e.kind == kind for e in study.effects[: places[0] + 1])
    return replace(unknown, name=f"{kind}[{number}].{split_name(unknown.name)[2]}")


def laws_of(h: Fitted, p_value: float = 0.0) -> tuple[Law, ...]:
    """The moment laws of a hypothesis with their bands and what is read off them: those that the study declares, and those of
    its effects, which have the ``p_value`` of the hypothesis."""
    v, out = h.variant, []
    study, layout = v.study, v.program.layout
    base = np.arange(layout.unknowns)
    kinds = {effect.kind for effect in study.effects} | set(h.kinds)
    rods = v.program.rods(h.components, h.x, h.shapes) if kinds & set(KINDS) else []
    for effect in study.effects:
        if effect.kind in KINDS:
            at = h.x[base], known(h).covariance, rods
            out.append(law_at(effect.kind, study, layout, *at, partial(linear_p_value, h, effect.kind)))
    for k, c in enumerate(h.components):
        if c.kind not in KINDS:
            continue
        form = next(p for p in kind_format(c.kind).parameters if p.walk)
        effect = EffectDeclaration(c.kind, {n: x for n, x in parameters_of(h, k).items() if n != form.name})
        whole = replace(study, effects=(*study.effects, effect), unknowns=(*study.unknowns, Unknown(f"{c.kind}.{form.name}")))
        at = np.r_[base, h.index.amplitudes(k)]
        out.append(law_at(c.kind, whole, layout_of(whole), h.x[at], h.covariance[np.ix_(at, at)], rods, lambda secant: p_value))
    return tuple(out)


def loops_in(h: Fitted) -> tuple[Loop, ...]:
    """What is read off the effects with memory of a hypothesis."""
    return loops_of(h.variant.program.rods(h.components, h.x, h.shapes)) if h.variant.study.history_dependent else ()


def linear_p_value(h: Fitted, kind: str, secant: float) -> float | None:
    """Probability of a gain as large as that of a declared law over the linear one if it is linear; None where the law is not
    estimated, or the fit has not settled.

    ``secant`` (N m^2): stiffness of the linear law to begin from. Under the noise and discrepancy of the linear law the gain is
    a sum of squares weighted by the eigenvalues of ``S^-1 (S - P)``: ``S`` the precision of the steps of the law after all
    other numbers followed, ``P`` that of their prior. A scaled chi-squared distribution of the same mean and variance gives its
    probability (Satterthwaite).
    """
    v, slots = h.variant, {slot.name: slot for slot in h.variant.program.layout.slots}
    slot, stiffness = slots.get(f"{kind}.factor"), slots.get(STIFFNESS[kind])
    if slot is None or not h.converged:
        return None
    own, x, Li = np.arange(slot.at, slot.at + slot.size), h.x.copy(), v.likelihood.whitening(h.u, h.linear.Z)
    x[own] = 0.0
    if stiffness is not None:
        x[stiffness.at : stiffness.at + stiffness.size] = np.log(secant)
    linear, prior = v.descended(x, h.shapes, Li, zero=own), Prior(v.program, ())
    if linear is None:
        return 0.0
    law = v.linear(linear[1], linear[0], (), prior)
    Li = v.likelihood.whitening(h.u, law.Z)  # of poses that yield less
    linear, free = v.descended(linear[0], linear[1], Li, zero=own), v.descended(h.x, h.shapes, Li)
    if linear is None or free is None:
        return 0.0
    law = v.linear(linear[1], linear[0], (), prior, scatter=False)
    A, _ = law.normal((Li @ law.r[:, :, None])[:, :, 0], Li @ law.X)
    rest = np.setdiff1d(np.arange(len(A)), own)
    cross = A[np.ix_(own, rest)]
    S = A[np.ix_(own, own)] - cross @ inverted(A[np.ix_(rest, rest)])[1] @ cross.T
    weights = np.maximum(np.linalg.eigvals(np.linalg.solve(S, S - np.diag(prior.precision[own]))).real, 0.0)
    mean, variance = np.sum(weights), 2.0 * np.sum(weights**2)
    gain, scale = max(linear[3] - free[3], 0.0), 0.5 * variance / mean
    return float(special.chdtrc(mean / scale, gain / scale))


def stable(shape) -> bool:
    """Whether a pose is a stable equilibrium."""
    return int(shape.verdict.code) == SOLVED
