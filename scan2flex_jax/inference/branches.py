"""Search for the branch of each measured pose among equilibria that differ by full turns of twist.

Two quaternions determine the twist of a cable up to full turns, and only for a given curve: where a cable winds, or is twisted
by nearly half a turn, the value of `turns` is a matter of convention. With a wrong value the solve leads to an equilibrium far
from the measured curve, and the fit distorts the stiffnesses. Three searches find the measured branch, the last two after the
first has ended:

1. poses far from their curves are solved with one turn more and one less at the values of the fit; each choice is fitted;
2. if a residual exceeds the noise, all poses are solved on a grid of stiffnesses, since those of the fit are then wrong as
   well; at each grid point every pose takes its nearest turns, and the nearest choices are fitted;
3. a curve determines the torque ``GJ phi / L``, not the twist ``phi``: turns ``k`` and a stiffness ``GJ'`` that keep the
   torques of all poses nearly the same, ``GJ' (phi + 2 pi k) = GJ phi``, are a choice to fit, however small the residual.

The turns of a fit that is far closer, or closer by more than the noise explains, are adopted and reported, if they are likelier
although few poses are a turn off: each pose may deviate from the model by itself, and turns with another torsional stiffness
follow such deviations. If poses remain far from their curves even so, the model lacks physics for which other turns compensate,
and the turns of the study are kept.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np

from scan2flex_jax.errors import NotSettledError
from scan2flex_jax.fitting.distance import NORMALS
from scan2flex_jax.fitting.least_squares import levenberg_marquardt, prefixed
from scan2flex_jax.fitting.noise import white_noise
from scan2flex_jax.fitting.poses import poses_of
from scan2flex_jax.fitting.start import STIFFNESSES, total_twist
from scan2flex_jax.inference.posterior import Variant

FAR = 0.003  # of the length: RMS distance above which a pose may be on another branch
ASTRAY = 0.01  # of the length: RMS distance above which a wrong branch may have displaced the minimum
_EXACT = 1.0e-6  # of the length: distances below it are zero
_SAME = 1.01  # times the least distance: the same shape
BETTER = 0.5  # factor on the squared distance of all poses that other turns must reach
_CLEAR = 25.0  # decrease of the squares in units of the noise that is required where the residual is noise; a chance of 1e-6
_EQUAL = 1.0  # difference of these squares that counts as equal: two turns may pass over the cable and lead to the same shapes
_NOISE = 1.2  # times the noise of the curves: largest residual that may be noise
_FINEST = 2.0e-4  # of the length: a pose nearer than this is on its branch, whatever the noise
_TURNS = (0, -1, 1)  # added to those of the study
_BENDING = np.log([0.6, 1.0, 1.7])  # of the grid: bending stiffness over that of the fit,
_RATIO = np.log([0.12, 0.25, 0.5, 1.0, 2.0])  # and torsional over bending stiffness
_TRIED = 4  # largest number of choices of turns, the nearest ones, that a search fits
_ALIKE = 0.4  # largest relative change of the torques by a choice of turns (third search)
_TINY = 1.0e-9  # rad
_TURNED = np.log(40.0)  # nats: prior odds against one turn more in a pose, and against one less: 5 % of poses are a turn off
_CLOSE = 5.0  # nats behind those kept: turns that are named beside them
_TORSION = np.exp(np.linspace(-3.0, 3.0, 201))  # torsional stiffness over that of the fit (third search)


def distances(evaluation, mask) -> np.ndarray:
    """RMS distance (m) of each pose; infinite if it was not solved."""
    squares = np.sum(evaluation.residual**2, axis=(1, 2)) / np.sum(np.asarray(mask), axis=1)
    return np.where(np.asarray(evaluation.verdict.code) == 0, np.sqrt(squares), np.inf)


def nearest(problem, study_poses, doubtful, shared, factor: float = 1.0, within: float = np.inf) -> dict[str, int]:
    """Turns, where they differ from the study's, that bring doubtful poses nearest to their measured curves at given shared
    numbers: below ``factor`` times the distance with the study's turns, and below ``within`` (m)."""
    out = {}
    for pose in (p for p, doubt in zip(study_poses, doubtful, strict=True) if doubt and p.end is not None):
        found = {t: _distance(problem, replace(pose, turns=t), shared) for t in (pose.turns, pose.turns - 1, pose.turns + 1)}
        alike = [t for t in found if found[t] <= _SAME * min(found.values())]
        best = min(alike, key=abs)  # two turns may pass over the cable and lead to the same shape
        if best != pose.turns and found[best] < min(factor * found[pose.turns], within):
            out[pose.name] = best
    return out


