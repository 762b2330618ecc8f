"""Influence of each pose and of the stated length and mass on the estimates, to first order at a minimum.

With the whitened residual ``r``, its Jacobian ``J`` and the precision ``A = J'J + priors`` of all parameters, leaving out pose
``i`` moves the parameters by

    (A - J_i' J_i)^-1 J_i' r_i,

and a change ``dr`` of the residual, caused by another length or mass, by ``-A^-1 J' dr``. Nothing is refitted; tests compare
both with refits. Reference: Cook and Weisberg, "Residuals and influence in regression" (1982), chapter 2.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from scan2flex_jax.fitting.estimate import vague
from scan2flex_jax.fitting.evaluate import Evaluation
from scan2flex_jax.fitting.least_squares import Minimum
from scan2flex_jax.fitting.poses import Poses, poses_of
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.fitting.statistics import closed_inverse
from scan2flex_jax.study.model import MeasuredCurve, Study

STATED = ("length", "length_density")
"""Properties of the cable that a user measures, and on which every stiffness depends."""
_STEP = 1e-4  # relative change of a stated value: it moves shapes by a thousand times the residual of the solver


@dataclass(frozen=True)
class Influence:
    """Changes of the unknowns in ``x``: of logarithms for positive quantities (``logs``), else in their own unit.

    ``moved`` (poses, numbers): change when a pose is left out; NaN if the other poses do not determine the number.
    ``left_out`` (poses,): RMS distance (m) of a pose from its prediction by the others; NaN likewise. ``stated``: change per
    relative change of a stated value of the cable, by its name.
    """

    labels: tuple[str, ...]
    logs: np.ndarray
    poses: tuple[str, ...]
    moved: np.ndarray = field(repr=False)
    left_out: np.ndarray = field(repr=False)
    stated: dict[str, np.ndarray] = field(repr=False, default_factory=dict)

    def of_pose(self, pose: str) -> dict[str, float]:
        """Relative change of each positive number, and change of any other in its unit, without this pose; NaN if it is then
        not determined. Empty for a pose that was not fitted."""
        if pose not in self.poses:
            return {}
        row = self.moved[self.poses.index(pose)]
        with np.errstate(over="ignore"):
            values = np.where(self.logs, np.expm1(row), row)
        return dict(zip(self.labels, values.tolist(), strict=True))

    def rms(self, points: Sequence[int]) -> float:
        """RMS distance (m) over all poses, each predicted from the others; NaN if one of them is not predicted.

        ``points``: number of points of each pose.
        """
        weight = np.asarray(points, float)
        return float(np.sqrt(np.sum(weight * self.left_out**2) / np.sum(weight))) if len(self.poses) > 1 else float("nan")


@dataclass(frozen=True)
class Linear:
    """A whitened least-squares problem at its minimum: residual ``r`` (n,), Jacobian ``J`` (n, b), the ``rows`` of each pose
    (all others are priors), and the ``precision`` (b,) of priors that have no rows."""

    r: np.ndarray
    J: np.ndarray
    rows: tuple[np.ndarray, ...]
    precision: np.ndarray

    @property
    def information(self) -> np.ndarray:
        """Precision ``A`` (b, b) of all numbers."""
        return self.J.T @ self.J + np.diag(self.precision)

    @property
    def open(self) -> np.ndarray:
        """Mask (b,) of the numbers that all poses together do not determine."""
        return closed_inverse(self.information)[1]

    def without(self, i: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``(moved, open, std)`` without pose ``i``: change of the numbers (b,), mask of those the others do not determine,
        and standard deviations."""
        J, r = self.J[self.rows[i]], self.r[self.rows[i]]
        inverse, lost = closed_inverse(self.information - J.T @ J)
        return inverse @ (J.T @ r), lost, np.sqrt(np.maximum(np.diag(inverse), 0.0))

    def along(self, change: np.ndarray) -> np.ndarray:
        """Derivative of the numbers (b,) along a ``change`` (n,) of the residual; NaN for those not determined."""
        inverse, lost = closed_inverse(self.information)
        return np.where(lost, np.nan, -inverse @ (self.J.T @ change))


def influence_of(
    linear: Linear,
    labels: Sequence[str],
    logs: np.ndarray,
    poses: Sequence[str],
    distance: Callable[[int, np.ndarray], float],
    changes: dict[str, np.ndarray],
) -> Influence:
    """The influence at a minimum, for its first numbers, which ``labels`` name.

    ``distance(i, r)`` is the RMS distance (m) of whitened residuals ``r`` of pose ``i``; ``changes``: the change (n,) of the
    residual per relative change of a stated value.
    """
    count, moved, left_out, open_ = len(labels), [], [], linear.open
    positive = np.r_[logs, np.zeros(linear.J.shape[1] - len(logs), bool)]
    for i, rows in enumerate(linear.rows):
        x, lost, std = linear.without(i)
        lost = lost | vague(positive, std)
        moved.append(np.where(lost, np.nan, x)[:count])
        unknown = np.any(lost & ~open_)  # a number that no pose determines changes no prediction
        left_out.append(np.nan if unknown else distance(i, linear.r[rows] + linear.J[rows] @ x))
    stated = {name: linear.along(change)[:count] for name, change in changes.items()}
    return Influence(tuple(labels), logs, tuple(poses), np.array(moved).reshape(-1, count), np.array(left_out), stated)


