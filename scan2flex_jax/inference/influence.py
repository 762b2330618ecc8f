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

from scan2flex_jax.inference.determined import closed_inverse
from scan2flex_jax.inference.estimate import vague
from scan2flex_jax.study.model import Study

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
class White:
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
    white: White,
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
    count, moved, left_out, open_ = len(labels), [], [], white.open
    positive = np.r_[logs, np.zeros(white.J.shape[1] - len(logs), bool)]
    for i, rows in enumerate(white.rows):
        x, lost, std = white.without(i)
        lost = lost | vague(positive, std)
        moved.append(np.where(lost, np.nan, x)[:count])
        unknown = np.any(lost & ~open_)  # a number that no pose determines changes no prediction
        left_out.append(np.nan if unknown else distance(i, white.r[rows] + white.J[rows] @ x))
    stated = {name: white.along(change)[:count] for name, change in changes.items()}
    return Influence(tuple(labels), logs, tuple(poses), np.array(moved).reshape(-1, count), np.array(left_out), stated)


def changed_studies(study: Study) -> Iterator[tuple[str, Study, float]]:
    """``(name, study, step)`` with one stated value of the cable changed by a relative ``step``."""
    for name in STATED:
        value = study.known(name)
        if value is not None:
            yield name, replace(study, cable={**study.cable, name: np.asarray(value) * (1.0 + _STEP)}), _STEP
