"""Design of the next pose: its expected information on parameters and rival effects, before it is scanned.

The gain for the parameters is D-optimal, half the decrease of the log determinant of their covariance. The gain for two rival
effects is T-optimal: in a linear model of both signatures and the base parameters, the squared part of effect ``a`` at its
refitted size that effect ``b`` and the base cannot imitate is twice the expected lead of ``a`` over ``b`` in log likelihood.
All gains are to first order at the hypothesis without effects, in the metric of its noise and discrepancy. With memory a
candidate comes after all poses of the study.
Reference: Atkinson and Fedorov, "The design of experiments for discriminating between two rival models" (1975).
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import jax
import numpy as np

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting.parameters import model_at, template
from scan2flex_jax.fitting.poses import boundary_of, poses_of
from scan2flex_jax.posterior.decision import NONE
from scan2flex_jax.posterior.posterior import Fitted, configuration
from scan2flex_jax.posterior.program import Component, Index, Program
from scan2flex_jax.posterior.rows import Rows
from scan2flex_jax.results.explanation import Explanation
from scan2flex_jax.statics.solve import equilibrium
from scan2flex_jax.statics.verdict import SENTENCES
from scan2flex_jax.study.model import MeasuredCurve, Study, StudyPose
from scan2flex_jax.study.rotations import rolled

_RIVALS = 4  # largest number of rivals that are compared
_ALIKE = "no pose below tells {} from {}: look at the cable itself, or try poses of your own (`scan2flex_jax.plan`)"
POINTS = 48  # of the simulated curve of a candidate


@dataclass(frozen=True)
class Candidate:
    """A candidate pose.

    ``parameters`` (nats): gain for the unknowns; ``settles``: per pair of rival effects the expected lead (nats) of either over
    the other with this pose, the smaller of both directions; ``lead_now``: the same without it. ``note``: the reason why a pose
    is not solved and has no gain.
    """

    name: str
    words: str
    parameters: float
    settles: dict[tuple[str, str], float]
    lead_now: dict[tuple[str, str], float]
    pose: StudyPose
    note: str = ""

    @property
    def worth(self) -> float:
        """Sort key of the ranking: the least lead over all pairs of rivals, or without rivals the gain for the parameters."""
        return min(self.settles.values()) if self.settles else self.parameters


@dataclass(frozen=True)
class Plan:
    """Candidates, the most informative first, the rivals to distinguish, and the pairs that none of the candidates would tell
    apart."""

    candidates: tuple[Candidate, ...]
    rivals: tuple[str, ...]
    alike: tuple[tuple[str, str], ...] = ()

    def summary(self) -> str:
        """In plain text."""
        if not self.candidates:
            return "no pose to rank: poses are varied by their clamps, and supports alone hold these"
        pairs = list(self.candidates[0].lead_now) if self.candidates else []
        lines = ["next poses to scan, the most informative first", ""]
        if pairs:
            lines += [f"  rivals to distinguish: {', '.join(self.rivals)}", *(f"  {_ALIKE.format(*p)}" for p in self.alike), ""]
        head = "".join(f"{f'{a} / {b}'[:34]:>36}" for a, b in pairs)
        lines += [f"  {'pose':<52}{'parameters':>12}{head}   (nats)"]
        if pairs:
            now = "".join(f"{self.candidates[0].lead_now[p]:36.1f}" for p in pairs)
            lines += [f"  {'(none more)':<52}{0.0:12.2f}{now}"]
        for c in self.candidates:
            own = "".join(f"{c.settles.get(p, 0.0):36.1f}" for p in pairs)
            lines.append(f"  {c.words[:50]:<52}{c.parameters:12.2f}{own}" + (f"   {c.note}" if c.note else ""))
        return "\n".join(lines)

    def to_json(self) -> dict:
        """Lists and numbers."""
        return {
            "rivals": list(self.rivals),
            "alike": [list(pair) for pair in self.alike],
            "candidates": [
                {"name": c.name, "words": c.words, "parameters": c.parameters, "note": c.note,
                 "settles": [{"pair": list(p), "lead": v, "lead_now": c.lead_now[p]} for p, v in c.settles.items()]}
                for c in self.candidates
            ],
        }  # fmt: skip


def plan(explanation: Explanation, candidates: Iterable[StudyPose] | None = None) -> Plan:
    """Rank candidate poses by the information that they would add.

    Args:
        explanation: The result of `explain`. Rivals are the effects of its tie, or the best two; none where nothing is missing
            or memory was found.
        candidates: Study poses (their curves, if any, are ignored). Default: variations of the fitted ones, with the end clamp
            twisted, both clamps rolled, the clamps nearer to each other, or the end clamp moved aside; with memory also each
            fitted pose again, last: approached from another side, or after it has crept.

    Returns:
        The candidates, ranked, with their gains.

    Raises:
        Scan2FlexError: The explanation has no baseline fit.

    Examples:
        >>> print(plan(explain(study)).summary())  # doctest: +SKIP
    """
    decision = explanation.decision
    if decision is None:
        raise Scan2FlexError("There is no plan without a solved baseline fit: the explanation has the reason.")
    memory = bool(decision.best.variant.effect)
    base = decision.best if memory else decision.empty
    given = None if candidates is None else [(p.name, p) for p in candidates]
    return ranked_poses(base, [] if memory else _rivals(explanation), given)


def ranked_poses(base: Fitted, rivals: list[tuple[Component, np.ndarray]], given=None) -> Plan:
    """The plan beside a hypothesis without effects: of the poses ``given`` with words, by default `variations`."""
    given = variations(base.variant.study) if given is None else given
    old = _information(base, base.variant.program, base.shapes, base.variant.rows, rivals)
    leads, now = _leads(rivals, old), _log_volume(old, base)
    out = [_judge(base, words, pose, rivals, old, leads, now) for words, pose in given]
    out.sort(key=lambda c: (bool(c.note), -round(c.worth, 1), -c.parameters))
    alike = tuple(p for p in leads if all(c.settles.get(p, 0.0) < base.variant.settings.tied for c in out))
    return Plan(tuple(out), tuple(c.kind for c, _ in rivals), alike)


def variations(study: Study) -> list[tuple[str, StudyPose]]:
    """``(words, pose)``: variations of the first fitted poses that need no other clamps."""
    out = [(f"{pose.name} again, last", pose) for pose in study.fit_poses] if study.history_dependent else []
    for pose in study.fit_poses[:3]:
        if pose.start is None:  # supports hold it, which are effects of the study
            continue
        if pose.end is None:
            out += _held_poses(pose, ((f"{pose.name}, start clamp rolled by {d} degrees", "start", d) for d in (90, 180)))
            continue
        turned = [(f"{pose.name}, end clamp twisted by {d:+d} degrees", "end", d) for d in (90, -90)]
        out += _held_poses(pose, [*turned, (f"{pose.name}, both clamps rolled by 180 degrees", "both", 180)])
        chord = pose.end.position - pose.start.position
        near = replace(pose.end, position=pose.start.position + 0.8 * chord)
        side = np.cross(chord, study.gravity_in(pose))
        side = side / max(np.linalg.norm(side), 1e-12) * 0.25 * np.linalg.norm(chord)
        aside = replace(pose.end, position=pose.end.position + side)
        out.append((f"{pose.name}, end clamp a fifth nearer", replace(pose, end=near)))
        out.append((f"{pose.name}, end clamp {np.linalg.norm(side):.2f} m aside", replace(pose, end=aside)))
    return out


def _held_poses(pose, changes):
    out = []
    for words, which, degrees in changes:
        start = _rolled(pose.start, degrees) if which in ("start", "both") else pose.start
        end = _rolled(pose.end, degrees) if which in ("end", "both") else pose.end
        out.append((words, replace(pose, start=start, end=end)))
    return out


def _rolled(clamp, degrees):
    """The clamp rotated about its tangent d3; a ball joint is unchanged."""
    if clamp.quaternion is None:
        return clamp
    return replace(clamp, quaternion=rolled(clamp.quaternion, np.deg2rad(degrees)))


def _rivals(explanation) -> list[tuple[Component, np.ndarray]]:
    """Components and amplitudes of the tied effects, or of the best two, each alone; none where nothing is missing."""
    decision, alone = explanation.decision, dict[str, Fitted]()
    if decision.verdict == NONE:
        return []
    kinds = list(dict.fromkeys(k for h in (decision.best, *decision.tied) for k in h.kinds))
    for h in explanation.singles:
        alone.setdefault(h.kinds[0], h)
    chosen = [k for k in kinds if k in alone]
    chosen += [k for k in alone if k not in chosen][: max(0, 2 - len(chosen))]
    return [(alone[k].components[0], alone[k].amplitudes(0)) for k in chosen[:_RIVALS]]


def _information(base: Fitted, program: Program, shapes, rows: Rows, rivals) -> np.ndarray:
    """Precision of the shared parameters, then of the amplitudes of the rivals, given poses; their own parameters are
    eliminated under their priors. Those of the study's poses include the priors of shared parameters."""
    v, n = base.variant, Index(program, ())
    x = base.x if program is v.program else v.unseen_vector(base, program)
    start = configuration(shapes)
    columns = [s.columns[..., :0] for s in shapes]
    if rivals:
        found, owner = program.columns((), x, start, [c for c, _ in rivals])
        columns = [c[..., np.argsort(owner, kind="stable")] for c in found]
    X, S = rows.of(shapes, [s.columns for s in shapes]), rows.of(shapes, columns)
    Z = rows.of(shapes, program.scatter((), x, start))
    Li = v.likelihood.on(rows).whitening(base.u, Z)
    both = Li @ np.concatenate([X[:, :, : n.shared], S, X[:, :, n.shared :]], axis=2)
    total, k = np.zeros((n.shared + S.shape[2],) * 2), n.shared + S.shape[2]
    if program is v.program:
        total[: n.shared, : n.shared] = np.diag(base.linear.precision[: n.shared])
    for white in both:
        G = white.T @ white
        own = G[k:, k:] + np.eye(n.local)
        total += G[:k, :k] - G[:k, k:] @ np.linalg.solve(own, G[k:, :k])
    return total


