"""`explain`: fit, test, search, judge, and the error before and after. Each step has its module."""

import time
from collections.abc import Callable

import numpy as np

from scan2flex_jax.effects.catalogue import catalogue, entry_of
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.explain import gates, report, search, verdict
from scan2flex_jax.explain.evidence import one_step
from scan2flex_jax.explain.families import WORDS
from scan2flex_jax.explain.result import Explanation, Ranked
from scan2flex_jax.explain.sensitivity import Bench
from scan2flex_jax.fit import fit as plain_fit
from scan2flex_jax.fit.poses import poses_of
from scan2flex_jax.fit.run import FIT_ELEMENTS


def explain(
    study, *, elements: int = FIT_ELEMENTS, progress: Callable[[str], None] | None = None, seed: int = 0, mesh: bool = True
) -> Explanation:
    """What physics the plain rod lacks for the ``fit`` poses of ``study``; its ``validate`` poses have no part in it.

    ``progress`` is called with a line of text now and then; ``seed`` draws the noise of the test; ``mesh`` False leaves out
    the gate that doubles the mesh. Poses that cannot be solved give the verdict "not in equilibrium", never an exception.
    """
    began, say = time.perf_counter(), progress or (lambda message: None)
    say("plain fit")
    try:
        fitted = plain_fit(study, elements=elements)
    except Scan2FlexError as error:
        if "settle" not in str(error):
            raise
        seconds = time.perf_counter() - began
        return Explanation(study, None, verdict.UNSOLVED, 1.0, None, sentences=(str(error),), seconds=seconds)
    problem, minimum = fitted.problem
    bench = Bench(problem, minimum)
    say("signatures of the catalogue")
    stated = [p.noise for p in study.fit_poses if p.noise is not None]
    stage = search.prepare(bench, minimum, float(np.sqrt(np.mean(np.square(stated)))) if stated else None, seed)
    found = _Search(stage, say)
    error = gates.mesh_error(problem, minimum) if mesh else None
    return _explanation(study, fitted, stage, found, error, began)


class _Search:
    """The steps of the search and what each found."""

    def __init__(self, stage, say):
        say("test")
        self.test, self.after = search.test(stage), None
        self.values, amplitudes, self.table = search.one_step(stage)
        self.singles, self.pairs, self.best, self.tied = [], [], stage.base, [stage.base]
        self.verdict = verdict.NONE
        if self.test.p_value > verdict.ALARM:
            return
        self.singles = search.refit_singles(stage, amplitudes, self.table, self.test.T, say)
        self.best = self.singles[0]
        self.after = search.test_after(stage, self.best)
        if self.after.p_value <= verdict.ALARM and stage.bench.poses.count >= 3:
            both = search.refit_pairs(stage, self.values, say) + search.refit_greedy(stage, self.best, say)
            self.pairs = search.one_of_each(both)
            if search.accepted(self.after.p_value, self.best, self.pairs[0] if self.pairs else None):
                self.best = self.pairs[0]
                self.after = search.test_after(stage, self.best)
        rivals = self.pairs if len(self.best.components) > 1 else self.singles
        candidates = [verdict.Candidate(r.kinds, r.log_evidence, r.cost, search.same_shapes(r)) for r in rivals]
        self.tied = [rivals[i] for i in verdict.ties(candidates)]
        gain = max(self.test.family_gain.values())
        self.verdict = verdict.whole(self.test.p_value, self.after.p_value, candidates, gain)
        self.lead = verdict.leading(candidates)


