"""Reported quantities of refits: estimates with intervals, poses before and after, effects in the format's parameters."""

from dataclasses import replace

import numpy as np

from scan2flex_jax.diagnosis import confirm, floors, locate
from scan2flex_jax.diagnosis.families import DESCRIBED
from scan2flex_jax.diagnosis.refit import Refit, configurations
from scan2flex_jax.diagnosis.result import PoseChange, Ranked
from scan2flex_jax.diagnosis.sensitivity import Numbers
from scan2flex_jax.effects.catalogue import entry_of
from scan2flex_jax.fitting.discrepancy import Discrepancy, most_likely_part
from scan2flex_jax.fitting.estimate import Estimate, estimate_of
from scan2flex_jax.fitting.law import KINDS, Law, law_at
from scan2flex_jax.fitting.parameters import layout_of
from scan2flex_jax.statics.verdict import SOLVED
from scan2flex_jax.study.kinds import kind_format, kind_names, split_name
from scan2flex_jax.study.model import EffectDeclaration, Unknown

_LEAST_FREEDOM = 2  # degrees of freedom of an interval: from two poses, one would be no interval
_WAY = (0.0, 0.25, 0.5, 0.75, 1.0)  # continuation from a model without effects to one with them


def parameters_of(bench, found: Refit, k: int) -> dict:
    """Component ``k`` in the format's parameters."""
    c = found.components[k]
    return c.entry.to_parameters(found.amplitudes(bench, k), c.site, bench.context)


def spreads_of(stage, found: Refit, k: int) -> dict:
    """Standard errors of the parameters of component ``k``, by differences along its amplitudes and sites."""
    bench, c = stage.bench, found.components[k]
    numbers = Numbers(bench, found.components)
    at = np.r_[numbers.amplitudes(k), numbers.site(k)]
    cov = np.nan_to_num(confirm.uncertainty(stage, found)[np.ix_(at, at)])
    split = len(c.entry.amplitudes)

    def flat(x):
        site = c.site | dict(zip(c.moving, (float(v) for v in x[split:]), strict=True))
        p = c.entry.to_parameters(x[:split], site, bench.context)
        return {name: np.asarray(v, float) for name, v in p.items()}

    x = np.r_[found.vector[at]]
    total = {name: np.zeros_like(v) for name, v in flat(x).items()}
    values, vectors = np.linalg.eigh(cov)
    for v, u in zip(np.sqrt(np.maximum(values, 0.0)), vectors.T, strict=True):
        up, down = flat(x + 1e-3 * v * u), flat(x - 1e-3 * v * u)
        with np.errstate(invalid="ignore"):
            total = {n: t + np.nan_to_num((up[n] - down[n]) / 2e-3) ** 2 for n, t in total.items()}
    return {name: np.sqrt(t) for name, t in total.items()}


def estimates(stage, tied: list[Refit], best: Refit, alike: bool = False, least: Refit | None = None) -> dict[str, Estimate]:
    """Values at the best refit; intervals include those tied with it, weighted by evidence or, if ``alike``, equally. They are
    wide enough to include the refit ``least`` with its standard errors: the baseline model where no effect is established.

    With a discrepancy they are those of Student's t with one degree of freedom fewer than poses, two at least: its size is
    known from the scatter between the poses. Reference: Cameron and Miller, "A practitioner's guide to cluster-robust
    inference" (2015), section VI.
    """
    bench, layout, out = stage.bench, stage.bench.layout, {}
    weights = np.exp([0.0 if alike else min(r.log_evidence - best.log_evidence, 0.0) for r in tied])
    weights /= weights.sum()
    rescale = [_rescaled(bench, r) for r in tied]
    own = _rescaled(bench, best)
    covariances = [confirm.uncertainty(stage, r) for r in tied]
    freedom = float(max(bench.poses.count - 1, _LEAST_FREEDOM)) if any(r.law.curvature for r in tied) else np.inf
    for slot in layout.slots:
        here = slice(slot.at, slot.at + slot.size)
        shift = [np.log(f.get(slot.name, 1.0)) if slot.log else 0.0 for f in rescale]
        S = slot.sums
        centre = S @ best.vector[here] + (np.log(own.get(slot.name, 1.0)) if slot.log else 0.0)
        moves = [S @ r.vector[here] + s - centre for r, s in zip(tied, shift, strict=True)]
        variances = [np.diag(S @ C[here, here] @ S.T) for C in covariances]
        spread = np.sqrt(sum(w * (v + m**2) for w, v, m in zip(weights, variances, moves, strict=True)))
        if least is not None:
            alone = np.diag(S @ confirm.uncertainty(stage, least)[here, here] @ S.T)
            spread = np.maximum(spread, np.hypot(np.sqrt(alone), S @ least.vector[here] - centre))
        out[slot.name] = estimate_of(slot, centre, spread, own=best.vector[here], freedom=freedom)
    return out


