"""Conclusion of a search: the models of the answer, the ranking, the poses before and after, and the explanation of them."""

import functools
import time

import numpy as np

from scan2flex_jax.diagnosis import confirm, locate, report, search, sentences, verdict
from scan2flex_jax.diagnosis.evidence import one_step
from scan2flex_jax.diagnosis.refit import Refit
from scan2flex_jax.diagnosis.result import Explanation, PoseChange, Ranked
from scan2flex_jax.diagnosis.search import Found
from scan2flex_jax.diagnosis.sensitivity import Bench


def explanation_of(base, found: Found, told: tuple[str, ...], began: float) -> Explanation:
    """The explanation of a search that began at ``began`` (s) from a `run.Base`, with the sentences ``told`` at its end."""
    bench, fitted = found.stage.bench, base.fit
    study, other = fitted.problem.study, None
    if study.validate_poses:
        other = Bench(bench.problem, fitted.minimum, bench.problem.held_out)
    # cached: a refit is ranked, and may be the answer
    predicted = functools.cache(lambda r: report.predicted(other, r, found.stage.base))
    refitted, ranking = _refitted(found), _ranking(found, other, predicted)
    law_of = found.floor if found.floor is not None and not refitted.components else refitted
    added = _chosen(found.stage, refitted, ranking)
    established, concluded = found.verdict in verdict.FOUND, found.verdict != verdict.UNSOLVED
    chosen = added if established else ()
    least = found.floor if found.verdict == verdict.UNEXPLAINED else None
    estimates = report.estimates(found.stage, likely_models(found), refitted, _alike(found), least)
    if least is not None:  # what is not explained does not narrow the intervals of the fit
        estimates = {name: e.including(fitted.estimates[name]) for name, e in estimates.items()}
    poses = _poses(study, found, other, refitted, predicted)
    description = report.description(found) if found.verdict == verdict.UNEXPLAINED else None
    constancy = found.constancy if refitted.kinds else None
    discrepancy, laws = report.discrepancy(bench, law_of), report.laws(found, refitted)
    return Explanation(
        study=report.declared(study, estimates, added) if added else fitted.calibrated,
        fit=fitted,
        verdict=found.verdict,
        p_value=found.test.p_value,
        p_after=found.after.p_value if found.after else None,
        noise=law_of.law.noise,
        discrepancy=discrepancy,
        scatter=report.scatter(found, refitted),
        added=added,
        ranking=ranking,
        chosen=chosen,
        estimates=estimates,
        poses=poses,
        families=found.test.family_gain,
        settle=report.settle_sentences({k for r in found.tied for k in r.kinds}) if found.verdict == verdict.TIE else (),
        sentences=(
            *sentences.of_search(found, chosen, description), *sentences.before_and_after(poses, added, established),
            *(s for law in laws for s in law.sentences()), *(sentences.of_discrepancy(discrepancy) if concluded else ()),
            *sentences.left_out(poses, chosen), *told,
        ),
        gates=base.gates | ({} if constancy is None else {"constancy": constancy}),
        seconds=time.perf_counter() - began,
        load=locate.common_field(found.stage, locate.LOAD),
        pose_loads=tuple(locate.pose_loads(found.stage)),
        description=description,
        laws=laws,
        search=found,
        settings=found.stage.settings,
    )


def _refitted(found):
    """The model of "after": the best one, even if not established, unless it is no likelier than the baseline model or predicts
    poses left out no better."""
    if found.verdict in verdict.FOUND:
        return found.best
    if found.verdict != verdict.UNEXPLAINED or not found.best.components:
        return found.stage.base
    if found.stage.bench.poses.count < 2:  # no pose can be left out
        return found.best if found.best.log_evidence > found.stage.settings.lead_named else found.stage.base
    better = found.best.log_evidence > 0 and confirm.compared(found.stage, found.best, found.baseline).better
    return found.best if better else found.stage.base


def likely_models(found: Found) -> list[Refit]:
    """The models that intervals include: those tied, or all likely ones if no effect was found."""
    if found.verdict in verdict.FOUND:
        return [*found.tied, *search.minima_elsewhere(found)]
    if found.verdict != verdict.UNEXPLAINED:
        return [found.baseline]
    if _alike(found):
        return [r for r in found.refits.values() if r.chi2 < found.stage.settings.near * found.best.chi2]
    most = max((r.log_evidence for r in found.refits.values()), default=0.0)
    likely = found.stage.settings.likely
    near = [r for r in found.refits.values() if r.log_evidence > most - likely]
    return [*near, found.baseline] if most < likely or not near else near


