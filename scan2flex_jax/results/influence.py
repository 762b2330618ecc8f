"""Influence of each pose and of the stated length and mass on the estimates, to first order at a minimum.

With the whitened residual ``r``, its Jacobian ``J`` and the precision ``A = J'J + priors`` of all parameters, leaving out pose
``i`` moves the parameters by

    (A - J_i' J_i)^-1 J_i' r_i,

and a change ``dr`` of the residual, caused by another length or mass, by ``-A^-1 J' dr``. Nothing is refitted; tests compare
both with refits. Reference: Cook and Weisberg, "Residuals and influence in regression" (1982), chapter 2.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from scan2flex_jax.posterior.determined import closed_inverse
from scan2flex_jax.posterior.estimate import vague
from scan2flex_jax.posterior.posterior import Fitted, solved
from scan2flex_jax.posterior.priors import Prior
from scan2flex_jax.posterior.program import Program
from scan2flex_jax.posterior.quantities import left_out

STATED = ("length", "length_density")
"""Properties of the cable that a user measures, and on which every stiffness depends."""
_STEP = 1e-4  # relative change of a stated value: it moves shapes by a thousand times the residual of the solver


@dataclass(frozen=True)
class Influence:
    """Changes of the unknowns in ``x``: of logarithms for positive quantities (``logs``), else in their own unit.

    ``moved`` (poses, numbers): change when a pose is left out; NaN if the other poses do not determine the number.
    ``left_out`` (poses,): RMS distance (m) of a pose from its prediction by the others; NaN likewise. ``stated``: change per
    relative change of a stated value of the cable, by its name. ``exact_clamps``: standard deviations of the numbers if the
    clamps were known exactly, over those that they have; None if they are.
    """

    labels: tuple[str, ...]
    logs: np.ndarray
    poses: tuple[str, ...]
    moved: np.ndarray = field(repr=False)
    left_out: np.ndarray = field(repr=False)
    stated: dict[str, np.ndarray] = field(repr=False, default_factory=dict)
    exact_clamps: np.ndarray | None = field(repr=False, default=None)

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
        if len(self.poses) < 2 or not np.any(weight):
            return float("nan")
        return float(np.sqrt(np.sum(np.where(weight > 0, weight * self.left_out**2, 0.0)) / np.sum(weight)))


def influence_of(h: Fitted) -> Influence:
    """The influence at a hypothesis; solves all poses twice."""
    v, problem, count = h.variant, h.variant.problem, h.variant.program.layout.unknowns
    prior, logs = Prior(v.program, h.components, h.wider), problem.logs()[:count]
    held = prior.frozen | (h.x <= prior.low) | (h.x >= prior.high)
    Li = v.likelihood.whitening(h.u, h.linear.Z)
    r, X = (Li @ h.linear.r[:, :, None])[:, :, 0], Li @ h.linear.X
    X = np.where(np.stack([held[at] for at in h.linear.at])[:, None], 0.0, X)
    A, _ = replace(h.linear, precision=np.where(held, 1.0, prior.precision + prior.width)).normal(r, X)
    inverse, unseen = closed_inverse(A)
    positive, moved, left = np.r_[logs, np.zeros(len(A) - count, bool)], [], left_out(h)
    for i, at in enumerate(h.linear.at):
        rest, pull = A.copy(), np.zeros(len(A))
        rest[np.ix_(at, at)] -= X[i].T @ X[i]
        pull[at] = X[i].T @ r[i]
        own, lost = closed_inverse(rest)
        lost |= vague(positive, np.sqrt(np.maximum(np.diag(own), 0.0)))
        moved.append(np.where(lost, np.nan, own @ pull)[:count])
        if np.any(lost & ~unseen):  # a number that no pose determines changes no prediction
            left[i] = np.nan
    stated, study = {}, problem.study
    for name in (name for name in STATED if study.known(name) is not None):
        other = replace(study, cable={**study.cable, name: np.asarray(study.known(name)) * (1.0 + _STEP)})
        shapes = Program(problem.with_study(other), v.minimum).shapes(h.components, h.x, h.configuration)
        if solved(shapes):
            change, along = v.rows.of(shapes, [s.residual[:, :, None] for s in shapes])[:, :, 0] - h.linear.r, np.zeros(len(A))
            for i, at in enumerate(h.linear.at):
                along[at] += X[i].T @ Li[i] @ change[i] / _STEP
            stated[name] = np.where(unseen, np.nan, -inverse @ along)[:count]
    names, exact = tuple(p.name for p in problem.study.fit_poses), None
    if h.index.local:
        others = np.r_[np.arange(h.index.shared), np.arange(h.index.base, h.index.count)]
        alone, _ = closed_inverse(A[np.ix_(others, others)])
        with np.errstate(divide="ignore", invalid="ignore"):
            exact = np.sqrt(np.diag(alone)[:count] / np.where(unseen, np.nan, np.diag(inverse))[:count])
    return Influence(tuple(problem.layout.labels), logs, names, np.array(moved).reshape(-1, count), left, stated, exact)