def _rescaled(bench, found):
    factors: dict = {}
    for k, c in enumerate(found.components):
        factors |= c.entry.rescaled(found.amplitudes(bench, k), c.site, bench.context)
    return factors


def residuals(bench, shapes):
    """Per pose ``(residual (m, 3), s, solved)`` of its real points."""
    return [(s.residual[k], s.s[k], int(s.verdict.code) == 0) for s, k in zip(shapes, bench.real, strict=True)]


def rms(bench, shapes) -> float:
    """Root mean square distance (m); NaN if a pose is not solved."""
    rows = residuals(bench, shapes)
    if not all(ok for *_, ok in rows):
        return float("nan")
    return float(np.sqrt(sum(np.sum(r**2) for r, *_ in rows) / sum(len(r) for r, *_ in rows)))


def nearest_rms(stage, found: Refit) -> float:
    """Root mean square distance (m) of the shapes of a model nearest to the curves: under a large discrepancy of each pose its
    refit may leave more."""
    return rms(stage.bench, floors.nearest(stage.of, found).shapes)


def predicted(bench, found: Refit, near: Refit | None = None):
    """Shapes of the poses of ``bench`` at a refit's shared parameters and effects.

    Poses that are not solved from their measured curves are continued from the shapes of the model ``near``, without effects.
    """
    numbers = Numbers(bench, found.components)
    vector = np.zeros(numbers.count)
    vector[: numbers.shared] = found.vector[: numbers.shared]
    vector[numbers.base :] = found.vector[len(found.vector) - (numbers.count - numbers.base) :]
    shapes = bench.shapes(found.components, vector, derivative=False)
    if near is None or all(_solved(shape) for shape in shapes):
        return shapes
    begin = vector.copy()
    begin[: numbers.shared] = near.vector[: numbers.shared]
    for k in range(len(found.components)):
        begin[numbers.amplitudes(k)] = 0.0
    continued, start = shapes, None
    for t in _WAY:
        continued = bench.shapes(found.components, begin + t * (vector - begin), start, derivative=False)
        start = configurations(continued)
    return [own if _solved(own) else other for own, other in zip(shapes, continued, strict=True)]


def _solved(shape):
    return int(shape.verdict.code) == SOLVED and bool(np.all(np.isfinite(shape.residual)))


def pose_changes(study_poses, bench, before, after, unseen=None) -> dict[str, PoseChange]:
    """Poses of one bench before and after; ``unseen`` (poses, 2): their leave-one-pose-out RMS (m), before and after."""
    out = {}
    for i, pose in enumerate(study_poses):
        (r0, _, ok0), (r1, s, ok1) = residuals(bench, before)[i], residuals(bench, after)[i]
        size = [np.linalg.norm(r, axis=1) if ok else np.full(len(r), np.nan) for r, ok in ((r0, ok0), (r1, ok1))]
        was, now = (float(np.sqrt(np.mean(d**2))) for d in size)
        points = np.asarray(bench.poses.points[i])[bench.real[i]]
        modelled = np.asarray(after[i].configuration.r)
        known = (None, None) if unseen is None else tuple(float(v) for v in unseen[i])
        out[pose.name] = PoseChange(
            role=pose.role, rms_before=was, rms=now, worst=float(np.max(size[1])), stable=ok1, s=s, residual_before=r0,
            residual=r1, measured=points, modelled=modelled, left_out_before=known[0], left_out=known[1],
        )  # fmt: skip
    return out


def ranked(stage, found: Refit, k: int, **known) -> Ranked:
    """A refitted effect type."""
    return Ranked(found.components[k].kind, parameters_of(stage.bench, found, k), std=spreads_of(stage, found, k), **known)