def _judge(base: Fitted, words, pose, rivals, old, leads, now) -> Candidate:
    try:
        program = _measured(base, pose)
        shapes = program.shapes((), base.variant.unseen_vector(base, program))
        both = old + _information(base, program, shapes, Rows(shapes, program), rivals)
    except Scan2FlexError as error:
        return Candidate(pose.name, words, 0.0, {}, leads, pose, note=str(error))
    return Candidate(pose.name, words, float(now - _log_volume(both, base)), _leads(rivals, both), leads, pose)


def _measured(base: Fitted, pose: StudyPose) -> Program:
    """A program of the one pose, with its predicted equilibrium as the measurement; with memory after all others."""
    problem, program, shared = base.variant.problem, base.variant.program, base.x[: base.index.shared]
    study, elements = problem.study, program.elements
    if study.history_dependent:
        later = None if study.poses[-1].time is None else study.poses[-1].time + _pause(study)
        pose = replace(pose, name=f"{pose.name}, next", role="fit", repeat_of=None, reset=False, time=later)
        whole = replace(study, poses=(*study.poses, pose))
        last = problem.evaluator_of(poses_of(whole, [pose], problem.length, elements))(shared)
        if not last.solved:
            raise Scan2FlexError(f"not solved: {SENTENCES[int(last.verdict.code[0])]}")
        points, settled = np.asarray(last.configuration.r[0]), last.configuration
    else:
        model = model_at(program.layout, template(study, pose), shared)
        e = equilibrium(model, boundary_of(pose), turns=int(pose.turns), elements=elements)
        if not bool(e.verdict.solved):
            raise Scan2FlexError(f"not solved: {e.verdict.sentence()}")
        points, settled = np.asarray(e.points), jax.tree.map(lambda x: np.asarray(x)[None], e.configuration)
    keep = np.unique(np.linspace(0, elements, min(POINTS, elements + 1)).round().astype(int))[1:-1]
    seen = measured_in_simulation(pose, points[keep])
    whole = replace(study, poses=(*study.poses, seen)) if study.history_dependent else study
    return Program(problem, base.variant.minimum, replace(poses_of(whole, [seen], problem.length, elements), start=settled))


