"""Design of the next pose: its expected information on parameters and rival effects, before it is scanned.

The gain for the parameters is D-optimal, half the decrease of the log determinant of their covariance. The gain for two rival
effects is T-optimal: in a linear model of both signatures and the base parameters, the squared part of effect ``a`` at its
refitted size that effect ``b`` and the base cannot imitate is twice the expected lead of ``a`` over ``b`` in log likelihood.
All gains are to first order at the baseline fit, with its estimated noise. With memory a candidate comes after all poses of the
study, and derivatives go through their order.
Reference: Atkinson and Fedorov, "The design of experiments for discriminating between two rival models" (1975).
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import combinations

import jax
import numpy as np

from scan2flex_jax.diagnosis.refit import configurations
from scan2flex_jax.diagnosis.residual import Law, Whitened, orthonormal, whiten
from scan2flex_jax.diagnosis.result import Explanation
from scan2flex_jax.diagnosis.sensitivity import Bench, Component, Numbers
from scan2flex_jax.diagnosis.stage import Stage
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting import Fit
from scan2flex_jax.fitting.parameters import model_at, template
from scan2flex_jax.fitting.poses import boundary_of, poses_of
from scan2flex_jax.statics.solve import equilibrium
from scan2flex_jax.statics.verdict import SENTENCES
from scan2flex_jax.study.model import Clamp, MeasuredCurve, Study, StudyPose

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
    """Candidates, the most informative first, and the rivals to distinguish."""

    candidates: tuple[Candidate, ...]
    rivals: tuple[str, ...]

    def summary(self) -> str:
        """In plain text."""
        pairs = list(self.candidates[0].lead_now) if self.candidates else []
        lines = ["next poses to scan, the most informative first", ""]
        if pairs:
            lines += [f"  rivals to distinguish: {', '.join(self.rivals)}", ""]
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
            "candidates": [
                {"name": c.name, "words": c.words, "parameters": c.parameters, "note": c.note,
                 "settles": [{"pair": list(p), "lead": v, "lead_now": c.lead_now[p]} for p, v in c.settles.items()]}
                for c in self.candidates
            ],
        }  # fmt: skip


def plan(explanation: Explanation, candidates: Iterable[StudyPose] | None = None) -> Plan:
    """Rank candidate poses by the information that they would add.

    Args:
        explanation: The result of `explain`. Rivals are the effects of its tie, or the best two; none where memory was found.
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
    found = explanation.search
    if found is None:
        raise Scan2FlexError("There is no plan without a solved baseline fit: the explanation has the reason.")
    stage = found.stage if explanation.remembering is None else _of_memory(found.stage, explanation.remembering)
    given = [(p.name, p) for p in candidates] if candidates is not None else variations(stage.bench.problem.study)
    rivals = _rivals(found) if explanation.remembering is None else []
    old = stage.white
    columns = {c.kind: -old.stack(_columns(stage.bench, stage, c)) for c, _ in rivals}
    leads = _leads(rivals, columns, old.J)
    now = _log_volume(old.J, stage.bench.layout.unknowns)
    out = [_judge(stage, words, pose, rivals, columns, leads, now) for words, pose in given]
    return Plan(tuple(sorted(out, key=lambda c: (bool(c.note), -c.worth))), tuple(c.kind for c, _ in rivals))