def _alike(found):
    """Whether models have equal weights in the intervals: they were not compared on poses left out, and their residuals are not
    noise, so that likelihoods at the sensor's noise are meaningless."""
    return found.verdict == verdict.UNEXPLAINED and found.floor is None and bool(found.best.components)


def _chosen(stage, refitted, ranking) -> tuple[Ranked, ...]:
    """The effects of the refitted model as ranked; several effects have the parameters and evidence of their joint refit."""
    chosen = tuple(next(r for r in ranking if r.kind == kind) for kind in refitted.kinds)
    if len(chosen) < 2:
        return chosen
    return tuple(
        report.ranked(stage, refitted, k, log_evidence=refitted.log_evidence, p_value=r.p_value, verdict=r.verdict,
                      tied_with=r.tied_with) for k, r in enumerate(chosen)
    )  # fmt: skip


def _poses(study, found, other, refitted, predicted) -> dict[str, PoseChange]:
    """Every pose before and after, in the order of the study; ``other``: the `Bench` of the ``validate`` poses, or None;
    ``predicted``: function of a refit to their shapes."""
    stage, unseen = found.stage, None
    if stage.bench.poses.count > 1:
        models = (found.baseline, refitted if refitted.components else found.baseline)
        unseen = np.transpose([confirm.left_out(stage, r) for r in models])
    poses = report.pose_changes(study.fit_poses, stage.bench, stage.base.shapes, refitted.shapes, unseen)
    if other:
        before = report.predicted(other, stage.base)
        poses |= report.pose_changes(study.validate_poses, other, before, predicted(refitted))
    return {p.name: poses[p.name] for p in study.poses if p.name in poses}


def _ranking(found, other, predicted):
    """Every effect type, refitted or from one step: those of the best model, then the others by evidence."""
    stage, bench, out = found.stage, found.stage.bench, {}
    tie_kinds = [k for r in found.tied for k in r.kinds] if found.best.components else []
    best = found.best.kinds
    for r in found.singles:
        kind = r.kinds[0]
        p = float(found.test.adjusted[found.table[kind][1]]) if kind in found.table else found.test.p_value  # fields
        judged = _judged(kind, best, tie_kinds, found, r.log_evidence)
        shapes = predicted(r) if other else None
        out[kind] = report.ranked(
            stage, r, 0, log_evidence=r.log_evidence, p_value=p, verdict=judged[0], tied_with=judged[1],
            rms_fit=report.rms(bench, r.shapes), rms_validate=None if shapes is None else report.rms(other, shapes),
        )  # fmt: skip
    for kind, (value, g) in sorted(found.table.items(), key=lambda item: -item[1][0]):
        if kind not in out:
            c, group = stage.components[g], stage.groups[g]
            a = one_step(group.X.T @ group.X, group.X.T @ stage.y) * c.entry.size(bench.context)
            a = np.clip(a, *c.entry.bounds(bench.context))
            judged = _judged(kind, best, tie_kinds, found, value)
            p = float(found.test.adjusted[g])
            out[kind] = Ranked(kind, c.entry.to_parameters(a, c.site, bench.context), value, p, *judged)
    return tuple(sorted(out.values(), key=lambda r: -r.log_evidence if r.kind not in best else -np.inf))


def _judged(kind, best, tie_kinds, found, value):
    """``(verdict, tied with)`` of an effect type."""
    if found.verdict in verdict.FOUND and kind in tie_kinds:
        if found.lead == verdict.TIED:
            beyond = (*search.outside(found.best), *search.rival_field(found)) if kind in best else ()
            return verdict.TIED, (*(k for k in dict.fromkeys(tie_kinds) if k != kind), *beyond)
        return found.lead, ()
    if kind not in found.table:  # a field: some part of it is visible in any poses
        return verdict.of_kind(value, np.inf, found.stage.settings), ()
    group = found.stage.groups[found.table[kind][1]]
    return verdict.of_kind(value, float(np.linalg.norm(group.X, axis=0).max()), found.stage.settings), ()
