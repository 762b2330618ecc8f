"""`explain`: baseline fit, test, search, verdict, and the error before and after. Each step has its module."""

import functools
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
    remembered,
    report,
    search,
    sentences,
    stage,
    verdict,
)
from scan2flex_jax.diagnosis.ahead import AheadCompiler
from scan2flex_jax.diagnosis.choice import best_of
from scan2flex_jax.diagnosis.evidence import one_step
from scan2flex_jax.diagnosis.memory import memory_test
from scan2flex_jax.diagnosis.refit import freed
from scan2flex_jax.diagnosis.result import Explanation, PoseChange, Ranked
from scan2flex_jax.diagnosis.sensitivity import Bench
from scan2flex_jax.diagnosis.settings import USUAL, DiagnosisSettings
from scan2flex_jax.diagnosis.slots import empty_slots_of
from scan2flex_jax.errors import NotSettledError
from scan2flex_jax.fitting import Fit, mistakes
from scan2flex_jax.fitting import fit as baseline_fit
from scan2flex_jax.fitting.least_squares import Progress, silent
from scan2flex_jax.fitting.problem import FIT_ELEMENTS
from scan2flex_jax.fitting.threads import threaded
from scan2flex_jax.study.kinds import kind_format
from scan2flex_jax.study.mistakes import Mistake
from scan2flex_jax.study.model import MeasuredCurve, Study
from scan2flex_jax.study.repeats import repeat_sentences
from scan2flex_jax.study.sense import check_study

_SHARPENED = 2  # searches repeated with the noise re-estimated given the effects found