def variations(study: Study) -> list[tuple[str, StudyPose]]:
    """``(words, pose)``: variations of the first fitted poses that need no other clamps."""
    out = [(f"{pose.name} again, last", pose) for pose in study.fit_poses] if study.remembers else []
    for pose in study.fit_poses[:3]:
        if pose.end is None:
            out += _held_poses(pose, ((f"{pose.name}, start clamp rolled by {d} degrees", "start", d) for d in (90, 180)))
            continue
        turned = [(f"{pose.name}, end clamp twisted by {d:+d} degrees", "end", d) for d in (90, -90)]
        out += _held_poses(pose, [*turned, (f"{pose.name}, both clamps rolled by 180 degrees", "both", 180)])
        chord = pose.end.position - pose.start.position
        near = Clamp(pose.start.position + 0.8 * chord, pose.end.quaternion)
        side = np.cross(chord, study.gravity_in(pose))
        side = side / max(np.linalg.norm(side), 1e-12) * 0.25 * np.linalg.norm(chord)
        aside = Clamp(pose.end.position + side, pose.end.quaternion)
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
    h = np.deg2rad(degrees) / 2
    w, x, y, z = clamp.quaternion
    a, b = np.cos(h), np.sin(h)
    return Clamp(clamp.position, np.array([w * a - z * b, x * a + y * b, y * a - x * b, z * a + w * b]))


def _of_memory(stage: Stage, fitted: Fit) -> Stage:
    """The stage of the fit with the memory that was found, in which poses follow one another."""
    bench, minimum = Bench(fitted.problem, fitted.minimum), fitted.minimum
    vector = np.r_[minimum.shared, minimum.local.ravel()]
    shapes, law = bench.shapes((), vector), Law(fitted.noise)
    white = whiten(shapes, bench.real, Numbers(bench, ()), vector, law)
    return replace(stage, bench=bench, law=law, base=replace(stage.base, vector=vector, shapes=shapes), white=white)


def _rivals(found):
    """Components and amplitudes of the tied effects, or of the best two, each alone."""
    kinds = list(dict.fromkeys(k for r in found.tied for k in r.kinds))
    singles = {r.kinds[0]: r for r in found.singles}
    chosen = [k for k in kinds if k in singles]
    chosen += [k for k in singles if k not in chosen][: max(0, 2 - len(chosen))]
    return [(singles[k].components[0], singles[k].amplitudes(found.stage.bench, 0)) for k in chosen[:4]]


def _columns(bench, stage, component: Component):
    start = configurations(stage.base.shapes) if bench is stage.bench else bench.start
    return bench.catalogue_columns(_own(bench, stage), [component], start)[0]


def _own(bench, stage):
    """Base parameters for the poses of ``bench``: shared ones as fitted, local ones zero."""
    if bench is stage.bench:
        return stage.base.vector
    shared = Numbers(stage.bench, ()).shared
    return np.r_[stage.base.vector[:shared], np.zeros(Numbers(bench, ()).base - shared)]


def _judge(stage, words, pose, rivals, columns, leads, now):
    try:
        bench, white = _scanned(stage, pose)
    except Scan2FlexError as error:
        return Candidate(pose.name, words, 0.0, {}, leads, pose, note=str(error))
    J, rows = _together(stage.white, white, stage.bench)
    both = {k: np.concatenate([S, -white.stack(_columns(bench, stage, c))[rows]]) for (c, _), (k, S) in
            zip(rivals, columns.items(), strict=True)}  # fmt: skip
    gain = now - _log_volume(J, stage.bench.layout.unknowns)
    return Candidate(pose.name, words, float(gain), _leads(rivals, both, J), leads, pose)


def _scanned(stage, pose):
    """A `Bench` of the one pose, with its predicted equilibrium as the measurement."""
    bench = stage.bench
    if bench.in_order is not None:
        return _whitened(stage, _posed_last(stage, pose))
    model = model_at(bench.layout, template(bench.problem.study, pose), stage.base.vector[: bench.layout.shared])
    e = equilibrium(model, boundary_of(pose), turns=int(pose.turns), elements=bench.elements)
    if not bool(e.verdict.solved):
        raise Scan2FlexError(f"not solved: {e.verdict.sentence()}")
    keep = np.linspace(0, bench.elements, min(POINTS, bench.elements + 1)).round().astype(int)[1:-1]
    points = np.asarray(e.points)[np.unique(keep)]
    measured = replace(pose, curve=MeasuredCurve(points, None), markers=None)
    poses = poses_of(bench.problem.study, [measured], bench.problem.length, bench.elements)
    settled = jax.tree.map(lambda x: np.asarray(x)[None], e.configuration)
    return _whitened(stage, replace(poses, start=settled))


