"""`explain`: fit, test, search, judge, and the error before and after. Each step has its module."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from scan2flex_jax.compilation import make_room
from scan2flex_jax.diagnosis import (
    confirm,
    floors,
    gates,
    locate,
    moment_laws,
    partial,
    report,
    search,
    sentences,
    stage,
    verdict,
)
from scan2flex_jax.diagnosis.ahead import AheadCompiler
from scan2flex_jax.diagnosis.choice import best_of
from scan2flex_jax.diagnosis.evidence import one_step
from scan2flex_jax.diagnosis.refit import freed
from scan2flex_jax.diagnosis.result import Explanation, PoseChange, Ranked
from scan2flex_jax.diagnosis.sensitivity import Bench
from scan2flex_jax.diagnosis.settings import USUAL, DiagnosisSettings
from scan2flex_jax.diagnosis.slots import empty_slots_of
from scan2flex_jax.errors import NotSettledError
from scan2flex_jax.fitting import Fit
from scan2flex_jax.fitting import fit as plain_fit
from scan2flex_jax.fitting.least_squares import Progress, silent
from scan2flex_jax.fitting.problem import FIT_ELEMENTS
from scan2flex_jax.fitting.threads import on_one_blas_thread
from scan2flex_jax.study.model import MeasuredCurve, Study
from scan2flex_jax.study.repeats import repeat_sentences
from scan2flex_jax.study.sense import check_study

_SHARPENED = 2  # times that the noise is estimated anew beside what was found


@on_one_blas_thread
def explain(
    study: Study,
    *,
    elements: int = FIT_ELEMENTS,
    progress: Callable[[str], None] | None = None,
    seed: int = 0,
    mesh: bool = True,
    ahead: AheadCompiler | None = None,
    settings: DiagnosisSettings = USUAL,
) -> Explanation:
    """Physics that the baseline rod lacks for the ``fit`` poses of ``study``; its ``validate`` poses have no part in it.

    Args:
        study: One cable; six poses or more, some of them not plane, tell effects apart.
        elements: Elements of the rod to begin with.
        progress: Called with a line of text now and then.
        seed: Draws the noise of the test.
        mesh: False leaves out the gate that refines the mesh.
        ahead: Compiles the search in a thread beside the baseline fit; without it no thread is started.
        settings: Thresholds of the verdict, of intervals and of the mesh.

    Returns:
        Verdict, ranking, estimates before and after, and the study with the effects declared. Poses that cannot be solved
        give the verdict "not in equilibrium", never an exception; a study whose input is likely mistaken (``Fit.mistakes``)
        is "unexplained", and no physics is looked for.

    Raises:
        Scan2FlexError: The study cannot be fitted at all.

    Examples:
        >>> explain(load_study("my-cable")).verdict  # doctest: +SKIP
        'explained'
    """
    check_study(study)
    began, say = time.perf_counter(), progress or silent
    scanned = any(pose.curve is None and pose.scan is not None for pose in study.fit_poses)
    if ahead is None:  # a process that compiles ahead explains one study
        make_room()
    try:
        study = _on_axes(study, elements, say)
        base = _base(study, elements, say, seed, mesh, ahead, scanned, settings)
        if isinstance(base, Fit):
            return _mistaken(base, began, settings)
    except NotSettledError as fault:
        seconds = time.perf_counter() - began
        said = (str(fault),)
        return Explanation(study=study, verdict=verdict.UNSOLVED, sentences=said, seconds=seconds, settings=settings)
    found = search.search(base.stage, say)
    for _ in range(_SHARPENED):
        left = found.verdict == verdict.UNEXPLAINED and _poses_differ(base.signatures, found)  # less noise explains no more
        done = found.verdict == verdict.NONE or found.scattered or left
        sharper = None if done else stage.sharpened(base.signatures, found)
        if sharper is None:
            break
        say("again with less noise")
        found = search.search(sharper, say)
    if found.verdict in (verdict.EXPLAINED, verdict.TIE) and _poses_differ(base.signatures, found):
        found.verdict = verdict.UNEXPLAINED  # `partial` decides
    found = _went_on(found, bool(base.coarse), say)
    if base.coarse and found.verdict != verdict.NONE:
        found.verdict = verdict.UNSOLVED
    _free(found, say)
    warnings: tuple[str, ...] = ()
    if base.coarse:
        warnings = (f"the mesh error reaches the noise in {', '.join(base.coarse)}: nothing is concluded",)
    if scanned and found.verdict not in (verdict.NONE, verdict.UNSOLVED):
        warnings += sentences.if_fine(found)
    say("before and after")
    return _explanation(base, found, warnings, began)


@dataclass(frozen=True)
class _Base:
    """The plain fit and all that the search rests on; ``gates``: what was checked of it, ``coarse``: poses (with their mesh
    errors, in words) whose mesh is too coarse still."""

    fit: Fit
    signatures: stage.Signatures
    stage: stage.Stage
    gates: dict[str, int | float]
    coarse: list[str]


def _base(
    study: Study, elements: int, say: Progress, seed: int, mesh: bool, ahead: AheadCompiler | None, scanned: bool,
    settings: DiagnosisSettings = USUAL,
) -> _Base | Fit:
    """The plain fit on a mesh that is fine enough, or as fine as it gets; the fit alone where the input is likely mistaken.

    Raises `NotSettledError`.
    """
    names = [pose.name for pose in study.fit_poses]
    while True:
        say("plain fit")
        if ahead is not None:
            ahead.start(study, elements, mesh=mesh)
        fitted = plain_fit(study, elements=elements, slots=empty_slots_of(study))
        if ahead is not None:
            _wait(ahead, study, elements, mesh, say)
        if fitted.mistakes:
            return fitted
        study = fitted.problem.study  # with the turns that the shapes tell
        bench = Bench(fitted.problem, fitted.minimum)
        say("signatures of the catalogue")
        alike = settings.scan_alike * bench.context.radius_or_guess if scanned else 0.0
        signatures, beside = stage.signatures(bench, fitted.minimum, _stated(study), seed, alike, settings)
        first = stage.stage_of(signatures, beside)
        if not mesh:
            return _Base(fitted, signatures, first, {"elements": elements}, [])
        error = gates.mesh_error(fitted.problem, fitted.minimum)
        coarse = gates.too_coarse(error, settings.mesh_share * first.noise.total, names)
        if not coarse or elements >= settings.most_elements:
            return _Base(fitted, signatures, first, {"elements": elements, "mesh_error": float(np.max(error))}, coarse)
        elements *= 2
        say(f"again with {elements} elements")


def _went_on(found: search.Found, coarse: bool, say: Progress) -> search.Found:
    """The search on from one at the sensor's noise that is not complete: each model at its own floor, then the moment laws."""
    if found.verdict == verdict.UNEXPLAINED and not coarse and found.stage.bench.poses.count > 1:
        found = partial.search(found, say)
    elif found.verdict == verdict.UNEXPLAINED:
        simplest = best_of(found.stage, found.refits.values(), len(found.best.components))
        if simplest is not found.best:
            found.best, found.after = simplest, stage.test_after(found.stage, simplest)
    return found if coarse else moment_laws.search_on(found, say)