@threaded
def explain(
    study: Study,
    *,
    elements: int | None = None,
    progress: Callable[[str], None] | None = None,
    seed: int = 0,
    mesh: bool = True,
    ahead: AheadCompiler | None = None,
    settings: DiagnosisSettings = USUAL,
) -> Explanation:
    """Search for physics that the baseline model lacks, in the ``fit`` poses of ``study``; ``validate`` poses are not used.

    Args:
        study: One cable. Distinguishing effects takes six poses or more, some of them not plane.
        elements: Initial number of elements of the rod; None: as many as `fit` takes.
        progress: Called with a line of text at each step.
        seed: Seed of the noise drawn for the test.
        mesh: False skips the gate that refines the mesh.
        ahead: Compiles the search in a thread during the baseline fit; without it nothing is compiled ahead.
        settings: Thresholds of the verdict, of intervals and of the mesh.

    Returns:
        Verdict, ranking, estimates before and after, and the study with the effects declared. Poses that are not solved give
        the verdict "not in equilibrium", never an exception; a study with likely input mistakes (``Fit.mistakes``) that no
        effect outdoes is "unexplained".

    Raises:
        Scan2FlexError: The study cannot be fitted.

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
        begin = functools.partial(_base, elements=elements, say=say, seed=seed, mesh=mesh, scanned=scanned, settings=settings)
        base = begin(study, ahead=ahead)
        if isinstance(base, Fit):
            return _mistaken(base, began, settings)
    except NotSettledError as fault:
        seconds = time.perf_counter() - began
        said = (str(fault),)
        return Explanation(study=study, verdict=verdict.UNSOLVED, sentences=said, seconds=seconds, settings=settings)
    found = _searched(base, say)
    base, found, warnings = _on_likelier_turns(begin, study, base, found, say)
    warnings += base.fit.mesh
    memory = remembered.search(found, say)
    if base.fit.mistakes:
        if not _outdone(base.fit.mistakes, found, settings, memory):
            return _mistaken(base.fit, began, settings)
        warnings += tuple(f"a mistake of the input explains less: {mistake}" for mistake in base.fit.mistakes)
    _free(found, say)
    if base.coarse:
        warnings += (f"the mesh error reaches the noise in {', '.join(base.coarse)}: nothing is concluded",)
    if scanned and found.verdict not in (verdict.NONE, verdict.UNSOLVED):
        warnings += sentences.if_fine(found)
    warnings += (*_remembered(study, base.fit.problem.elements, say), *remembered.said_of(memory, found))
    say("before and after")
    told = (*repeat_sentences(base.fit.problem.study), *base.fit.turned, *warnings)
    answer = _explanation(base, found, told, began)
    return answer if memory is None else remembered.answered(answer, memory, told)


def _searched(base: "_Base", say: Progress) -> search.Found:
    """The search at the noise of the sensor, and on from there where that leaves structure."""
    found = search.search(base.stage, say)
    for _ in range(_SHARPENED):
        differ = found.verdict == verdict.UNEXPLAINED and _poses_differ(base.signatures, found)  # less noise explains no more
        done = found.verdict == verdict.NONE or found.scattered or differ
        sharper = None if done else stage.sharpened(base.signatures, found)
        if sharper is None:
            break
        say("again with less noise")
        found = search.search(sharper, say)
    if found.verdict in (verdict.EXPLAINED, verdict.TIE) and _poses_differ(base.signatures, found):
        found.verdict = verdict.UNEXPLAINED  # left to `partial`
    found = _continued(found, bool(base.coarse), say)
    if base.coarse and found.verdict != verdict.NONE:
        found.verdict = verdict.UNSOLVED
    return found


def _remembered(study: Study, elements: int, say: Progress) -> tuple[str, ...]:
    """A sentence for each declared effect with memory whose parameters are unknown: the test over the order of poses."""
    kinds = [e.kind for e in study.effects if kind_format(e.kind).memory != "none"]
    asked = [kind for kind in kinds if any(name.startswith(f"{kind}.") for name in study.unknown_names)]
    return tuple(memory_test(study, kind, elements=elements, progress=say).sentence() for kind in asked)


@dataclass(frozen=True)
class _Base:
    """The baseline fit and the inputs of the search; ``gates``: elements and mesh error; ``coarse``: poses whose mesh remains
    too coarse, with their mesh errors, in words."""

    fit: Fit
    signatures: stage.Signatures
    stage: stage.Stage
    gates: dict[str, int | float]
    coarse: list[str]


def _base(
    study: Study, *, elements: int | None, say: Progress, seed: int, mesh: bool, scanned: bool,
    ahead: AheadCompiler | None = None, other_turns: bool = True, settings: DiagnosisSettings = USUAL,
) -> _Base | Fit:
    """The baseline fit on a fine enough mesh, or the finest allowed; the fit alone if the input is likely mistaken.

    Raises `NotSettledError`.
    """
    names = [pose.name for pose in study.fit_poses]
    while True:
        say("baseline fit")
        if ahead is not None:
            ahead.start(study, elements or FIT_ELEMENTS, mesh=mesh)
        fitted = baseline_fit(study, elements=elements, slots=empty_slots_of(study), other_turns=other_turns)
        if ahead is not None:
            _wait(ahead, study, elements or FIT_ELEMENTS, mesh, say)
        if fitted.mistakes and mistakes.beyond_doubt(fitted.problem, fitted.mistakes):
            return fitted
        elements = fitted.problem.elements
        study = fitted.problem.study  # with the turns inferred from the shapes
        bench = Bench(fitted.problem, fitted.minimum)
        say("signatures of the catalogue")
        alike = settings.scan_alike * bench.context.radius_or_guess if scanned else 0.0
        signatures, likelihood = stage.signatures(bench, fitted.minimum, _stated(study), seed, alike, settings)
        first = stage.stage_of(signatures, likelihood)
        if not mesh:
            return _Base(fitted, signatures, first, {"elements": elements}, [])
        error = gates.mesh_error(fitted.problem, fitted.minimum)
        coarse = gates.too_coarse(error, settings.mesh_share * first.noise.total, names)
        if not coarse or elements >= settings.most_elements:
            return _Base(fitted, signatures, first, {"elements": elements, "mesh_error": float(np.max(error))}, coarse)
        elements *= 2
        say(f"again with {elements} elements")


def _on_likelier_turns(
    begin: Callable[..., _Base | Fit], study: Study, base: _Base, found: search.Found, say: Progress
) -> tuple[_Base, search.Found, tuple[str, ...]]:
    """The search with the stated turns, where the fit adopted others and yet left more than noise, if an effect found there
    explains the shapes better; otherwise the search given. Other turns with another torsional stiffness imitate some effects.
    """
    kept = base, found, ()
    if not base.fit.turned or found.verdict not in (verdict.UNEXPLAINED, verdict.PARTLY):
        return kept
    say("again with the turns of the study")
    try:
        stated = begin(study, other_turns=False)
    except NotSettledError:
        return kept
    if isinstance(stated, Fit):
        return kept
    other = _searched(stated, say)
    lead = _likelihood(other) - _likelihood(found)
    if other.verdict not in verdict.FOUND or lead < found.stage.settings.lead_named:
        return kept
    said = f"with a full turn more or less in {len(base.fit.turned)} poses the shapes are less likely by {lead:.0f} nats"
    return stated, other, (f"{said} than with the turns of the study and {' and '.join(other.best.kinds)}",)


def _likelihood(found: search.Found) -> float:
    """Log marginal likelihood (nats) of the best model at its own floor."""
    own = found.best if found.floor is not None else floors.own_floor(found.stage.of, found.best, found.stage.noise)
    return own.log_marginal


def _continued(found: search.Found, coarse: bool, say: Progress) -> search.Found:
    """The search on from one at the sensor's noise that is not complete: each model at its own floor, then the moment laws."""
    if found.verdict == verdict.UNEXPLAINED and not coarse and found.stage.bench.poses.count > 1:
        found = partial.search(found, say)
    elif found.verdict == verdict.UNEXPLAINED:
        simplest = best_of(found.stage, found.refits.values(), len(found.best.components))
        if simplest is not found.best:
            found.best, found.after = simplest, stage.test_after(found.stage, simplest)
    return found if coarse else moment_laws.search_on(found, say)


