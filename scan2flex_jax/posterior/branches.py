"""Search for the branch of each measured pose among equilibria that differ by full turns of twist.

Two quaternions determine the twist of a cable up to full turns, and only for a given curve: where a cable winds, or is twisted
by nearly half a turn, the value of `turns` is a matter of convention. With a wrong value the solve leads to an equilibrium far
from the measured curve, and the fit distorts the stiffnesses. Other turns are proposed from the fit, each way where those
before it found nothing likelier:

1. poses far from their curves are solved with one turn more and one less at the values of the fit, and, where it is far off,
   at the starts;
2. the turns of the study again, in poses that come as near with them: a cable that passes over itself loses two turns;
3. if a residual exceeds the noise, all poses are solved on a grid of stiffnesses, since those of the fit are then wrong as
   well; at each grid point every pose takes its nearest turns.

All are fitted, and the likeliest is adopted and reported: each pose may deviate from the model by itself, turns with another
torsional stiffness follow such deviations, and few poses are a turn off. If poses remain far from their curves even so, the
model lacks physics for which other turns compensate, and the turns of the study are kept.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from scan2flex_jax.errors import NotSettledError
from scan2flex_jax.fitting.distance import NORMALS
from scan2flex_jax.fitting.least_squares import Minimum, prefixed
from scan2flex_jax.fitting.noise import white_noise
from scan2flex_jax.fitting.poses import poses_of
from scan2flex_jax.fitting.start import STIFFNESSES
from scan2flex_jax.posterior.posterior import Variant
from scan2flex_jax.posterior.settings import USUAL, Settings
from scan2flex_jax.study.model import Study

FAR = 0.003  # of the length: RMS distance above which a pose may be on another branch
ASTRAY = 0.01  # of the length: RMS distance above which a wrong branch may have displaced the minimum
_EXACT = 1.0e-6  # of the length: distances below it are zero
_SAME = 1.01  # times the least distance: the same shape
_NEARER = 0.5  # factor on the distance of a validate pose that other turns must reach
_NOISE = 1.2  # times the noise of the curves: largest residual that may be noise
_FINEST = 2.0e-4  # of the length: a pose nearer than this is on its branch, whatever the noise
_TURNS = (0, -1, 1)  # added to those of the study
_BENDING = np.log([0.6, 1.0, 1.7])  # of the grid: bending stiffness over that of the fit,
_RATIO = np.log([0.12, 0.25, 0.5, 1.0, 2.0])  # and torsional over bending stiffness
_TRIED = 4  # largest number of choices of turns, the nearest ones, that a search fits
_IN_DOUBT = 3.0  # times the least sum of squares: beyond, a fit is not the likeliest
APART = 0.02  # an unknown, or its logarithm, of another answer differs by more


def distances(evaluation, poses) -> np.ndarray:
    """RMS distance (m) of the points of each pose, 0 without any; infinite if it was not solved."""
    seen = poses.seen
    squares = np.sum(np.sum(evaluation.residual**2, axis=2) * seen, axis=1) / np.maximum(np.sum(seen, axis=1), 1)
    return np.where(np.asarray(evaluation.verdict.code) == 0, np.sqrt(squares), np.inf)


def nearest(problem, study_poses, doubtful, shared, factor: float = 1.0, within: float = np.inf) -> dict[str, int]:
    """Turns, where they differ from the study's, that bring doubtful poses nearest to their measured curves at given shared
    numbers: below ``factor`` times the distance with the study's turns, and below ``within`` (m)."""
    out = {}
    for pose in (p for p, doubt in zip(study_poses, doubtful, strict=True) if doubt and p.end is not None):
        found = {t: _distance(problem, replace(pose, turns=t), shared) for t in (pose.turns, pose.turns - 1, pose.turns + 1)}
        closest = [t for t in found if found[t] <= _SAME * min(found.values())]
        best = min(closest, key=abs)  # two turns may pass over the cable and lead to the same shape
        if best != pose.turns and found[best] < min(factor * found[pose.turns], within):
            out[pose.name] = best
    return out


def _distance(problem, pose, shared):
    poses = poses_of(problem.study, [pose], problem.length, problem.elements)
    evaluator = problem.evaluator_of(poses)
    found = evaluator(shared)
    problem.evaluator.equilibria += evaluator.equilibria
    return float(distances(found, poses)[0])


def with_turns(study, turns: dict[str, int]):
    """The study with other turns in some poses."""
    if all(turns.get(p.name, p.turns) == p.turns for p in study.poses):
        return study
    return replace(study, poses=tuple(replace(p, turns=turns.get(p.name, p.turns)) for p in study.poses))


def turns_of(study) -> tuple[int, ...]:
    """The turns of the fitted poses."""
    return tuple(p.turns for p in study.fit_poses)


