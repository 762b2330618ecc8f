"""`explain`: fit, test, search, judge, and the error before and after. Each step has its module."""

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from scan2flex_jax.diagnosis import confirm, gates, locate, report, search, stage, verdict
from scan2flex_jax.diagnosis.ahead import compile_ahead
from scan2flex_jax.diagnosis.evidence import one_step
from scan2flex_jax.diagnosis.families import WORDS
from scan2flex_jax.diagnosis.result import Explanation, Ranked
from scan2flex_jax.diagnosis.sensitivity import Bench
from scan2flex_jax.diagnosis.slots import empty_slots_of
from scan2flex_jax.effects.catalogue import catalogue, entry_of
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting import fit as plain_fit
from scan2flex_jax.fitting.run import FIT_ELEMENTS
from scan2flex_jax.study.model import MeasuredCurve, Study
from scan2flex_jax.study.sense import check_study

_SMOOTH, _LARGE = 3.0, 0.002  # correlated over white noise, and noise over length, that few scanners have
_FINE = 0.1  # of the radius: what errs less may be the axis of a scan
_SHARPENED = 2  # times that the noise is estimated anew beside what was found


@threadpool_limits.wrap(limits=1, user_api="blas")
def explain(
    study: Study,
    *,
    elements: int = FIT_ELEMENTS,
    progress: Callable[[str], None] | None = None,
    seed: int = 0,
    mesh: bool = True,
) -> Explanation:
    """What physics the plain rod lacks for the ``fit`` poses of ``study``; its ``validate`` poses have no part in it.

    ``progress`` is called with a line of text now and then; ``seed`` draws the noise of the test; ``mesh`` False leaves out
    the gate that refines the mesh. Poses that cannot be solved give the verdict "not in equilibrium", never an exception.
    """
    check_study(study)
    began, say = time.perf_counter(), progress or (lambda message: None)
    names, scanned = [p.name for p in study.fit_poses], any(pose.curve is None for pose in study.fit_poses)
    study = _on_axes(study, elements, say)
    while True:
        say("plain fit")
        compiling = compile_ahead(study, elements, mesh=mesh)
        try:
            fitted = plain_fit(study, elements=elements, slots=empty_slots_of(study))
        except Scan2FlexError as fault:
            if "settle" not in str(fault):
                raise
            seconds = time.perf_counter() - began
            return Explanation(study, None, verdict.UNSOLVED, 1.0, None, sentences=(str(fault),), seconds=seconds)
        compiling.join()
        problem, minimum = fitted.problem
        study = problem.study  # with the turns that the shapes tell
        bench = Bench(problem, minimum)
        say("signatures of the catalogue")
        signatures, beside = stage.signatures(bench, minimum, _stated(study), seed)
        first = stage.stage_of(signatures, beside)
        error = gates.mesh_error(problem, minimum) if mesh else np.zeros(0)
        coarse = gates.too_coarse(error, first.noise.total, names) if mesh else []
        if not coarse or elements >= gates.MOST_ELEMENTS:
            break
        elements *= 2
        say(f"again with {elements} elements")
    found = search.search(first, say)
    for _ in range(_SHARPENED):
        sharper = stage.sharpened(signatures, found) if found.verdict != verdict.NONE else None
        if sharper is None:
            break
        say("again with less noise")
        found = search.search(sharper, say)
    if coarse and found.verdict != verdict.NONE:
        found.verdict = verdict.UNSOLVED
    checks = {"elements": elements} | ({"mesh_error": float(np.max(error))} if mesh else {})
    warnings = (f"the mesh error reaches the noise in {', '.join(coarse)}: nothing is concluded",) if coarse else ()
    if scanned and found.verdict not in (verdict.NONE, verdict.UNSOLVED):
        warnings += _if_fine(found)
    say("before and after")
    return _explanation(study, fitted, found, checks, warnings, began)


def _on_axes(study, elements, say):
    """A study of scans with the cable's axis for centre curves, as the points show it beside the fit to themselves.

    Extracted curves are pulled towards the sensor by some tenths of a radius; a direct fit knows that, and its stations along
    the cable see each a few points of their own.
    """
    if all(pose.curve is not None for pose in study.poses):
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


def _explanation(study, fitted, found, checks, warnings, began):
    bench, base = found.stage.bench, found.stage.base
    other = None
    if study.validate_poses:
        other = Bench(bench.problem, fitted.problem[1], bench.problem.held_out)
    chosen_refit = found.best if found.verdict in (verdict.EXPLAINED, verdict.TIE) else base
    unseen = [confirm.left_out(found.stage, r) for r in (base, chosen_refit)]
    poses = report.pose_changes(study.fit_poses, bench, base.shapes, chosen_refit.shapes, np.transpose(unseen))
    if other:
        before, after = report.predicted(other, base), report.predicted(other, chosen_refit)
        poses |= report.pose_changes(study.validate_poses, other, before, after)
    ranking = _ranking(found, other)
    kinds = [c.kind for c in chosen_refit.components]
    chosen = tuple(next(r for r in ranking if r.kind == kind) for kind in kinds)
    if len(kinds) > 1:
        chosen = tuple(
            report.ranked(bench, chosen_refit, k, log_evidence=chosen_refit.log_evidence, p_value=r.p_value, verdict=r.verdict,
                          tied_with=r.tied_with) for k, r in enumerate(chosen)
        )  # fmt: skip
    tied = found.tied if kinds else [base]
    estimates = report.estimates(bench, tied, chosen_refit)
    tie_kinds = {k for r in tied for k in r.kinds}
    constancy = found.constancy if kinds else None
    description = report.description(found) if found.verdict == verdict.UNEXPLAINED else None
    sentences = (*_sentences(found, chosen, description), *_confirmed(poses, kinds), *fitted.turned, *warnings)
    ordered = {p.name: poses[p.name] for p in study.poses if p.name in poses}
    return Explanation(
        report.declared(study, estimates, chosen) if kinds else fitted.calibrated, fitted, found.verdict, found.test.p_value,
        found.stage.noise, ranking, chosen, found.after.p_value if found.after else None, estimates, ordered,
        found.test.family_gain, report.settle_sentences(tie_kinds) if found.verdict == verdict.TIE else (), sentences,
        checks | ({} if constancy is None else {"constancy": constancy}), time.perf_counter() - began,
        locate.common_load(found.stage), tuple(locate.pose_loads(found.stage)), description, found,
    )  # fmt: skip