def _distance(problem, pose, shared):
    poses = poses_of(problem.study, [pose], problem.length, problem.elements)
    evaluator = problem.evaluator_of(poses)
    found = evaluator(shared, derivative=False)
    problem.evaluator.equilibria += evaluator.equilibria
    return float(distances(found, poses.mask)[0])


def with_turns(study, turns: dict[str, int]):
    """The study with other turns in some poses."""
    if all(turns.get(p.name, p.turns) == p.turns for p in study.poses):
        return study
    return replace(study, poses=tuple(replace(p, turns=turns.get(p.name, p.turns)) for p in study.poses))


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
    start: np.ndarray | None
    off: float


def on_its_branches(problem, minimum, method, progress):
    """The problem and its minimum with every fitted pose on the measured branch, and a sentence on turns that are about as
    likely, or none."""
    declared = problem.study
    while True:
        problem, minimum = full_turns(problem, minimum, method, progress, declared)
        before = problem
        problem, minimum, doubt = _beyond_doubt(problem, minimum, method, progress, declared)
        if problem is before:
            return problem, minimum, doubt


def needed(declared, problem, minimum, method, progress):
    """The problem and its minimum with the turns of the study ``declared`` in every pose that fits as well with them: a cable
    that passes over itself loses two turns, and other turns of an early minimum may not be needed at the last one."""
    back: dict[str, int] = {}
    exact = _EXACT * problem.length
    for old, new in zip(declared.fit_poses, problem.study.fit_poses, strict=True):
        if old.turns != new.turns:
            before, after = (_distance(problem, pose, minimum.shared) for pose in (old, new))
            back |= {new.name: old.turns} if before <= max(_SAME * after, exact) else {}
    choices = [_Choice(back, minimum.shared[: problem.layout.unknowns], 0.0)] if back else []
    for tried, m in _fitted(problem, choices, method, progress):
        off, own = (distances(one.evaluation, problem.poses.mask) for one in (m, minimum))
        if np.all(off <= np.maximum(_SAME * own, exact)):
            return tried, m
    return problem, minimum


def believed(problem, minimum, declared):
    """The problem and its minimum where the turned poses came near their curves, else those ``declared`` before; with the turns
    of validate poses, under the same condition."""
    before, own = declared[0], distances(minimum.evaluation, problem.poses.mask)
    turned = [a.turns != b.turns for a, b in zip(before.study.fit_poses, problem.study.fit_poses, strict=True)]
    if np.any(own[turned] > ASTRAY * problem.length):
        before.evaluator.equilibria = problem.evaluator.equilibria
        problem, minimum = declared
    if unseen := problem.study.validate_poses:
        far = distances(problem.predicted(minimum), problem.held_out.mask) > FAR * problem.length
        seen = nearest(problem, unseen, far, minimum.shared, BETTER, ASTRAY * problem.length)
        problem.hold_out(with_turns(problem.study, seen))
    return problem, minimum