def _free(found: search.Found, say: Progress) -> None:
    """Refit the models of the answer with wide priors of the effects that exceed their usual sizes (`refit.freed`)."""
    models = {id(r): r for r in (found.best, *found.tied, *_likely(found)) if r.components}
    if not models or found.verdict == verdict.UNSOLVED:
        return
    say("estimates")
    free = {key: freed(found.stage.bench, r) for key, r in models.items()}
    found.best = free.get(id(found.best), found.best)
    found.tied = [free.get(id(r), r) for r in found.tied]
    found.refits = {kinds: free.get(id(r), r) for kinds, r in found.refits.items()}


def _poses_differ(of: stage.Signatures, found: search.Found) -> bool:
    """Whether each pose has a discrepancy of its own beyond the sensor's noise, given the best model found.

    In a single pose, discrepancy and effect are the same.
    """
    if of.bench.poses.count == 1:
        return False
    return of.exceeds(found.stage.noise) or (
        floors.gain_of_discrepancy(of, found.best, found.stage.noise) > of.settings.differing
    )


def _outdone(
    likely: tuple[Mistake, ...], found: search.Found, settings: DiagnosisSettings,
    memory: remembered.Remembering | None = None,
) -> bool:
    """Whether an effect, with memory or without, explains the shapes better than likely mistakes of the input do."""
    if memory is not None and memory.answer is not None:
        left = memory.answer.rms()
    elif found.verdict in verdict.FOUND:
        left = report.nearest_rms(found.stage, found.best)
    else:
        return False
    return bool(left < settings.outdone * min((m.after for m in likely if m.after is not None), default=0.0))