def declared(study, estimates_after, chosen):
    """The study with the chosen effects declared and the estimates as values and guesses."""
    cable = dict(study.cable) | {n: e.value for n, e in estimates_after.items() if "." not in n}
    unknowns = tuple(replace(u, guess=estimates_after[u.name].value) for u in study.unknowns)
    add = tuple(EffectDeclaration(r.kind, r.parameters) for r in chosen if r.kind in kind_names())
    unknowns = tuple(_numbered(study, u) if u.name.startswith(tuple(f"{e.kind}." for e in add)) else u for u in unknowns)
    return replace(study, cable=cable, unknowns=unknowns, effects=(*study.effects, *add))


def _numbered(study, unknown):
    """An unknown of an effect whose kind is added once more, under the number of its effect."""
    kind, number, parameter = split_name(unknown.name)
    places = study.effects_of(unknown.name)
    if number or len(places) > 1:
        return unknown
    number = sum(e.kind == kind for e in study.effects[: places[0] + 1])
    return replace(unknown, name=f"{kind}[{number}].{parameter}")


def description(found) -> Ranked:
    """The discrepancy field that describes an unexplained residual: curvature or load, whichever is likelier. Not physics."""
    fields = {name: locate.common_field(found.stage, name) for name in DESCRIBED}
    likeliest = max(fields, key=lambda name: fields[name].gain)
    f, d = fields[likeliest], DESCRIBED[likeliest]
    return Ranked(
        d.effect.kind, {d.parameter: f.mean}, f.gain, found.test.p_value, "description", std={d.parameter: f.std}
    )  # fmt: skip


def laws(found, refitted: Refit) -> tuple[Law, ...]:
    """The moment laws of a refit with their bands and what is read off them; their p-value is that of the baseline model."""
    bench, out, covariance = found.stage.bench, [], confirm.uncertainty(found.stage, refitted)
    study, base = bench.problem.study, np.arange(bench.layout.unknowns)
    for k, c in enumerate(refitted.components):
        if c.kind not in KINDS:
            continue
        form = next(p for p in kind_format(c.kind).parameters if p.walk)
        given = {name: v for name, v in parameters_of(bench, refitted, k).items() if name != form.name}
        effects = (*study.effects, EffectDeclaration(c.kind, given))
        declared = replace(study, effects=effects, unknowns=(*study.unknowns, Unknown(f"{c.kind}.{form.name}")))
        at = np.r_[base, Numbers(bench, refitted.components).amplitudes(k)]
        known = refitted.vector[at], covariance[np.ix_(at, at)], bench.rods(refitted)
        out.append(law_at(c.kind, declared, layout_of(declared), *known, lambda secant: found.test.p_value))
    return tuple(out)


def settle_sentences(kinds) -> tuple[str, ...]:
    """The measurements that would distinguish these effect types, in the order of their names."""
    return tuple(f"{kind}: {entry_of(kind).settle}" for kind in sorted(set(kinds)))


def discrepancy(bench, found: Refit) -> Discrepancy:
    """The discrepancy of the poses given a refit."""
    law, length, moved = found.law, bench.context.length, []
    if not law.curvature:
        return Discrepancy(length=length)
    columns = tuple(Z[keep] for Z, keep in zip(law.scatter, bench.real, strict=True))
    for i, (shape, place, Z) in enumerate(zip(found.shapes, law.places, law.scatter, strict=True)):
        residual = place.take(shape, shape.residual[:, :, None])[:, :, 0]
        moved.append(most_likely_part(law.curvature, Z[place.keep], residual, law.covariance(i, place.s)))
    return Discrepancy(law.curvature, length, columns, tuple(moved))


def scatter(found, refitted: Refit) -> dict[str, float]:
    """Relative scatter between poses of every estimated size, by parameter name."""
    out: dict[str, float] = {}
    bench = found.stage.bench
    for k, c in enumerate(refitted.components):
        value = confirm.scatter(found.stage, refitted, k)
        names = [name for name in parameters_of(bench, refitted, k) if name not in (*c.site, "s")]
        out |= {f"{c.kind}.{name}": value for name in names if value is not None}
    return out