def full_turns(problem, minimum, method, progress, declared=None):
    """The first search, at the values of the fit, repeated from each better fit; ``declared``: the study whose turns are those
    stated, by default that of the problem."""
    declared = declared or problem.study
    while True:
        own = distances(minimum.evaluation, problem.poses.mask) / problem.length
        vectors = [minimum.shared]
        if np.any(own > ASTRAY):
            vectors += [np.r_[x, minimum.shared[len(x) :]] for x in problem.starts()]
        turns = []
        for x in vectors:  # all poses that are nearer with other turns, and each of these separately
            nearer = nearest(problem, problem.study.fit_poses, own > FAR, x)
            turns += [nearer, *({name: n} for name, n in nearer.items())]
        choices = [_Choice(t, None, 0.0) for i, t in enumerate(turns) if t and t not in turns[:i]]
        fitted = _fitted(problem, choices, method, progress, BETTER * minimum.cost)
        found = [(tried, m) for tried, m in fitted if m.cost <= BETTER * minimum.cost]
        tried, best = _likeliest(declared, [(problem, minimum), *found])
        if tried is problem:
            return problem, minimum
        tried.evaluator.equilibria = problem.evaluator.equilibria
        problem, minimum = tried, best


def _fitted(problem, choices, method, progress, beat=np.inf):
    """Problem and minimum of each choice that settles; their equilibria are counted."""
    progress = prefixed(progress, "other turns")
    for choice in choices:
        tried = problem.with_study(with_turns(problem.study, choice.turns))
        with suppress(NotSettledError):
            yield tried, tried.minimise(method, progress, beat, choice.start)
        problem.evaluator.equilibria = tried.evaluator.equilibria


def _likeliest(declared, found):
    """The likeliest of some problems with their minima; the nearest to the curves where the distance is not that of the
    likelihood."""
    if len(found) == 1 or found[0][0].evaluator.distance != "normal":
        return min(found, key=lambda pair: pair[1].cost)
    return max(found, key=lambda pair: _log_posterior(declared, *pair))


def _log_posterior(declared, problem, minimum) -> float:
    """Log likelihood (nats) of a minimum, given how rarely a pose is a turn off from what is ``declared``."""
    h = Variant("turns", problem, minimum, held=True).empty
    return h.variant.likelihood.likeliest(h.linear, [h.u])[1] - _TURNED * _changes(declared, problem.study)


def _beyond_doubt(problem, minimum, method, progress, declared):
    """The searches on the grid and by torques; minima are compared with the nuisance parameters free under their priors.

    Returns the problem, its minimum, and a sentence on turns that are about as likely.
    """
    kept = problem, minimum, ""
    if problem.evaluator.distance == "hausdorff":  # not a sum of squares
        return kept
    finest, coarsest = _FINEST * problem.length, ASTRAY * problem.length
    sigma = np.clip([white_noise(p) for p in problem.study.fit_poses], finest, coarsest)
    noise = _NOISE**2 * NORMALS * np.sum(np.asarray(problem.poses.mask))
    choices = _by_torques(problem, minimum)
    doubt = np.any(distances(minimum.evaluation, problem.poses.mask) > _NOISE * np.sqrt(NORMALS) * sigma)
    if not (doubt or choices):
        return kept
    cost = _cost_within_tolerances(problem, minimum, sigma)
    choices += _on_a_grid(problem, minimum.shared) if doubt and cost > noise else []
    found = [(cost, problem, minimum)]
    for tried, m in _fitted(problem, choices, "least-squares", progress, minimum.cost):
        found.append((_cost_within_tolerances(tried, m, sigma), tried, m))
    least = min(f[0] for f in found)
    alike = [f for f in found if f[0] <= least + _EQUAL]
    least, tried, m = min(alike, key=lambda f: _changes(problem.study, f[1].study))
    if least >= BETTER * cost and (least > noise or cost - least <= _CLEAR):
        return kept
    if least > noise and problem.evaluator.distance == "normal":
        lead = _log_posterior(declared, problem, minimum) - _log_posterior(declared, tried, m)
        if lead >= 0.0:
            return problem, minimum, _in_doubt(problem, tried, m) if lead < _CLOSE else ""
    tried.evaluator.equilibria = problem.evaluator.equilibria
    if method != "least-squares":
        m = tried.minimise(method, progress, start=m.shared[: problem.layout.unknowns])
    return tried, m, ""


