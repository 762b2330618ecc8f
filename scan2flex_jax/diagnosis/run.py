"""`explain`: baseline fit, test, search, verdict, and the error before and after. Each step has its module."""

import functools
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from scan2flex_jax.compilation import make_room
from scan2flex_jax.diagnosis import (
    floors,
    gates,
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
from scan2flex_jax.diagnosis.choice import best_of, fewer_are_likelier
from scan2flex_jax.diagnosis.conclusion import explanation_of, likely_models
from scan2flex_jax.diagnosis.memory import memory_test
from scan2flex_jax.diagnosis.result import Explanation
from scan2flex_jax.diagnosis.sensitivity import Bench, Numbers
from scan2flex_jax.diagnosis.settings import USUAL, DiagnosisSettings
from scan2flex_jax.diagnosis.slots import empty_slots_of
from scan2flex_jax.errors import NotSettledError, Scan2FlexError
from scan2flex_jax.fitting import Fit, mistakes
from scan2flex_jax.fitting import fit as baseline_fit
from scan2flex_jax.fitting.least_squares import Progress, silent
from scan2flex_jax.fitting.noise import stated_noise
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
    some = next((p.name for p in study.poses if p.markers is not None and p.markers.measured != "xyz"), None)
    if some is not None:
        raise Scan2FlexError(f"the markers of pose {some!r} have some coordinates only: explain needs all three, fit does not.")
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
    told = (*repeat_sentences(base.fit.problem.study), *base.fit.turned, *base.fit.in_doubt, *warnings)
    answer = explanation_of(base, found, told, began)
    answer = answer if memory is None else remembered.answered(answer, memory, told)
    return answer if answer.believable else replace(answer, estimates={n: e.withheld() for n, e in answer.estimates.items()})


def _searched(base: "_Base", say: Progress) -> search.Found:
    """The search at the noise of the sensor, and on from there where that leaves structure."""
    found = search.search(base.stage, say)
    if found.verdict == verdict.NONE and base.signatures.bench.poses.count == 1:
        found = _below_discrepancy(base.signatures, found, say)
    for _ in range(_SHARPENED):
        differ = found.verdict == verdict.UNEXPLAINED and _poses_differ(base.signatures, found)  # less noise explains no more
        done = found.verdict == verdict.NONE or found.scattered or differ
        sharper = None if done else stage.sharpened(base.signatures, found)
        if sharper is None:
            break
        say("again with less noise")
        found = search.search(sharper, say)
    if found.verdict in (verdict.EXPLAINED, verdict.TIE) and (
        _poses_differ(base.signatures, found) or fewer_are_likelier(found.stage, found.tied, found.refits.values())
    ):
        found.verdict = verdict.UNEXPLAINED  # left to `partial`
    if found.verdict == verdict.NONE and _poses_differ(base.signatures, found):
        found.floor = floors.own_floor(base.signatures, found.stage.base, found.stage.noise)
    found = _continued(found, bool(base.coarse), say)
    if base.coarse and found.verdict != verdict.NONE:
        found.verdict = verdict.UNSOLVED
    return found


def _below_discrepancy(of: stage.Signatures, found: search.Found, say: Progress) -> search.Found:
    """The search of a single pose again where its residual is smooth and large, and was taken for noise: at the noise that a
    discrepancy leaves, since in a single pose a discrepancy and an effect are the same."""
    if not of.conspicuous(found.stage.noise):
        return found
    floor = floors.own_floor(of, found.stage.base, found.stage.noise, sharp=True)
    if not floor.law.curvature or floor.law.noise.total >= of.settings.sharper * found.stage.noise.total:
        return found
    say("again with the noise below a discrepancy")
    complement = of.complement(floor.shapes, Numbers(of.bench, ()), floor.vector)
    return search.search(stage.stage_of(of, complement, noise=floor.law.noise), say)


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
        stated = stated_noise(study, of_all=False)
        signatures, likelihood = stage.signatures(bench, fitted.minimum, stated, seed, alike, settings)
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
    models = {id(r): r for r in (found.best, *found.tied, *likely_models(found)) if r.components}
    if not models or found.verdict == verdict.UNSOLVED:
        return
    say("estimates")
    free = {key: found.stage.freed(r) for key, r in models.items()}
    found.best = free.get(id(found.best), found.best)
    found.tied = [free.get(id(r), r) for r in found.tied]
    found.minima = [free.get(id(r), r) for r in found.minima]
    found.refits = {kinds: free.get(id(r), r) for kinds, r in found.refits.items()}


def _poses_differ(of: stage.Signatures, found: search.Found) -> bool:
    """Whether each pose has a discrepancy of its own beyond the sensor's noise, given the best model or each one tied with it.

    In a single pose, discrepancy and effect are the same.
    """
    if of.bench.poses.count == 1:
        return False
    noise, models = found.stage.noise, found.tied if found.verdict == verdict.TIE else [found.best]
    return of.exceeds(noise) or of.conspicuous(noise) or (
        all(floors.gain_of_discrepancy(of, r, noise) > of.settings.differing for r in models)
    )


def _outdone(
    likely: tuple[Mistake, ...], found: search.Found, settings: DiagnosisSettings,
    memory: remembered.Remembering | None = None,
) -> bool:
    """Whether an effect, with memory or without, explains the shapes better than likely mistakes of the input do.

    Where a mistake only leaves out a pose, an effect that explains it about as closely as the others explains more.
    """
    if memory is not None and memory.answer is not None:
        left = memory.answer.rms()
    elif found.verdict in verdict.FOUND:
        left = report.nearest_rms(found.stage, found.best)
    else:
        return False
    poses = found.stage.bench.poses.count

    def most(mistake):
        every = len(mistake.study.fit_poses) == poses
        return mistake.after * (settings.outdone if every else settings.outdone_without)

    return bool(left < min((most(m) for m in likely if m.after is not None), default=0.0))


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
