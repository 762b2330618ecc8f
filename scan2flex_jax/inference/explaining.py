"""`explain`: which physics the model of a study lacks, with the error before and after."""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from scan2flex_jax.compilation import make_room
from scan2flex_jax.effects.catalogue import catalogue, entry_of
from scan2flex_jax.errors import NotSettledError
from scan2flex_jax.fitting.least_squares import silent
from scan2flex_jax.fitting.threads import threaded
from scan2flex_jax.inference import variants
from scan2flex_jax.inference.fitting import with_curves
from scan2flex_jax.posterior import belief
from scan2flex_jax.posterior import quantities as of
from scan2flex_jax.posterior.decision import (
    ABSENT,
    FAVOURED,
    FOUND,
    INCONCLUSIVE,
    NAMED,
    NONE,
    PARTLY,
    TIE,
    TIED,
    TOO_LITTLE,
    UNEXPLAINED,
    UNSOLVED,
    Decision,
    decide,
    errors_of_input,
    leads,
    smooth,
)
from scan2flex_jax.posterior.posterior import Fitted, Variant
from scan2flex_jax.posterior.recorded import Record, recorded, replayed
from scan2flex_jax.posterior.search import Search
from scan2flex_jax.posterior.settings import FEWEST, USUAL, Settings
from scan2flex_jax.results import shapes
from scan2flex_jax.results.along import stiffness_along, withheld
from scan2flex_jax.results.explanation import Explanation, Hypothesis, PoseChange, Ranked
from scan2flex_jax.results.fit_result import Fit, pose_fits, rms_over
from scan2flex_jax.results.words import FIELDS, Finding, listed
from scan2flex_jax.study.model import Study
from scan2flex_jax.study.repeats import repeat_sentences
from scan2flex_jax.study.sense import check_study


@threaded
def explain(
    study: Study,
    *,
    elements: int | None = None,
    progress: Callable[[str], None] | None = None,
    mesh: bool = True,
    settings: Settings = USUAL,
    record: Record | None = None,
) -> Explanation:
    """Search for physics that the baseline model lacks, in the ``fit`` poses of ``study``.

    Every hypothesis (effects of the catalogue, sets of them, fields, memory, other turns, mistakes of the input) is scored
    alike under one generative model (`posterior.posterior`): by its log evidence, which orders the search, and by its log
    predictive density of poses left out, of which eight decisions (`posterior.decision`) make the verdict. ``validate`` poses
    have no part in the scores, and may contradict the answer.

    Args:
        study: One cable. Distinguishing effects takes six poses or more, some of them not plane.
        elements: Initial number of elements of the rod; None: as many as `fit` takes.
        progress: Called with a line of text at each step.
        mesh: False keeps the mesh, whatever its error.
        settings: Priors of the model, and thresholds of the decisions.
        record: The ``record`` of an earlier explanation of the same study, mesh and settings: its hypotheses are taken in place
            of a second search. One that does not fit is not used.

    Returns:
        Verdict, table of hypotheses, estimates before and after, and the study with the effects declared. Poses that are not
        solved give the verdict "not in equilibrium", never an exception; a study with likely input mistakes that no effect
        outdoes is "unexplained".

    Raises:
        Scan2FlexError: The study cannot be fitted.

    Examples:
        >>> explain(load_study("my-cable")).verdict  # doctest: +SKIP
        'explained'
    """
    check_study(study)
    began, say = time.perf_counter(), progress or silent
    make_room()
    try:
        study, notes = with_curves(study, say)
        first, gates, coarse = variants.given(study, elements, mesh, settings, say)
    except NotSettledError as fault:
        return Explanation(study=study, verdict=UNSOLVED, sentences=(str(fault),), seconds=_since(began), settings=settings)
    if isinstance(first, Fit):
        return _mistaken(first.study, first.mistakes, began, settings)
    mistaken = [(mistake, v.empty) for mistake, v in variants.corrected(first, say)]
    if beyond := tuple(m for m, h in mistaken if not h.discrepant and leads(h, first.empty, settings.found)):
        # nothing is left for an effect to explain
        return _mistaken(first.fit.study, beyond, began, settings)
    search = replayed(record, first, say) if record else None
    say("hypotheses of an earlier search" if search else "search")
    search = search or Search([first], say).run()
    kept = recorded(search)
    if search.causes[0].discrepant and (stated := variants.stated_turns(study, first, say)) is not None:
        search.extend(stated)
    for variant in variants.remembering(search, say):
        search.extend(variant)
    decision = decide(search, mistaken, bool(coarse), lambda h: of.surprise(h, settings.surprise))
    if decision.mistakes:
        return _mistaken(first.fit.study, decision.mistakes, began, settings)
    say("before and after")
    answer = replace(_explanation(first, search, decision, began, gates, coarse, notes), record=kept)
    return answer if answer.believable else withheld(answer)