def changed_studies(study: Study) -> Iterator[tuple[str, Study, float]]:
    """``(name, study, step)`` with one stated value of the cable changed by a relative ``step``."""
    for name in STATED:
        value = study.known(name)
        if value is not None:
            yield name, replace(study, cable={**study.cable, name: np.asarray(value) * (1.0 + _STEP)}), _STEP


def influence(problem: Problem, minimum: Minimum, measured: dict[str, np.ndarray] | None = None) -> Influence:
    """The influence at the minimum of a fit to curves; for a fit to clouds, ``measured`` are the points (m) of each axis."""
    if measured is not None:
        problem, minimum = _on_axes(problem, minimum, measured)
    e, poses = minimum.evaluation, problem.poses
    linear, real = _linear(problem, minimum, e)
    changes = {}
    for name, study, step in changed_studies(problem.study):
        other = problem.with_study(study).evaluator
        found = other(minimum.shared, minimum.local, start=e.configuration)
        if found.solved:
            moved = _stacked(found, poses, real, _sigma(problem, e)) - linear.r[: sum(map(len, linear.rows))]
            changes[name] = np.r_[moved, np.zeros(len(linear.r) - len(moved))] / step
    sigma = _sigma(problem, e)

    def distance(i, r):
        return float(sigma[i] * np.sqrt(np.sum(r**2) / np.sum(real[i])))

    logs = problem.logs()[: problem.layout.unknowns]
    return influence_of(linear, problem.layout.labels, logs, [p.name for p in problem.study.fit_poses], distance, changes)


def _on_axes(problem, minimum, measured):
    """The problem of the axes observed in clouds, at the minimum of the direct fit."""
    poses = [replace(p, curve=MeasuredCurve(measured[p.name])) for p in problem.study.fit_poses]
    study = replace(problem.study, poses=(*poses, *problem.study.validate_poses))
    other = problem.with_study(study)
    other.poses = poses_of(study, study.fit_poses, other.length, other.elements)
    other.evaluator = other.evaluator_of(other.poses)
    start = minimum.evaluation.configuration
    return other, replace(minimum, evaluation=other.evaluator(minimum.shared, minimum.local, start=start))


def _sigma(problem: Problem, e: Evaluation) -> np.ndarray:
    """Standard deviation (m) that weighs each pose: the stated one, else that of all residuals."""
    points = float(np.sum(problem.poses.mask))
    rest = np.sqrt(np.sum(np.asarray(e.residual) ** 2) / (2.0 * points))
    return np.array([max(rest, 1e-9 * problem.length) if p.noise is None else p.noise for p in problem.study.fit_poses])


def _stacked(e: Evaluation, poses: Poses, real, sigma: np.ndarray) -> np.ndarray:
    """Residuals of all real points over their noise, pose after pose."""
    return np.concatenate([np.asarray(e.residual[i])[real[i]].ravel() / sigma[i] for i in range(poses.count)])


def _linear(problem: Problem, minimum: Minimum, e: Evaluation) -> tuple[Linear, list[np.ndarray]]:
    """The linear problem at a minimum, and masks of the real points of each pose; numbers at a bound are held fixed."""
    layout, poses, sigma = problem.layout, problem.poses, _sigma(problem, e)
    n, k, prior = layout.shared, layout.local, layout.prior
    real = [np.asarray(poses.mask[i]) > 0 for i in range(poses.count)]
    ends = np.cumsum([3 * int(np.sum(keep)) for keep in real])
    rows = tuple(np.arange(end - 3 * int(np.sum(keep)), end) for end, keep in zip(ends, real, strict=True))
    width = n + poses.count * k
    J, jacobian = np.zeros((int(ends[-1]) + len(prior.at) + poses.count * k, width)), np.asarray(e.jacobian)
    for i, own in enumerate(rows):
        columns = np.r_[np.arange(n), n + i * k + np.arange(k)]
        J[np.ix_(own, columns)] = jacobian[i][real[i]].reshape(len(own), -1) / sigma[i]
    at = int(ends[-1]) + np.arange(len(prior.at))
    J[at, prior.at] = 1.0 / prior.std
    J[at[-1] + 1 if len(at) else int(ends[-1]) :, n:] = np.eye(poses.count * k)
    low, high = (np.array([v for slot in layout.slots for v in getattr(slot, end)]) for end in ("low", "high"))
    x = minimum.shared[: layout.unknowns]
    precision = np.zeros(width)
    precision[: layout.unknowns] = held = (x <= low) | (x >= high)
    J[:, : layout.unknowns][:, held] = 0.0
    r = np.concatenate([_stacked(e, poses, real, sigma), prior.pull(minimum.shared), minimum.local.ravel()])
    return Linear(r, J, rows, precision), real