def sentences(before, after) -> tuple[str, ...]:
    """Sentences on poses whose turns differ in the study ``after``."""
    changed = [(a.name, a.turns, b.turns) for b, a in zip(before.poses, after.poses, strict=True) if a.turns != b.turns]
    return tuple(
        f"pose {name} was solved with turns = {found} in place of {said}: a full turn nearer to the measured shape"
        for name, found, said in changed
    )


class _Choice(NamedTuple):
    """Turns of all poses by name, the unknowns at which they were chosen, and a measure of distance there."""

    turns: dict[str, int]
    start: np.ndarray | None = None
    off: float = 0.0


@dataclass(eq=False)
class Branch:
    """A problem and its minimum, beside the study as ``declared``."""

    problem: Any
    minimum: Minimum
    declared: Study
    settings: Settings = USUAL

    @property
    def off(self) -> np.ndarray:
        """RMS distance (m) of each pose."""
        return distances(self.minimum.evaluation, self.problem.poses)

    @property
    def turns(self) -> tuple[int, ...]:
        """Those of its fitted poses."""
        return turns_of(self.problem.study)

    @property
    def unknowns(self) -> np.ndarray:
        """Their values in ``x``."""
        return self.minimum.shared[: self.problem.layout.unknowns]

    @cached_property
    def log_posterior(self) -> float:
        """Log likelihood (nats), given how rarely a pose is a turn off from what is declared."""
        changes = sum(abs(p.turns - n) for p, n in zip(self.declared.fit_poses, self.turns, strict=True))
        h = Variant("turns", self.problem, self.minimum, self.settings, held=True).empty
        return h.variant.likelihood.likeliest(h.linear, [h.u])[1] - self.settings.turn * changes


def on_its_branches(
    problem, minimum, method, progress, searches: Sequence | None = None, declared: Study | None = None,
    settings: Settings = USUAL,
):  # fmt: skip
    """The problem and its minimum with every fitted pose on the measured branch, and a sentence on turns that are about as
    likely, or none; ``searches``: the ways to propose turns, by default all; ``declared``: the study whose turns are those
    stated, by default that of the problem."""
    first = best = Branch(problem, minimum, declared or problem.study, settings)
    squares = problem.evaluator.distance != "hausdorff"
    fits, searches, k = [first], SEARCHES[: None if squares else 2] if searches is None else searches, 0
    while k < len(searches):
        known, choices = {f.turns for f in fits}, dict[tuple[int, ...], _Choice]()
        for choice in searches[k](best):
            choices.setdefault(turns_of(with_turns(best.problem.study, choice.turns)), choice)
        new = [choice for turns, choice in choices.items() if turns not in known]
        fits += _branches(best, new, "least-squares" if squares else method, progress)
        near = _near(fits)
        likeliest = max(near, key=lambda f: f.log_posterior) if len(near) > 1 else near[0]
        best, k = likeliest, k + 1 if likeliest is best else 0
    if best is first:
        return problem, minimum, doubt(best, fits)
    best.problem.evaluator.equilibria = problem.evaluator.equilibria
    if squares and method != "least-squares":
        best.minimum = best.problem.minimise(method, progress, start=best.unknowns)
    return best.problem, best.minimum, doubt(best, fits)


def _near(fits: Sequence[Branch]) -> list[Branch]:
    """Those whose distances leave a doubt which is the likeliest."""
    squares = [float(np.sum(f.off**2)) for f in fits]
    least = max(min(squares), len(fits[0].off) * (_EXACT * fits[0].problem.length) ** 2)
    return [f for f, own in zip(fits, squares, strict=True) if own <= _IN_DOUBT * least]


def _branches(best: Branch, choices, method, progress) -> Iterator[Branch]:
    """The fit of each choice that settles; their equilibria are counted."""
    progress, problem = prefixed(progress, "other turns"), best.problem
    for choice in choices:
        tried = problem.with_study(with_turns(problem.study, choice.turns))
        with suppress(NotSettledError):
            found = tried.minimise(method, progress, best.minimum.cost, choice.start)
            yield Branch(tried, found, best.declared, best.settings)
        problem.evaluator.equilibria = tried.evaluator.equilibria


def doubt(best: Branch, fits) -> str:
    """A sentence on other values with turns that are about as likely; empty without such."""
    near = [f for f in _near(fits) if f is not best and np.max(np.abs(f.unknowns - best.unknowns)) > APART]
    other = max(near, key=lambda f: f.log_posterior, default=None)
    if other is None or other.log_posterior < best.log_posterior - best.settings.named:
        return ""
    poses, torsion = other.problem.study.fit_poses, _slot(other.problem, STIFFNESSES[1])
    changed = [f"turns = {p.turns} in pose {p.name}" for p, n in zip(poses, best.turns, strict=True) if p.turns != n]
    changed += [] if torsion is None else [f"{STIFFNESSES[1]} = {np.exp(other.minimum.shared[torsion]).item():.3g} N m^2"]
    return f"the shapes are about as likely with {' and '.join(changed)}: count the turns of twist before believing the values"