def _posed_last(stage, pose):
    """The pose after all poses of the study, as arrays."""
    problem, elements = stage.bench.problem, stage.bench.elements
    last = problem.study.poses[-1]
    later = None if last.time is None else last.time + _pause(problem.study)
    pose = replace(pose, name=f"{pose.name}, next", role="fit", repeat_of=None, reset=False, time=later)
    study = replace(problem.study, poses=(*problem.study.poses, pose))
    poses = poses_of(study, [pose], problem.length, elements)
    e = problem.evaluator_of(poses)(stage.base.vector[: stage.bench.layout.shared])
    if not e.solved:
        raise Scan2FlexError(f"not solved: {SENTENCES[int(e.verdict.code[0])]}")
    keep = np.unique(np.linspace(0, elements, min(POINTS, elements + 1)).round().astype(int)[1:-1])
    measured = replace(pose, curve=MeasuredCurve(e.configuration.r[0][keep], None), markers=None)
    study = replace(study, poses=(*problem.study.poses, measured))
    return replace(poses_of(study, [measured], problem.length, elements), start=e.configuration)


def _pause(study):
    """Mean time (s) between two poses."""
    times = [pose.time for pose in study.poses if pose.time is not None]
    return float(np.ptp(times)) / max(len(times) - 1, 1)


def _whitened(stage, poses):
    """A bench of one candidate, and its residual and derivatives in the metric of the noise."""
    bench = stage.bench
    other = Bench(bench.problem, bench.minimum, poses)
    own = _own(other, stage)
    white = whiten(other.shapes((), own), other.real, Numbers(other, ()), own, Law(stage.noise))
    return other, white


def _together(old: Whitened, new: Whitened, bench):
    """``(J, rows)`` of all parameters, with the rows of the new pose below and its local parameters as further columns."""
    shared = bench.layout.shared
    nuisance = len(bench.layout.prior.at)  # the priors of shared parameters are among the old rows
    rows = [i for i in range(len(new.r)) if not len(new.r) - new.priors <= i < len(new.r) - new.priors + nuisance]
    local = new.J.shape[1] - shared
    J = np.zeros((len(old.r) + len(rows), old.J.shape[1] + local))
    J[: len(old.r), : old.J.shape[1]] = old.J
    J[len(old.r) :, :shared] = new.J[rows, :shared]
    J[len(old.r) :, old.J.shape[1] :] = new.J[rows, shared:]
    return J, rows


def _leads(rivals, columns, J):
    """Per pair the smaller of both expected leads (nats)."""
    Q = orthonormal(J)
    out = {}
    for (a, x), (b, z) in combinations(rivals, 2):
        out[a.kind, b.kind] = min(_lead(columns[a.kind], x, columns[b.kind], Q), _lead(columns[b.kind], z, columns[a.kind], Q))
    return out


def _lead(true, size, other, Q):
    y = true @ size
    y = y - Q @ (Q.T @ y)
    X = orthonormal(other - Q @ (Q.T @ other), 1e-8)
    return float(0.5 * np.sum((y - X @ (X.T @ y)) ** 2))


def _log_volume(J, unknowns):
    """Half the log determinant of the covariance of the unknowns."""
    A = J.T @ J
    scale = np.sqrt(np.diag(A)) + 1e-150
    inverse = np.linalg.pinv(A / np.outer(scale, scale), rcond=1e-12, hermitian=True)
    own = inverse[:unknowns, :unknowns]
    return 0.5 * np.linalg.slogdet(own + 1e-12 * np.eye(unknowns))[1] - np.sum(np.log(scale[:unknowns]))
