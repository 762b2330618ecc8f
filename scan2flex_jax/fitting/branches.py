"""Which of the branches that differ by full turns a measured pose is on.

Two quaternions tell the twist of a cable up to half a turn, and only for a given curve: where a cable winds, or is twisted by
nearly half a turn, the number that `turns` has is a matter of convention. A measured curve then leads to an equilibrium far
from it, and the fit bends the stiffnesses to that. So poses that are left far from what was measured are solved with a turn
more and a turn less too, at the values of the fit; where doubt remains, at a grid of stiffnesses, since those values are then
wrong as well. A fit that then comes far closer gets those turns, and the user is told.
"""

from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from scan2flex_jax.errors import NotSettledError
from scan2flex_jax.fitting.distance import NORMALS
from scan2flex_jax.fitting.least_squares import levenberg_marquardt
from scan2flex_jax.fitting.poses import poses_of
from scan2flex_jax.fitting.start import STIFFNESSES

FAR = 0.003  # of the length: RMS distance from which on a pose may be on another branch
ASTRAY = 0.01  # of the length: one from which on a minimum may have gone where it is for the sake of a wrong branch
_SAME = 1.01  # times the least distance: the same shape
BETTER = 0.5  # of the squared distance of all poses: what other turns have to come down to
_CLEAR = 25.0  # of weighted squares: what they have to gain where their residual is the noise of the curves
_NOISE = 1.2  # times the noise of the curves: a residual that is nothing else
_FINEST = 2.0e-4  # of the length: no doubt of a pose that is nearer, whatever the noise
_BENDING = np.log([0.5, 0.8, 1.25, 2.0])  # factors on the fitted bending stiffness, and GJ/EI, of the grid
_TWISTING = np.log([0.1, 0.2, 0.4, 0.8, 1.6, 3.2])
_TRIED = 4  # of the choices of turns on the grid, the nearest: fitted


def distances(evaluation, mask) -> np.ndarray:
    """RMS distance (m) of each pose; infinite where it was not solved."""
    squares = np.sum(evaluation.residual**2, axis=(1, 2)) / np.sum(np.asarray(mask), axis=1)
    return np.where(np.asarray(evaluation.verdict.code) == 0, np.sqrt(squares), np.inf)


def nearest(problem, study_poses, doubtful, shared, factor: float = 1.0) -> dict[str, int]:
    """Turns, where they are not the study's, that bring doubtful poses nearest to their measured curves at some shared numbers,
    and to less than ``factor`` of the distance with the study's turns."""
    out = {}
    for pose in (p for p, doubt in zip(study_poses, doubtful, strict=True) if doubt and p.end is not None):
        found = {t: _distance(problem, replace(pose, turns=t), shared) for t in (pose.turns, pose.turns - 1, pose.turns + 1)}
        alike = [t for t in found if found[t] <= _SAME * min(found.values())]
        best = min(alike, key=abs)  # two turns may slip over the cable itself and lead to the same shape
        if best != pose.turns and found[best] < factor * found[pose.turns]:
            out[pose.name] = best
    return out


def _distance(problem, pose, shared):
    poses = poses_of([pose], problem.length, problem.elements)
    evaluator = problem.evaluator_of(poses)
    found = evaluator(shared)
    problem.evaluator.equilibria += evaluator.equilibria
    return float(distances(found, poses.mask)[0])


def with_turns(study, turns: dict[str, int]):
    """The study with other turns in some poses."""
    if all(turns.get(p.name, p.turns) == p.turns for p in study.poses):
        return study
    return replace(study, poses=tuple(replace(p, turns=turns.get(p.name, p.turns)) for p in study.poses))


def sentences(before, after) -> tuple[str, ...]:
    """What the user has to know of poses whose turns are others in the study ``after``."""
    changed = [(a.name, a.turns, b.turns) for b, a in zip(before.poses, after.poses, strict=True) if a.turns != b.turns]
    return tuple(
        f"pose {name} was solved with turns = {found} in place of {said}: a full turn nearer to the measured shape"
        for name, found, said in changed
    )