def _since(began: float) -> float:
    return time.perf_counter() - began


def _mistaken(study, mistakes, began, settings) -> Explanation:
    """The explanation of a study with likely input mistakes."""
    said = (*map(str, mistakes), str(Finding("mistaken")))
    rest = {"seconds": _since(began), "mistakes": mistakes, "settings": settings}
    return Explanation(study=study, verdict=UNEXPLAINED, sentences=said, **rest)


def _explanation(first: Variant, search: Search, d: Decision, began, gates, coarse, notes) -> Explanation:
    best, fitted = d.best, first.fit
    study = best.variant.study
    ranking, every = _ranking(search, d), of.estimates(best, d.averaged)
    chosen, poses = _chosen(d, ranking), _poses(d)
    field = d.description if d.verdict == UNEXPLAINED else None
    load, pose_loads = of.equivalent_loads(d.empty)
    discrepancy, laws = of.discrepancy_of(best), of.laws_of(best, d.p_value)
    along, loops = stiffness_along(best, d.averaged), of.loops_in(best)
    noise = best.variant.likelihood.noise(best.u)
    notes = (*notes, *repeat_sentences(study), *fitted.turned, *fitted.in_doubt, *fitted.mesh)
    findings = _findings(d, chosen, poses, discrepancy, coarse)
    return Explanation(
        study=_established(d),
        fit=fitted,
        verdict=d.verdict,
        p_value=d.p_value,
        noise=noise,
        discrepancy=discrepancy,
        scatter=of.scatter_of(best),
        hypotheses=_table(search, d),
        ranking=ranking,
        chosen=chosen,
        estimates=shapes.without({name: every[name] for name in fitted.estimates}, fitted.open),
        poses=poses,
        settle=_settle(d) if d.verdict == TIE else (),
        sentences=(*map(str, findings), *_read_off(laws, loops), *notes),
        gates=gates,
        seconds=_since(began),
        load=load,
        pose_loads=pose_loads,
        description=None if field is None else _ranked(field, field.kinds[0], field.score - d.empty.score, "description"),
        laws=laws,
        along=along,
        loops=loops,
        decision=d,
        scored=tuple(h for h in search.ranked if h.variant is d.empty.variant),
        surprised=d.surprised,
        reservation=next(iter(fitted.in_doubt), "") or belief.reservation(best, discrepancy) or _untested(d, poses),
        settings=first.settings,
    )


def _untested(d: Decision, poses) -> str:
    """That nothing tests the baseline model: hardly a pose beside those that it was fitted to."""
    few = d.verdict == NONE and len(d.empty.elpd) < FEWEST and all(p.role != "validate" for p in poses.values())
    return "the model is untried: so few poses cannot test it" if few else ""


def _read_off(laws, loops) -> tuple[str, ...]:
    """What is read off moment laws, and off effects with memory."""
    return tuple(s for read in (laws, loops) for x in read for s in x.sentences())


def _established(d: Decision) -> Study:
    """The study with the effects that are established, and the estimates beside them."""
    h, averaged = (d.best, d.averaged) if d.verdict in FOUND else (d.empty, (d.empty,))
    effects = tuple((kind, of.parameters_of(h, k)) for k, kind in enumerate(h.kinds))
    return of.declared(h.variant.study, of.estimates(h, averaged), effects)


def _table(search: Search, d: Decision) -> tuple[Hypothesis, ...]:
    """All hypotheses, those that predict best first."""
    out = []
    for h in search.ranked:
        relation = "less likely"
        if h is d.best:
            relation = "best"
        elif h in d.tied:
            relation = "tied"
        elif set(h.names) < set(d.best.names):
            relation = "simpler"
        elif set(h.names) > set(d.best.names):
            relation = "wider"
        gain = _predicted(h, d.empty) if len(h.elpd) > 1 else (np.nan, np.nan)
        out.append(Hypothesis(h.names, h.variant.name, h.score - d.empty.score, *gain, relation))
    return tuple(sorted(out, key=lambda h: (h.relation != "best", -h.elpd if np.isfinite(h.elpd) else -h.log_evidence)))


def _predicted(h: Fitted, empty: Fitted) -> tuple[float, float]:
    """Difference in log predictive density (nats), as it is, and its paired standard error."""
    difference = h.elpd - empty.elpd
    return float(np.sum(difference)), float(np.std(difference, ddof=1) * np.sqrt(len(difference)))