def _free(found: search.Found, say: Progress) -> None:
    """The models on which the answer rests are freed of the usual sizes of their effects, where those are exceeded."""
    models = {id(r): r for r in (found.best, *found.tied, *_likely(found)) if r.components}
    if not models or found.verdict == verdict.UNSOLVED:
        return
    say("estimates")
    free = {key: freed(found.stage.bench, r) for key, r in models.items()}
    found.best = free.get(id(found.best), found.best)
    found.tied = [free.get(id(r), r) for r in found.tied]
    found.refits = {kinds: free.get(id(r), r) for kinds, r in found.refits.items()}


def _poses_differ(of: stage.Signatures, found: search.Found) -> bool:
    """Whether each pose differs in its own way, beyond the sensor's noise, beside the best that was found.

    What one pose has of its own is the effect that is sought.
    """
    return of.bench.poses.count > 1 and floors.gain_of_discrepancy(of, found.best, found.stage.noise) > of.settings.differing


def _mistaken(fitted: Fit, began: float, settings: DiagnosisSettings) -> Explanation:
    """What is said of a study whose input is likely mistaken: no physics is looked for."""
    said = (*map(str, fitted.mistakes), "no physics is looked for before that is mended")
    seconds = time.perf_counter() - began
    return Explanation(
        study=fitted.study, verdict=verdict.UNEXPLAINED, sentences=said, seconds=seconds, mistakes=fitted.mistakes,
        settings=settings,
    )


def _wait(ahead: AheadCompiler, study: Study, elements: int, mesh: bool, say: Progress) -> None:
    """Wait for what is compiled ahead. A fault of it is told, and goes no further: the search meets it where it counts."""
    say("compiling the search")
    try:
        ahead.wait(study, elements, mesh=mesh)
    except Exception as fault:
        say(f"nothing was compiled ahead: {type(fault).__name__}: {fault}")


def _on_axes(study, elements, say):
    """A study of scans with the cable's axis for centre curves, as the points show it beside the fit to themselves.

    Extracted curves are pulled towards the sensor by some tenths of a radius; a direct fit knows that, and its stations along
    the cable see each a few points of their own.
    """
    if not any(pose.curve is None and pose.scan is not None for pose in study.poses):
        return study
    say("fit to the points of the scans")
    fitted = plain_fit(study, elements=elements, progress=say)
    if fitted.data != "cloud":
        return fitted.study
    poses = tuple(replace(p, curve=MeasuredCurve(fitted.poses[p.name].measured)) for p in fitted.study.poses)
    return replace(fitted.study, poses=poses)


def _stated(study) -> float | None:
    """The noise (m, one coordinate) that the study states, pooled."""
    stated = [p.noise for p in study.fit_poses if p.noise is not None]
    return float(np.sqrt(np.mean(np.square(stated)))) if stated else None