def believed(problem, minimum, declared):
    """The problem and its minimum where the turned poses came near their curves, else those ``declared`` before; with the turns
    of validate poses, under the same condition."""
    before, own = declared[0], distances(minimum.evaluation, problem.poses)
    turned = [a.turns != b.turns for a, b in zip(before.study.fit_poses, problem.study.fit_poses, strict=True)]
    if np.any(own[turned] > ASTRAY * problem.length):
        before.evaluator.equilibria = problem.evaluator.equilibria
        problem, minimum = declared
    if unseen := problem.study.validate_poses:
        far = distances(problem.predicted(minimum), problem.held_out) > FAR * problem.length
        seen = nearest(problem, unseen, far, minimum.shared, _NEARER, ASTRAY * problem.length)
        problem.hold_out(with_turns(problem.study, seen))
    return problem, minimum


def _nearer(f: Branch) -> list[_Choice]:
    """Turns that bring poses far from their curves nearer, all of them and each by itself."""
    own, out, unknowns = f.off / f.problem.length, list[_Choice](), f.problem.layout.unknowns
    vectors = [f.minimum.shared]
    if np.any(own > ASTRAY):
        vectors += [np.r_[x, f.minimum.shared[unknowns:]] for x in f.problem.starts()]
    for x in vectors:
        turns = nearest(f.problem, f.problem.study.fit_poses, own > FAR, x)
        out += [_Choice(t) for t in (turns, *({name: n} for name, n in turns.items())) if t]
    return out


def _returned(f: Branch) -> list[_Choice]:
    """The turns of the study in every pose that comes as near with them."""
    back: dict[str, int] = {}
    for old, new in zip(f.declared.fit_poses, f.problem.study.fit_poses, strict=True):
        if old.turns != new.turns:
            before, after = (_distance(f.problem, pose, f.minimum.shared) for pose in (old, new))
            back |= {new.name: old.turns} if before <= max(_SAME * after, _EXACT * f.problem.length) else {}
    return [_Choice(back, f.unknowns)] if back else []


def _on_a_grid(f: Branch) -> list[_Choice]:
    """The nearest choices over a grid of stiffnesses, each at its best point; none where the residual may be noise."""
    problem, study = f.problem, f.problem.study
    if np.all(f.off <= _NOISE * np.sqrt(NORMALS) * noises(problem)):
        return []
    best: dict[tuple[int, ...], _Choice] = {}
    turned = [[replace(p, turns=p.turns + k) for p in study.fit_poses] for k in _TURNS]
    near = [poses_of(study, some, problem.length, problem.elements) for some in turned]
    for x in _grid(problem, f.minimum.shared):
        found = []
        for poses in near:
            evaluator = problem.evaluator_of(poses)
            found.append(distances(evaluator(x), poses))
            problem.evaluator.equilibria += evaluator.equilibria
        least = np.min(found, axis=0)
        which, off = np.argmax(found <= _SAME * least, axis=0), float(np.sum(least**2))  # the study's turns if equal
        turns = {p.name: p.turns + _TURNS[k] for p, k in zip(study.fit_poses, which, strict=True)}
        key = tuple(turns.values())
        if np.isfinite(off) and (key not in best or off < best[key].off):
            best[key] = _Choice(turns, x[: problem.layout.unknowns], off)
    return sorted(best.values(), key=lambda choice: choice.off)[:_TRIED]


def noises(problem) -> np.ndarray:
    """Noise (m) of each curve by its own points, within reason."""
    return np.clip([white_noise(p) for p in problem.study.fit_poses], _FINEST * problem.length, ASTRAY * problem.length)


def _grid(problem, shared) -> Iterator[np.ndarray]:
    """Vectors of shared numbers with the unknown stiffnesses spread about those of the fit."""
    bending, torsion = (_slot(problem, name) for name in STIFFNESSES)
    for b, t in product(_BENDING if bending else [0.0], _RATIO if torsion else [0.0]):
        x = shared.copy()
        if bending:
            x[bending] += b
        if torsion:
            x[torsion] = t + np.mean(x[bending] if bending else np.log(problem.study.known(STIFFNESSES[0])))
        yield x


def _slot(problem, name) -> slice | None:
    """The place of an unknown among the shared numbers."""
    return next((slice(s.at, s.at + s.size) for s in problem.layout.slots if s.name == name), None)


SEARCHES = (_nearer, _returned, _on_a_grid)
NEARER = SEARCHES[:1]
"""The search that takes a few solves only."""