def _mistaken(fitted: Fit, began: float, settings: DiagnosisSettings) -> Explanation:
    """The explanation of a study with likely input mistakes."""
    said = (*map(str, fitted.mistakes), "correct the input first: no missing effect is named until then")
    seconds = time.perf_counter() - began
    return Explanation(
        study=fitted.study, verdict=verdict.UNEXPLAINED, sentences=said, seconds=seconds, mistakes=fitted.mistakes,
        settings=settings,
    )


def _wait(ahead: AheadCompiler, study: Study, elements: int, mesh: bool, say: Progress) -> None:
    """Wait for the compilation ahead. Its exception is reported as progress only: the search raises it where it matters."""
    say("compiling the search")
    try:
        ahead.wait(study, elements, mesh=mesh)
    except Exception as fault:
        say(f"nothing was compiled ahead: {type(fault).__name__}: {fault}")


def _on_axes(study, elements, say):
    """A study of scans with centre curves from the direct fit to the points, at stations along the cable.

    Extracted curves are biased towards the sensor by some tenths of a radius; the direct fit models that bias.
    """
    if not any(pose.curve is None and pose.scan is not None for pose in study.poses):
        return study
    say("fit to the points of the scans")
    fitted = baseline_fit(study, elements=elements, progress=say)
    if fitted.data != "cloud":
        return fitted.study
    poses = tuple(replace(p, curve=MeasuredCurve(fitted.poses[p.name].measured)) for p in fitted.study.poses)
    return replace(fitted.study, poses=poses)


def _stated(study) -> float | None:
    """The stated noise (m, one coordinate), pooled over the poses."""
    stated = [p.noise for p in study.fit_poses if p.noise is not None]
    return float(np.sqrt(np.mean(np.square(stated)))) if stated else None


def _explanation(base, found, told, began):
    """The explanation of a search, with the sentences ``told`` at its end."""
    bench, fitted = found.stage.bench, base.fit
    study, other = fitted.problem.study, None
    if study.validate_poses:
        other = Bench(bench.problem, fitted.minimum, bench.problem.held_out)
    # cached: a refit is ranked, and may be the answer
    predicted = functools.cache(lambda r: report.predicted(other, r, found.stage.base))
    refitted, ranking = _refitted(found), _ranking(found, other, predicted)
    law_of = found.floor if found.floor is not None and not refitted.components else refitted
    added = _chosen(bench, refitted, ranking)
    established, concluded = found.verdict in verdict.FOUND, found.verdict in (*verdict.FOUND, verdict.UNEXPLAINED)
    chosen = added if established else ()
    estimates = report.estimates(bench, _likely(found), refitted, alike=_alike(found))
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


def _likely(found):
    """The models that intervals include: those tied, or all likely ones if no effect was found."""
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
    """Whether models have equal weights in the intervals: they were not compared on poses left out, and their residuals are not
    noise, so that likelihoods at the sensor's noise are meaningless."""
    return found.verdict == verdict.UNEXPLAINED and found.floor is None and bool(found.best.components)


def _chosen(bench, refitted, ranking) -> tuple[Ranked, ...]:
    """The effects of the refitted model as ranked; several effects have the parameters and evidence of their joint refit."""
    chosen = tuple(next(r for r in ranking if r.kind == kind) for kind in refitted.kinds)
    if len(chosen) < 2:
        return chosen
    return tuple(
        report.ranked(bench, refitted, k, log_evidence=refitted.log_evidence, p_value=r.p_value, verdict=r.verdict,
                      tied_with=r.tied_with) for k, r in enumerate(chosen)
    )  # fmt: skip


def _poses(study, found, other, refitted, predicted) -> dict[str, PoseChange]:
    """Every pose before and after, in the order of the study; ``other``: the `Bench` of the ``validate`` poses, or None;
    ``predicted``: function of a refit to their shapes."""
    stage, unseen = found.stage, None
    if stage.bench.poses.count > 1:
        errors = confirm.left_out if found.floor is None else confirm.predicted
        models = (found.baseline, refitted if refitted.components else found.baseline)
        unseen = np.transpose([errors(stage, r) for r in models])
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