def _explanation(base, found, warnings, began):
    bench, fitted = found.stage.bench, base.fit
    study, other = fitted.problem.study, None
    if study.validate_poses:
        other = Bench(bench.problem, fitted.minimum, bench.problem.held_out)
    refitted, ranking = _refitted(found), _ranking(found, other)
    law_of = found.floor if found.floor is not None and not refitted.components else refitted
    added = _chosen(bench, refitted, ranking)
    chosen = added if found.verdict in verdict.FOUND else ()
    estimates = report.estimates(bench, _likely(found), refitted, alike=_alike(found))
    poses = _poses(study, found, other, refitted)
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
            *sentences.of_search(found, chosen, description), *sentences.before_and_after(poses, added, found),
            *(s for law in laws for s in law.sentences()), *sentences.of_discrepancy(found, discrepancy),
            *sentences.left_out(poses, chosen), *repeat_sentences(study), *fitted.turned, *warnings,
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
    """The model of "after": the best one, also where it is not established, unless it is no likelier than the plain rod or
    predicts poses left out no better."""
    if found.verdict in verdict.FOUND:
        return found.best
    if found.verdict != verdict.UNEXPLAINED or not found.best.components:
        return found.stage.base
    if found.stage.bench.poses.count < 2:  # no pose can be left out
        return found.best if found.best.log_evidence > found.stage.settings.lead_named else found.stage.base
    better = found.best.log_evidence > 0 and confirm.compared(found.stage, found.best, found.baseline).better
    return found.best if better else found.stage.base


def _likely(found):
    """The models over which intervals are taken: those that are tied, or where nothing was found all that are likely."""
    if found.verdict in verdict.FOUND:
        return found.tied
    if found.verdict != verdict.UNEXPLAINED:
        return [found.stage.base]
    if _alike(found):
        return [r for r in found.refits.values() if r.chi2 < found.stage.settings.near * found.best.chi2]
    most = max((r.log_evidence for r in found.refits.values()), default=0.0)
    likely = found.stage.settings.likely
    near = [r for r in found.refits.values() if r.log_evidence > most - likely]
    return [*near, found.baseline] if most < likely or not near else near


def _alike(found):
    """Whether models count alike in the intervals: no pose left out has judged them, and what they leave is no noise, so that
    likelihoods at the sensor's noise say nothing."""
    return found.verdict == verdict.UNEXPLAINED and found.floor is None and bool(found.best.components)


def _chosen(bench, refitted, ranking) -> tuple[Ranked, ...]:
    """The effects of the refitted model as they were ranked; several with the parameters and the evidence of all together."""
    chosen = tuple(next(r for r in ranking if r.kind == kind) for kind in refitted.kinds)
    if len(chosen) < 2:
        return chosen
    return tuple(
        report.ranked(bench, refitted, k, log_evidence=refitted.log_evidence, p_value=r.p_value, verdict=r.verdict,
                      tied_with=r.tied_with) for k, r in enumerate(chosen)
    )  # fmt: skip


def _poses(study, found, other, refitted) -> dict[str, PoseChange]:
    """Every pose before and after, in the order of the study; ``other``: the bench of the ``validate`` poses, or None."""
    stage, unseen = found.stage, None
    if stage.bench.poses.count > 1:
        errors = confirm.left_out if found.floor is None else confirm.predicted
        models = (found.baseline, refitted if refitted.components else found.baseline)
        unseen = np.transpose([errors(stage, r) for r in models])
    poses = report.pose_changes(study.fit_poses, stage.bench, stage.base.shapes, refitted.shapes, unseen)
    if other:
        before, after = report.predicted(other, stage.base), report.predicted(other, refitted, stage.base)
        poses |= report.pose_changes(study.validate_poses, other, before, after)
    return {p.name: poses[p.name] for p in study.poses if p.name in poses}


def _ranking(found, other):
    """Every kind: the refitted ones first by evidence, the others by their one-step evidence."""
    stage, bench, out = found.stage, found.stage.bench, {}
    tie_kinds = [k for r in found.tied for k in r.kinds] if found.best.components else []
    best = found.best.kinds
    for r in found.singles:
        kind = r.kinds[0]
        p = float(found.test.adjusted[found.table[kind][1]]) if kind in found.table else found.test.p_value  # fields
        judged = _judged(kind, best, tie_kinds, found, r.log_evidence)
        shapes = report.predicted(other, r, stage.base) if other else None
        out[kind] = report.ranked(
            bench, r, 0, log_evidence=r.log_evidence, p_value=p, verdict=judged[0], tied_with=judged[1],
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
    """``(verdict, tied with)`` of a kind."""
    if found.verdict in verdict.FOUND and kind in tie_kinds:
        if found.lead == verdict.TIED:
            beyond = (*search.outside(found.best), *search.field_beside(found)) if kind in best else ()
            return verdict.TIED, (*(k for k in dict.fromkeys(tie_kinds) if k != kind), *beyond)
        return found.lead, ()
    if kind not in found.table:  # a field, of which some part can be seen in any poses
        return verdict.of_kind(value, np.inf, found.stage.settings), ()
    group = found.stage.groups[found.table[kind][1]]
    return verdict.of_kind(value, float(np.linalg.norm(group.X, axis=0).max()), found.stage.settings), ()