def _in_doubt(problem, tried, minimum) -> str:
    """A sentence on turns that are about as likely."""
    pairs = zip(problem.study.fit_poses, tried.study.fit_poses, strict=True)
    changed = [f"turns = {b.turns} in pose {b.name}" for a, b in pairs if a.turns != b.turns]
    torsion = _slot(tried, STIFFNESSES[1])
    changed += [] if torsion is None else [f"{STIFFNESSES[1]} = {np.exp(minimum.shared[torsion]).item():.3g} N m^2"]
    return f"the shapes are about as likely with {' and '.join(changed)}: count the turns of twist before believing the values"


def _changes(before, after) -> int:
    """Sum over poses of the difference in turns between two studies."""
    return sum(abs(b.turns - a.turns) for b, a in zip(before.poses, after.poses, strict=True))


def _cost_within_tolerances(problem, minimum, sigma):
    """Sum of squares in units of the curves' noise, at the minimum with the nuisance parameters free under their priors."""
    start = minimum.evaluation.configuration
    return levenberg_marquardt(problem.goal(sigma), minimum.shared, minimum.local, start=start).cost


def _on_a_grid(problem, shared) -> list[_Choice]:
    """The nearest choices over a grid of stiffnesses, each at its best point."""
    study = problem.study
    best: dict[tuple[int, ...], _Choice] = {}
    turned = [[replace(p, turns=p.turns + k) for p in study.fit_poses] for k in _TURNS]
    near = [poses_of(study, some, problem.length, problem.elements) for some in turned]
    for x in _grid(problem, shared):
        found = []
        for poses in near:
            evaluator = problem.evaluator_of(poses)
            found.append(distances(evaluator(x, derivative=False), poses.mask))
            problem.evaluator.equilibria += evaluator.equilibria
        least = np.min(found, axis=0)
        which, off = np.argmax(found <= _SAME * least, axis=0), float(np.sum(least**2))  # the study's turns if equal
        turns = {p.name: p.turns + _TURNS[k] for p, k in zip(study.fit_poses, which, strict=True)}
        key = tuple(turns.values())
        if np.isfinite(off) and (key not in best or off < best[key].off):
            best[key] = _Choice(turns, x[: problem.layout.unknowns], off)
    return sorted(best.values(), key=lambda choice: choice.off)[:_TRIED]


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


def _by_torques(problem, minimum) -> list[_Choice]:
    """The choices that nearly keep the torques of the minimum; none for a single pose, which could take any turns."""
    poses, torsion = problem.study.fit_poses, _slot(problem, STIFFNESSES[1])
    if torsion is None or len(poses) < 2:
        return []
    found: dict[tuple[int, ...], _Choice] = {}
    phi = np.array([total_twist(R) for R in minimum.evaluation.configuration.R])
    held = [p.end is not None and p.end.quaternion is not None and p.start.quaternion is not None for p in poses]
    for stiffer in _TORSION:
        k = np.where(held, np.clip(np.round((phi / stiffer - phi) / (2 * np.pi)), -1, 1), 0)
        twist = phi + 2 * np.pi * k
        factor = phi @ twist / (twist @ twist + _TINY)
        off = float(np.linalg.norm(phi - factor * twist) / (np.linalg.norm(phi) + _TINY))
        if np.any(k) and factor > 0 and off < _ALIKE:
            start = minimum.shared[: problem.layout.unknowns].copy()
            start[torsion] += np.log(factor)
            found[tuple(map(int, k))] = _Choice({p.name: p.turns + int(n) for p, n in zip(poses, k, strict=True)}, start, off)
    return sorted(found.values(), key=lambda choice: choice.off)[:_TRIED]
