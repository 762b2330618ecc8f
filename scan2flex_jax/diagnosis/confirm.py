"""Confirmation: leave-one-pose-out prediction error, and homogeneity of an effect's size across poses.

A whole pose is left out, since its points share their noise, and the model is refitted to the others
(`diagnosis.left_out`). With the whitened residual ``r``, columns ``J`` and the precision ``A`` of all parameters at a minimum,
the residual of pose ``i`` predicted from the others is, to first order,

    (I - J_i A^-1 J_i')^-1 r_i.

That needs no refit. It has no bound where one pose nearly alone determines a parameter, and fails without the one pose that
reaches a support, or pulls a tether taut.
Reference: Cook and Weisberg, "Residuals and influence in regression" (1982), eq. 2.2.24; a test holds it against refits.
"""

from dataclasses import dataclass

import numpy as np
from scipy import special

from scan2flex_jax.diagnosis.left_out import refitted
from scan2flex_jax.diagnosis.prior import Prior
from scan2flex_jax.diagnosis.refit import Refit
from scan2flex_jax.diagnosis.residual import orthonormal, whiten
from scan2flex_jax.diagnosis.sensitivity import Numbers
from scan2flex_jax.diagnosis.settings import USUAL

_LEFT = 1e-4  # share of a direction of a pose's residual that the parameters leave free; below it they follow the pose


def left_out(stage, found: Refit) -> np.ndarray:
    """Per pose the RMS distance (m) between its measured points and its prediction by a refit to the others, computed once; to
    first order where that refit is not solved."""
    if found not in stage.unseen:
        free = reported(stage, found)
        exact = refitted(stage.bench, free)
        solved = np.isfinite(exact)
        stage.unseen[found] = exact if np.all(solved) else np.where(solved, exact, to_first_order(stage, free))
    return stage.unseen[found]


def reported(stage, found: Refit) -> Refit:
    """The refit that is reported: under the law of a discrepancy the prior of the usual size draws a strong effect, which then
    predicts worse than the one reported. Without a discrepancy the data decide."""
    return stage.freed(found) if found.law.curvature else found


def to_first_order(stage, found: Refit) -> np.ndarray:
    """`left_out` without refits."""
    white, covariance = _white(stage, found), np.nan_to_num(found.covariance)
    out = []
    for i, rows in enumerate(white.rows):
        H = white.J[rows] @ covariance @ white.J[rows].T
        r = np.linalg.lstsq(np.eye(len(rows)) - H, white.r[rows], rcond=1e-10)[0]
        out.append(np.sqrt(white.squares(i, r) / len(white.metrics[i].factor)))
    return np.array(out)


def unseen(stage, found: Refit) -> float | None:
    """Leave-one-pose-out error over that of the base model, geometric mean over the poses.

    The mean is geometric because the others cannot predict a pose that alone shows the effect.
    """
    if not found.components or stage.bench.poses.count < 2:
        return None
    return float(np.exp(np.mean(np.log(left_out(stage, found) / left_out(stage, stage.base)))))


@dataclass(frozen=True)
class Comparison:
    """Leave-one-pose-out errors of two models: ``gain``, the mean log ratio of their errors (positive if the first model is
    better), its standard error ``std`` over the poses, and ``ratio``, that of the RMS errors over all poses. Smaller relative
    differences than ``least`` count as none.

    A model is better if both measures agree: the gain exceeds its standard error, so that no single pose decides, and the ratio
    is below one, so that poses of small error do not outweigh those of large error.
    """

    gain: float
    std: float
    ratio: float
    least: float = USUAL.least_gain

    @property
    def better(self) -> bool:
        """Whether the first model predicts better, by more than the uncertainty of the comparison."""
        return self.gain > max(self.std, self.least) and self.ratio < 1.0 - self.least

    @property
    def worse(self) -> bool:
        """Whether the first model predicts worse, by more than the uncertainty of the comparison."""
        return -self.gain > max(self.std, self.least) and self.ratio > 1.0 + self.least


def compared(stage, found: Refit, other: Refit) -> Comparison:
    """Comparison of two refits, paired over the poses; a single pose decides nothing."""
    if found is other or stage.bench.poses.count < 2:
        return Comparison(0.0, np.inf, 1.0)
    a, b = left_out(stage, found), left_out(stage, other)
    if not (np.all(np.isfinite(a)) and np.all(np.isfinite(b))):
        return Comparison(0.0, np.inf, 1.0)
    logs = np.log(b / a)
    ratio, std = float(np.sqrt(np.sum(a**2) / np.sum(b**2))), float(np.std(logs, ddof=1) / np.sqrt(len(logs)))
    return Comparison(float(np.mean(logs)), std, ratio, stage.settings.least_gain)