@dataclass
class _Choice:
    """Turns by pose where they are not the study's, and the unknown numbers at which they come nearest."""

    turns: dict[str, int]
    start: np.ndarray
    squares: float


def white_noise(pose) -> float:
    """Standard deviation (m) of the white noise of a coordinate of a measured curve: stated, or from fourth differences.

    Bends between the points raise it, so that a curve of few points casts no doubt.
    """
    if pose.noise is not None:
        return pose.noise
    fourth = np.diff(pose.curve.points, n=4, axis=0)
    return float(np.sqrt(np.mean(fourth**2) / 70.0)) if len(fourth) else np.inf


def settled(problem, minimum, method, progress):
    """The problem and its minimum on the branches of the measured curves, where the residual is more than their noise.

    The noise is the stated one or the white one of the curves; tolerances of the study may explain a residual too.
    """
    sigma = np.array([max(white_noise(p), _FINEST * problem.length) for p in problem.study.fit_poses])
    own = distances(minimum.evaluation, problem.poses.mask) / (np.sqrt(NORMALS) * sigma)
    if not np.any(own > _NOISE):
        return problem, minimum
    count = NORMALS * np.sum(np.asarray(problem.poses.mask))
    reference = _within_tolerances(problem, minimum, sigma)
    if reference.cost <= _NOISE**2 * count:
        return problem, minimum
    found = []
    for choice in _choices(problem, minimum)[:_TRIED]:
        tried = problem.with_study(with_turns(problem.study, choice.turns))
        with suppress(NotSettledError):  # nothing settles with these turns
            m = tried.minimise(method, progress, start=choice.start)
            found.append((_within_tolerances(tried, m, sigma).cost, tried, m))
        problem.evaluator.equilibria = tried.evaluator.equilibria
    cost, tried, m = min(found, key=lambda f: f[0], default=(np.inf, problem, minimum))
    clear = cost <= _NOISE**2 * count and reference.cost - cost > _CLEAR
    return (tried, m) if clear or cost < BETTER * reference.cost else (problem, minimum)


def _within_tolerances(problem, minimum, sigma):
    """The minimum with the nearly known numbers free under their priors, weighed by the noise of the curves."""
    start = minimum.evaluation.configuration
    return levenberg_marquardt(problem.goal(sigma), minimum.shared, minimum.local, start=start)


def _choices(problem, minimum):
    """Choices of turns, each at the point of the grid where the poses come nearest to their curves, nearest first."""
    study, best = problem.study, {}
    near = [poses_of([replace(p, turns=p.turns + k) for p in study.fit_poses], problem.length, problem.elements) for k in _TURNS]
    for x in _grid(problem, minimum.shared):
        found = []
        for poses in near:
            evaluator = problem.evaluator_of(poses)
            found.append(distances(evaluator(x, derivative=False), poses.mask))
            problem.evaluator.equilibria += evaluator.equilibria
        which = np.argmin(found, axis=0)
        squares = float(np.sum(np.min(found, axis=0) ** 2))
        turns = {p.name: p.turns + _TURNS[k] for p, k in zip(study.fit_poses, which, strict=True) if _TURNS[k]}
        key = tuple(which)
        if np.isfinite(squares) and (key not in best or squares < best[key].squares):
            best[key] = _Choice(turns, x[: problem.layout.unknowns], squares)
    return sorted(best.values(), key=lambda c: c.squares)


_TURNS = (0, -1, 1)


def _grid(problem, shared):
    """Vectors of shared numbers with the unknown stiffnesses spread about those of the fit."""
    slots = {s.name: s for s in problem.layout.slots}
    bending, torsion = (slots.get(name) for name in STIFFNESSES)
    for b, t in product(_BENDING if bending else [0.0], _TWISTING if torsion else [0.0]):
        x = shared.copy()
        if bending:
            x[bending.at : bending.at + bending.size] += b
        if torsion:
            EI = np.mean(x[bending.at : bending.at + bending.size]) if bending else np.log(np.mean(problem.study.known(STIFFNESSES[0])))
            x[torsion.at] = EI + t
        yield x