def _ranking(found, other):
    """Every kind: the refitted ones first by evidence, the others by their one-step evidence."""
    stage, bench, out = found.stage, found.stage.bench, {}
    tie_kinds = [k for r in found.tied for k in r.kinds] if found.best.components else []
    best = found.best.kinds
    for r in found.singles:
        kind = r.kinds[0]
        p = float(found.test.adjusted[found.table[kind][1]])
        judged = _judged(kind, best, tie_kinds, found, r.log_evidence)
        shapes = report.predicted(other, r) if other else None
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
    if found.verdict in (verdict.EXPLAINED, verdict.TIE) and kind in tie_kinds:
        if found.lead == verdict.TIED:
            beyond = (*search.outside(found.best), *search.field_beside(found)) if kind in best else ()
            return verdict.TIED, (*(k for k in dict.fromkeys(tie_kinds) if k != kind), *beyond)
        return found.lead, ()
    group = found.stage.groups[found.table[kind][1]]
    return verdict.of_kind(value, float(np.linalg.norm(group.X, axis=0).max())), ()


def _sentences(found, chosen, description):
    p = found.test.p_value
    if found.verdict == verdict.NONE:
        return (f"the plain rod explains these shapes to within the noise (p = {p:.3f})", *_if_noise(found))
    if found.verdict == verdict.UNSOLVED:
        return ("nothing is concluded",)
    if found.verdict == verdict.UNEXPLAINED:
        text = f"something is missing (p = {p:.3f}) and no known effect explains it"
        family, gain = max(found.test.family_gain.items(), key=lambda item: item[1])
        tail = f"; it behaves like {WORDS[family]} ({gain:.1f} nats), which describes and does not name" if gain > 0 else ""
        field = f"{description.kind} describes it along the cable: a field with a band, not physics"
        return (text + tail, *_not_enough(found), field)
    names = " and ".join(r.kind for r in chosen)
    return (f"something is missing (p = {p:.3f}); {names} explains it; what is left is noise", *_never_told(chosen))


def _if_noise(found):
    """What has to be believed of the scan where smooth errors as large as shapes pass for noise."""
    n, stage = found.stage.noise, found.stage
    stated = all(pose.noise is not None for pose in stage.bench.problem.study.fit_poses)
    if stated or n.correlated < _SMOOTH * n.white or n.total < _LARGE * stage.bench.context.length:
        return ()
    errors = f"{1e3 * np.sqrt(2) * n.total:.1f} mm RMS, alike over {1e3 * n.correlation_length:.0f} mm"
    return (f"but only if the measured curves err by {errors}: state the noise of the scan (`noise` of a pose) to decide it",)


def _if_fine(found):
    """What has to be believed of scans where an effect shows in less than they may err."""
    bench = found.stage.bench
    rms, radius = report.rms(bench, found.stage.base.shapes), bench.context.radius_or_guess
    if rms > _FINE * radius:
        return ()
    left = f"the plain rod leaves {1e3 * rms:.2f} mm, {100 * rms / radius:.0f} % of the radius"
    return (f"{left}: so little may be the scans', which err alike along a pose that was seen from one side",)


def _not_enough(found):
    """Why the likeliest kinds do not explain the shapes."""
    names, said = " and ".join(found.best.kinds), []
    if not names:
        return ()
    if found.after.p_value <= verdict.ALARM:
        said.append(f"leaves structure (p = {found.after.p_value:.3f})")
    if verdict.varies(found.constancy, len(found.best.kinds)):
        said.append(f"would need another size in each pose (p = {found.constancy:.3f})")
    if found.field[1] > found.best.log_evidence + verdict.FIELD_LEADS:
        said.append(f"is less likely than a field, by {found.field[1] - found.best.log_evidence:.1f} nats")
    if found.unseen is not None and found.unseen > verdict.WORSE:
        said.append(f"predicts a pose left out {found.unseen:.1f} times as badly as the plain rod")
    return (f"the likeliest, {names}, {' and '.join(said)}",) if said else ()


def _confirmed(poses, kinds):
    """What poses that had no part in it say of the effect."""
    own = [p for p in poses.values() if p.left_out is not None and np.isfinite(p.left_out)]
    if not kinds or not own:
        return ()
    better = sum(p.left_out < p.left_out_before for p in own)
    return (f"left out in turn, {better} of {len(own)} fitted poses are predicted better with it than without",)


def _never_told(chosen):
    """What is no kind of the catalogue and gives the same shapes all the same."""
    out = []
    for r in chosen:
        for other, when in entry_of(r.kind).same_shapes:
            if "always" in when and other not in {e.kind for e in catalogue()}:
                out.append(f"shapes alone never tell {r.kind} from an error of the {other.replace('_', ' ')}: {when}")
    return tuple(out)