def _ranking(search: Search, d: Decision) -> tuple[Ranked, ...]:
    """Every effect type, from its likeliest hypothesis alone, or from first order."""
    settings, empty, out = search.variants[0].settings, d.empty, dict[str, Ranked]()
    rivals = {k for h in (d.best, *d.tied) for k in h.names} if d.verdict in FOUND else set()
    for h in search.ranked:
        if len(h.names) != 1 or h.names[0] in out:
            continue
        kind, gain = h.names[0], h.score - empty.score
        verdict, tied = TOO_LITTLE if gain >= settings.tied else _seen(h), tuple[str, ...]()
        if kind in d.best.names and d.verdict in FOUND:
            verdict, tied = (TIED, tuple(sorted(rivals - {kind}))) if d.verdict == TIE else (_named(search, d), ())
        elif kind in rivals:
            verdict, tied = TIED, tuple(sorted(rivals - {kind}))
        full = kind in rivals or len(out) < settings.most_effects
        out[kind] = replace(_ranked(h, kind, gain, verdict, tied, full), rms_validate=_rms_unseen(h) if full else None)
    for kind, s in search.scores.items():
        if kind not in out:
            p = s.component.entry.parameters(s.amplitudes, s.component.site, empty.variant.context)
            verdict = TIED if kind in rivals else TOO_LITTLE if s.gain >= settings.tied else ABSENT
            out[kind] = Ranked(kind, p, s.gain, _p(s.gain), verdict)
    order = {kind: k for k, kind in enumerate(d.best.names)}
    return tuple(sorted(out.values(), key=lambda r: (order.get(r.kind, len(order)), -r.log_evidence)))


def _rms_unseen(h: Fitted) -> float | None:
    """RMS distance (m) of the validate poses; None without any, and where one is not solved."""
    shapes, program = h.predicted, h.variant.held_out
    if program is None or not all(map(of.stable, shapes)):
        return None
    rows = np.concatenate([shape.residual[keep] for shape, keep in zip(shapes, program.real, strict=True)])
    return float(np.sqrt(np.mean(np.sum(rows**2, axis=1))))


def _named(search, d):
    """Whether the best hypothesis leads far over those of as many effects."""
    best, s = d.best, search.variants[0].settings
    others = [h for h in search.causes if len(h.names) == len(best.names) and set(h.names) != set(best.names)]
    return NAMED if all(leads(best, h, s.named) for h in others) else FAVOURED


def _seen(h: Fitted) -> str:
    """Whether the absence of an effect is a finding: one usual size of it would have been seen."""
    if not h.components:
        return ABSENT
    at = h.index.amplitudes(0)
    size = h.components[0].entry.size(h.variant.context)
    spread = np.sqrt(np.diag(h.covariance)[at])
    return ABSENT if np.any(3.0 * spread < size) else INCONCLUSIVE


def _p(gain: float) -> float:
    return float(1.0 / (1.0 + np.exp(min(gain, 700.0))))


def _ranked(h: Fitted, kind: str, gain: float, verdict: str, tied=(), full: bool = True) -> Ranked:
    """An effect of a hypothesis."""
    if kind == h.variant.effect:  # memory, whose parameters are unknowns of its variant
        own = {n.partition(".")[2]: e for n, e in of.estimates(h, (h,)).items() if n.startswith(f"{kind}.")}
        std = {name: e.std for name, e in own.items() if e.std is not None}
        return Ranked(kind, {name: e.value for name, e in own.items()}, gain, _p(gain), verdict, tied, rms_fit=h.rms, std=std)
    k = h.kinds.index(kind)
    std = of.spreads_of(h, k) if full else {}
    return Ranked(kind, of.parameters_of(h, k), gain, _p(gain), verdict, tied, rms_fit=h.rms, std=std)


def _chosen(d: Decision, ranking) -> tuple[Ranked, ...]:
    """The effects found, with their parameters and evidence in the best hypothesis."""
    if d.verdict not in FOUND:
        return ()
    known, gain = {r.kind: r for r in ranking}, d.best.score - d.empty.score
    of_kind = {kind: (known[kind].verdict, known[kind].tied_with) if kind in known else (FAVOURED, ()) for kind in d.best.names}
    return tuple(_ranked(d.best, kind, gain, *of_kind[kind]) for kind in d.best.names)


def _settle(d: Decision) -> tuple[str, ...]:
    """The measurements that would distinguish the tied effects."""
    known = {e.kind for e in catalogue()}
    kinds = sorted({k for h in (d.best, *d.tied) for k in h.names if k in known})
    return tuple(f"{kind}: {entry_of(kind).settle}" for kind in kinds)


def _poses(d: Decision) -> dict[str, PoseChange]:
    """Every pose before and after, in the order of the study."""
    before, after, study = pose_fits(d.empty), pose_fits(d.best), d.best.variant.study
    left: dict[str, tuple[float, float]] = {}
    if len(study.fit_poses) > 1:
        figures = zip(of.left_out(d.empty).tolist(), of.left_out(d.best).tolist(), strict=True)
        left = dict(zip((pose.name for pose in study.fit_poses), figures, strict=True))
    changed = {}
    for name, pose in after.items():
        old, (was, now) = before[name], left.get(name, (None, None))
        more = {"rms_before": old.rms, "residual_before": old.residual, "left_out_before": was, "left_out": now}
        changed[name] = PoseChange(**vars(pose) | more)
    return changed