def measured_in_simulation(pose: StudyPose, points: np.ndarray) -> StudyPose:
    """A pose with the ``points`` (n, 3) of its simulated curve (m) and its other readings; with these alone it has no curve."""
    if pose.measured and not pose.seen:
        return pose
    if pose.change_from is not None:  # places, where changes were read
        pose = replace(pose, angle=(), wrench=(), change_from=None)
    return replace(pose, curve=MeasuredCurve(points, None), markers=None, scan=None)


def _pause(study):
    """Mean time (s) between two poses."""
    times = [pose.time for pose in study.poses if pose.time is not None]
    return float(np.ptp(times)) / max(len(times) - 1, 1)


def _leads(rivals, information) -> dict[tuple[str, str], float]:
    """Per pair the smaller of both expected leads (nats)."""
    sizes = np.cumsum([len(information) - sum(len(a) for _, a in rivals), *(len(a) for _, a in rivals)])
    spans = [np.arange(p, q) for p, q in pairwise(sizes)]
    base, out = np.arange(sizes[0]), {}

    def lead(a, x, b):
        rest = np.r_[base, spans[b]]
        G = information[np.ix_(rest, rest)]
        scale = np.sqrt(np.diag(G)) + 1e-150
        cross = information[np.ix_(rest, spans[a])] @ x / scale
        imitated = cross @ np.linalg.lstsq(G / np.outer(scale, scale), cross, rcond=1e-10)[0]
        return float(0.5 * max(x @ information[np.ix_(spans[a], spans[a])] @ x - imitated, 0.0))

    for (i, (a, x)), (j, (b, z)) in combinations(enumerate(rivals), 2):
        out[a.kind, b.kind] = min(lead(i, x, j), lead(j, z, i))
    return out


def _log_volume(information, base: Fitted) -> float:
    """Half the log determinant of the covariance of the unknowns."""
    n, unknowns = base.index.shared, base.variant.program.layout.unknowns
    A = information[:n, :n]
    scale = np.sqrt(np.diag(A)) + 1e-150
    inverse = np.linalg.pinv(A / np.outer(scale, scale), rcond=1e-12, hermitian=True)
    own = inverse[:unknowns, :unknowns]
    return float(0.5 * np.linalg.slogdet(own + 1e-12 * np.eye(unknowns))[1] - np.sum(np.log(scale[:unknowns])))
