"""Other stable shapes that explain the readings of a fit as well.

One to three readings do not tell a shape: a loop that hangs in its plane and one that has buckled out of it reach the same
depth at different stiffnesses. Poses of so few readings are solved from the generic start bowed along and across gravity, once
and to and fro; what settles elsewhere is fitted from there.
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import jax
import numpy as np

from scan2flex_jax.errors import NotSettledError
from scan2flex_jax.fitting.least_squares import Minimum, Progress, prefixed
from scan2flex_jax.fitting.parameters import values_of
from scan2flex_jax.fitting.poses import bowed
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.posterior.branches import APART
from scan2flex_jax.posterior.estimate import Estimate, unit_of
from scan2flex_jax.results.answer import number
from scan2flex_jax.rod.model import Configuration

FEW = 3  # readings of a fit
_WIDE, _HIGH = 0.2, 1.0  # of the length: height of a bow across gravity, and against it
_ELSEWHERE = 1e-3  # of the length: readings of another shape differ by more
_ALIKE = 4.0  # in chi-squared: two standard deviations


def others(problem: Problem, minimum: Minimum, progress: Progress) -> list[np.ndarray]:
    """Unknowns ``x`` (k,) of other stable shapes that fit the readings as well as a minimum, and differ from its own."""
    study, layout, found = problem.study, problem.layout, list[np.ndarray]()
    if study.history_dependent or any(pose.curve is not None for pose in study.fit_poses) or _readings(study) > FEW:
        return []
    known = [minimum.shared[: layout.unknowns]]
    for start in _elsewhere(problem, minimum):
        tried = problem.with_study(study)
        tried.poses = replace(tried.poses, start=start)
        tried.evaluator = tried.evaluator_of(tried.poses, problem.evaluator.distance)
        with suppress(NotSettledError):
            end = tried.minimise("least-squares", prefixed(progress, "another shape"), start=known[0])
            x = end.shared[: layout.unknowns]
            if end.cost <= minimum.cost + _ALIKE and all(np.max(np.abs(x - own)) > APART for own in known):
                known.append(x)
                found.append(x)
    return found


def in_words(problem: Problem, minimum: Minimum, found: list[np.ndarray]) -> tuple[str, tuple[str, ...]]:
    """A sentence on the values of all shapes, and the names of the unknowns that differ; empty without other shapes."""
    if not found:
        return "", ()
    n = _readings(problem.study)
    each = [values_of(problem.layout, x) for x in (minimum.shared[: problem.layout.unknowns], *found)]
    names = tuple(k for k in each[0] if any(not np.allclose(v[k], each[0][k], rtol=APART) for v in each[1:]))
    said = [f"{k} = {' or '.join(_number(v[k]) for v in each)} {unit_of(k)}" for k in names]
    fits = f"{n} reading{'s' * (n > 1)} fit{'s' * (n == 1)} {len(each)} stable shapes: {', '.join(said)}"
    return f"{fits}; measure the curve of a pose, or more markers on it", names


def without(estimates: dict[str, Estimate], names: tuple[str, ...]) -> dict[str, Estimate]:
    """The estimates with these not determined."""
    return {name: e.lost() if name in names else e for name, e in estimates.items()}


def _number(value) -> str:
    return " ".join(number(float(v), 3) for v in np.ravel(value))


def _readings(study) -> int:
    """Number of values measured in the fitted poses."""
    marks = sum(len(p.markers.points) * len(p.markers.measured) for p in study.fit_poses if p.markers is not None)
    parts = [x for p in study.fit_poses for wrench in p.wrench for _, x, _ in wrench.each if x is not None]
    return marks + sum(len(p.angle) for p in study.fit_poses) + int(sum(np.count_nonzero(~np.isnan(x)) for x in parts))


def _elsewhere(problem: Problem, minimum: Minimum) -> Iterator[Configuration]:
    """Starts from which poses settle where their readings are others than at the minimum, one of each kind."""
    study, p, seen = problem.study, problem.poses, [minimum.evaluation.residual]
    for bow in _bows(study, problem.length, problem.elements):
        starts = [bowed(study, pose, bow, problem.length, problem.elements) for pose in study.fit_poses]
        start = jax.tree.map(lambda *x: np.stack([np.asarray(a) for a in x]), *starts)
        tried = problem.evaluator_of(replace(p, start=start))
        e = tried(minimum.shared, minimum.local)  # by the functions that the fit has compiled
        problem.evaluator.equilibria += tried.equilibria
        far = [np.max(np.abs(e.residual - known)) > _ELSEWHERE * problem.length for known in seen]
        if e.solved and all(far):
            seen.append(e.residual)
            yield start


def _bows(study, length: float, elements: int) -> Iterator[np.ndarray]:
    """Displacements (elements + 1, 3) of a start, m: against gravity, and across it to either side, once and to and fro."""
    weight = np.asarray(study.gravity, float)
    up = -weight / np.linalg.norm(weight) if np.any(weight) else np.array([0.0, 0.0, 1.0])
    aside = np.linalg.svd(up[None])[2][1:]
    t = np.linspace(0.0, 1.0, elements + 1)[:, None]
    once = 16 * t**2 * (1 - t) ** 2
    to_and_fro = once * (1 - 2 * t) / np.max(np.abs(once * (1 - 2 * t)))
    yield _HIGH * length * once * up
    for form in (once, to_and_fro):
        for direction in (*aside, *-aside):
            yield _WIDE * length * form * direction