def uncertainty(stage, found: Refit) -> np.ndarray:
    """Covariance of all parameters of a refit, for intervals: with the standard errors of `inflation`."""
    factor = inflation(stage, found)
    return found.covariance * np.outer(factor, factor)


def inflation(stage, found: Refit) -> np.ndarray:
    """Per parameter its standard error from the scatter between poses over that from the law of the residual, at least 1.

    The covariance of a discrepancy is an assumption. The scatter of the poses' gradients needs none:
    ``A^-1 (sum_i g_i g_i') A^-1`` with ``g_i = J_i' (I - H_i)^(-1/2) r_i``, ``H_i = J_i A^-1 J_i'`` and the precision ``A``;
    but poses are few. Intervals take the larger of both; 1 without a discrepancy. Reference: Bell and McCaffrey, "Bias
    reduction in standard errors for linear regression with multi-stage samples" (2002).
    """
    covariance = np.nan_to_num(found.covariance)
    own = np.diag(covariance)
    if not found.law.curvature or not np.isfinite(found.cost):
        return np.ones(len(own))
    white, moved = _white(stage, found), np.zeros(len(own))
    for rows in white.rows:
        J = white.J[rows]
        free, U = np.linalg.eigh(np.eye(len(rows)) - J @ covariance @ J.T)
        y = (U.T @ white.r[rows])[free > _LEFT] / np.sqrt(free[free > _LEFT])
        moved += (covariance @ (J.T @ (U[:, free > _LEFT] @ y))) ** 2
    return np.sqrt(np.maximum(moved / np.where(own > 0, own, np.inf), 1.0))


def scatter(stage, found: Refit, k: int) -> float | None:
    """Relative scatter between poses of the size of component ``k``: weighted deviation of the size that fits each pose by
    itself, over the size; the weights are sensitivities. None where the size is not estimated or without influence, or from one
    pose.

    To first order in the size, with all other parameters fixed.
    """
    found = reported(stage, found)
    numbers, frozen = Numbers(stage.bench, found.components), Prior(stage.bench, found.components).frozen
    at = numbers.amplitudes(k)
    size = found.vector[at]
    if np.any(frozen[at]) or not np.any(size) or stage.bench.poses.count < 2:
        return None
    white = _white(stage, found)
    column = white.J[:, at] @ size  # per relative change of the size
    weight = np.array([column[rows] @ column[rows] for rows in white.rows])
    if not np.any(weight):
        return None
    change = np.array([-column[rows] @ white.r[rows] for rows in white.rows]) / np.maximum(weight, 1e-300)
    mean = np.sum(weight * change) / np.sum(weight)
    return float(np.sqrt(np.sum(weight * (change - mean) ** 2) / np.sum(weight)))


def constancy(stage, found: Refit) -> float | None:
    """p-value of homogeneity: one size of the effects in all poses (score test against one size per pose).

    None for a single pose, and for effects without an estimated size (a support plane's stiffness is not estimated).
    """
    numbers, frozen = Numbers(stage.bench, found.components), Prior(stage.bench, found.components).frozen
    at = [i for k in range(len(found.components)) for i in numbers.amplitudes(k) if not frozen[i]]
    if not at or stage.bench.poses.count < 2:
        return None
    white = _white(stage, found)
    parts = []
    for rows in white.rows:
        own = np.zeros((len(white.r), len(at)))
        own[rows] = white.J[np.ix_(rows, at)]
        parts.append(own)
    Q = orthonormal(white.J)
    X = np.concatenate(parts, axis=1)
    size = np.linalg.norm(X, axis=0)
    X = X[:, size > 0] / size[size > 0]
    U, d, _ = np.linalg.svd(X - Q @ (Q.T @ X), full_matrices=False)
    U = U[:, d > 1e-2]
    return float(special.chdtrc(max(U.shape[1], 1), np.sum((U.T @ white.r) ** 2))) if U.shape[1] else None


def _white(stage, found):
    return whiten(found.shapes, stage.bench.real, Numbers(stage.bench, found.components), found.vector, found.law)