def _findings(d: Decision, chosen, poses, discrepancy, coarse) -> list[Finding]:
    """What is to be said, in its order."""
    v, kinds = d.best.variant, [r.kind for r in chosen]
    if d.verdict == UNSOLVED:
        return [Finding("coarse", "fault", {"poses": ", ".join(coarse)})]
    out, shown = [*_of_verdict(d, kinds), *_of_effects(kinds, poses)], d.best if kinds else d.empty
    if smooth(shown):
        out.append(Finding("smooth", "doubt", {"mm": 1e3 * np.sqrt(2) * shown.variant.likelihood.noise(shown.u).total}))
    for pose, ratio in d.surprised.items():
        out.append(Finding("surprise" if np.isfinite(ratio) else "unseen", "fault", {"pose": pose, "ratio": ratio}))
    if discrepancy.curvature:
        size = {"mm": 1e3 * discrepancy.rms, "percent": 100 * discrepancy.relative}
        out.append(Finding("discrepancy", "doubt", size))
    out += [Finding("less", "doubt", {"mistake": str(m)}) for m in v.fit.mistakes if kinds]
    return out


def _of_verdict(d: Decision, kinds) -> Iterator[Finding]:
    """The verdict, and what stands against the likeliest hypotheses where none is established."""
    v, many = d.best.variant, {"effects": listed(kinds), "explains": "explain" if len(kinds) > 1 else "explains"}
    if d.verdict == NONE:
        if d.cause is not None and belief.of_the_axis(d.empty) and leads(d.cause, d.empty, v.settings.found):
            size = {"mm": 1e3 * d.empty.rms, "percent": 100 * d.empty.rms / v.context.radius_or_guess}
            yield Finding("axis", values=size | {"effects": listed(d.cause.names)})
        else:
            yield Finding("nothing", values={"p": d.p_value})
    elif d.verdict == UNEXPLAINED:
        yield Finding("unexplained", "fault")
        cause, field = d.cause, d.description
        if field is not None and field.score > max(d.empty.score, cause.score if cause else -np.inf):
            words = {"field": FIELDS.get(field.kinds[0], listed(field.kinds)), "nats": field.score - d.empty.score}
            yield Finding("field", "doubt", words)
        if cause is not None and cause.score > d.empty.score:
            yield Finding("likeliest", "doubt", {"effects": listed(cause.names), "nats": cause.score - d.empty.score})
        if len(d.empty.elpd) < FEWEST:
            yield Finding("one_pose" if len(d.empty.elpd) == 1 else "two_poses", "doubt")
    elif d.verdict == TIE:
        rivals = [listed(h.names) for h in d.tied] or [f"an error of the {s.other}" for s in errors_of_input(kinds)]
        yield Finding("tied", "doubt", many | {"rivals": " or ".join(dict.fromkeys(rivals))})
    else:
        yield Finding("partly" if d.verdict == PARTLY else "explains", "doubt" if d.verdict == PARTLY else "fine", many)


def _of_effects(kinds, poses) -> Iterator[Finding]:
    """The error before and after, and inputs whose errors look alike."""
    if not kinds:
        return
    yield _change(poses, kinds)
    known = [p for p in poses.values() if p.left_out is not None and np.isfinite(p.left_out)]
    if known:
        yield Finding("better", values={"better": sum(p.left_out < p.left_out_before for p in known), "poses": len(known)})
    for same in errors_of_input(kinds):
        yield Finding("as_good", "doubt", {"effects": listed(kinds), "other": same.other.replace("_", " "), "when": same.words})


def _change(poses, kinds) -> Finding:
    """The error before and after."""
    fitted, unseen = ([p for p in poses.values() if p.role == role] for role in ("fit", "validate"))
    was, now, more = 1e3 * rms_over(fitted, "rms_before"), 1e3 * rms_over(fitted, "rms"), ""
    for group, figures, words in (
        (fitted if len(fitted) > 1 else [], ("left_out_before", "left_out"), "poses left out"),
        (unseen, ("rms_before", "rms"), "validate poses"),
    ):
        a, b = (1e3 * rms_over(group, figure) for figure in figures)
        more += f", in {words} from {a:.2f} to {b:.2f} mm" if np.isfinite(a) and np.isfinite(b) else ""
    moves = "falls" if now < was else "rises"
    return Finding("change", values={"effects": listed(kinds), "moves": moves, "was": was, "now": now, "more": more})