def _explanation(study, fitted, stage, found, mesh, began):
    bench, base = stage.bench, stage.base
    other = None
    if study.validate_poses:
        poses = poses_of(study.validate_poses, bench.problem.length, bench.elements)
        other = Bench(bench.problem, fitted.problem[1], poses)
    chosen_refit = found.best if found.verdict in (verdict.EXPLAINED, verdict.TIE) else base
    poses = report.pose_changes(study.fit_poses, bench, base.shapes, chosen_refit.shapes)
    if other:
        before, after = report.predicted(other, base), report.predicted(other, chosen_refit)
        poses |= report.pose_changes(study.validate_poses, other, before, after)
    ranking = _ranking(stage, found, other)
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
    names = [p.name for p in study.fit_poses]
    sentences = _sentences(found, chosen) + gates.sentences(mesh, stage.noise, names)
    ordered = {p.name: poses[p.name] for p in study.poses if p.name in poses}
    return Explanation(
        report.declared(study, estimates, chosen) if kinds else fitted.calibrated, fitted, found.verdict, found.test.p_value,
        stage.noise, ranking, chosen, found.after.p_value if found.after else None, estimates, ordered,
        found.test.family_gain, report.settle_sentences(tie_kinds) if found.verdict == verdict.TIE else (), sentences,
        {} if mesh is None else {"mesh_error": float(np.max(mesh))}, time.perf_counter() - began,
    )  # fmt: skip


def _ranking(stage, found, other):
    """Every kind: the refitted ones first by evidence, the others by their one-step evidence."""
    bench, out = stage.bench, {}
    tie_kinds = [k for r in found.tied for k in r.kinds] if found.best.components else []
    best = found.best.kinds
    for r in found.singles:
        kind = r.kinds[0]
        p = float(found.test.adjusted[found.table[kind][1]])
        judged = _judged(kind, best, tie_kinds, found, r.log_evidence, stage)
        shapes = report.predicted(other, r) if other and judged[0] in (verdict.NAMED, verdict.FAVOURED, verdict.TIED) else None
        out[kind] = report.ranked(
            bench, r, 0, log_evidence=r.log_evidence, p_value=p, verdict=judged[0], tied_with=judged[1],
            rms_fit=report.rms(bench, r.shapes), rms_validate=None if shapes is None else report.rms(other, shapes),
        )  # fmt: skip
    for kind, (value, g) in sorted(found.table.items(), key=lambda item: -item[1][0]):
        if kind not in out:
            c, group = stage.components[g], stage.groups[g]
            a = one_step(group.X.T @ group.X, group.X.T @ stage.y) * c.entry.size(bench.context)
            a = np.clip(a, *c.entry.bounds(bench.context))
            judged = _judged(kind, best, tie_kinds, found, value, stage)
            p = float(found.test.adjusted[g])
            out[kind] = Ranked(kind, c.entry.to_parameters(a, c.site, bench.context), value, p, *judged)
    return tuple(sorted(out.values(), key=lambda r: -r.log_evidence if r.kind not in best else -np.inf))


def _judged(kind, best, tie_kinds, found, value, stage):
    """``(verdict, tied with)`` of a kind."""
    if found.verdict in (verdict.EXPLAINED, verdict.TIE) and kind in tie_kinds:
        if found.lead == verdict.TIED:
            return verdict.TIED, tuple(k for k in dict.fromkeys(tie_kinds) if k != kind)
        return found.lead, ()
    group = stage.groups[found.table[kind][1]]
    return verdict.of_kind(value, float(np.linalg.norm(group.X, axis=0).max())), ()


def _sentences(found, chosen):
    p = found.test.p_value
    family, gain = max(found.test.family_gain.items(), key=lambda item: item[1])
    if found.verdict == verdict.NONE:
        return (f"the plain rod explains these shapes to within the noise (p = {p:.3f})",)
    if found.verdict == verdict.UNEXPLAINED:
        text = f"something is missing (p = {p:.3f}) and no known effect explains it"
        tail = f"; it behaves like {WORDS[family]} ({gain:.1f} nats), which describes and does not name" if gain > 0 else ""
        return (text + tail,)
    names = " and ".join(r.kind for r in chosen)
    text = f"something is missing (p = {p:.3f}); {names} explains it"
    rest = found.after.p_value
    tail = "what is left is noise" if rest > verdict.ALARM else f"some structure is left (p = {rest:.3f})"
    return (f"{text}; {tail}", *_never_told(chosen))


def _never_told(chosen):
    """What is no kind of the catalogue and gives the same shapes all the same."""
    out = []
    for r in chosen:
        for other, when in entry_of(r.kind).same_shapes:
            if "always" in when and other not in {e.kind for e in catalogue()}:
                out.append(f"shapes alone never tell {r.kind} from an error of the {other.replace('_', ' ')}: {when}")
    return tuple(out)
