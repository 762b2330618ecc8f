"""Confirmation: would the effect have predicted a pose that it had not seen, and is it the same in every pose?

Leaving out a whole pose (points of one pose share their noise) needs no new fit where the model is close to linear: with the
whitened residual ``r``, columns ``J`` and the precision ``A`` of all numbers at a minimum, the residual of pose ``i`` predicted
by the others is, to first order,

    (I - J_i A^-1 J_i')^-1 r_i.

Where models are compared, each is refitted to the other poses in turn (`diagnosis.left_out`): a pose that alone reaches a
support, or pulls a tether taut, leaves the others far from linear.
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

_LEAST_GAIN = 0.05  # relative: errors that differ by less are alike


def left_out(stage, found: Refit) -> np.ndarray:
    """Per pose the RMS distance (m) between its measured points and its prediction by the others: by refits where these were
    made, else to first order."""
    if found in stage.unseen:
        return stage.unseen[found]
    white, covariance = _white(stage, found), np.nan_to_num(found.covariance)
    out = []
    for i, rows in enumerate(white.rows):
        H = white.J[rows] @ covariance @ white.J[rows].T
        r = np.linalg.lstsq(np.eye(len(rows)) - H, white.r[rows], rcond=1e-10)[0]
        out.append(np.sqrt(white.squares(i, r) / len(white.metrics[i].factor)))
    return np.array(out)


def predicted(stage, found: Refit) -> np.ndarray:
    """`left_out` by refits, which are made once; to first order where a refit cannot be solved."""
    if found not in stage.unseen:
        first, exact = left_out(stage, found), refitted(stage.bench, found)
        stage.unseen[found] = np.where(np.isfinite(exact), exact, first)
    return stage.unseen[found]


def unseen(stage, found: Refit) -> float | None:
    """Error in a pose left out over that of the base, geometric mean over the poses: what an effect foretells.

    Not the error of all poses together: a pose that alone shows an effect is predicted by none of the others.
    """
    if not found.components or stage.bench.poses.count < 2:
        return None
    return float(np.exp(np.mean(np.log(left_out(stage, found) / left_out(stage, stage.base)))))


@dataclass(frozen=True)
class Comparison:
    """One model against another in poses left out in turn: ``gain``, the mean logarithm of the ratio of their errors (positive
    where the first is better), its standard error ``std`` over the poses, and ``ratio`` of the RMS over all of them.

    One model is better where both say so: the mean by more than its uncertainty, so that no single pose decides, and the ratio,
    so that no gain in poses of small error counts that is lost again in those of large error.
    """

    gain: float
    std: float
    ratio: float

    @property
    def better(self) -> bool:
        """Whether the first predicts better, by more than the uncertainty of the comparison."""
        return self.gain > max(self.std, _LEAST_GAIN) and self.ratio < 1.0 - _LEAST_GAIN

    @property
    def worse(self) -> bool:
        """Whether it predicts worse, likewise."""
        return -self.gain > max(self.std, _LEAST_GAIN) and self.ratio > 1.0 + _LEAST_GAIN


def compared(stage, found: Refit, other: Refit) -> Comparison:
    """A refit against another, paired over the poses; from a single pose nothing is known."""
    if found is other or stage.bench.poses.count < 2:
        return Comparison(0.0, np.inf, 1.0)
    a, b = predicted(stage, found), predicted(stage, other)
    if not (np.all(np.isfinite(a)) and np.all(np.isfinite(b))):
        return Comparison(0.0, np.inf, 1.0)
    logs = np.log(b / a)
    ratio = float(np.sqrt(np.sum(a**2) / np.sum(b**2)))
    return Comparison(float(np.mean(logs)), float(np.std(logs, ddof=1) / np.sqrt(len(logs))), ratio)


def scatter(stage, found: Refit, k: int) -> float | None:
    """Relative scatter between poses of the size of component ``k``: the standard deviation of the size that fits each pose by
    itself, over the size; poses that hardly feel it weigh little. None where the size is not estimated, or from one pose.

    A first-order step along the size, with all other numbers where they are.
    """
    numbers, frozen = Numbers(stage.bench, found.components), Prior(stage.bench, found.components).frozen
    at = numbers.amplitudes(k)
    size = found.vector[at]
    if np.any(frozen[at]) or not np.any(size) or stage.bench.poses.count < 2:
        return None
    white = _white(stage, found)
    column = white.J[:, at] @ size  # per relative change of the size
    weight = np.array([column[rows] @ column[rows] for rows in white.rows])
    asked = np.array([-column[rows] @ white.r[rows] for rows in white.rows]) / np.maximum(weight, 1e-300)
    mean = np.sum(weight * asked) / np.sum(weight)
    return float(np.sqrt(np.sum(weight * (asked - mean) ** 2) / np.sum(weight)))


def constancy(stage, found: Refit) -> float | None:
    """p-value of the effect's size being the same in all poses (score test of a size of its own in each pose).

    None where there is nothing to compare: one pose, or an effect whose size was not estimated (how hard a plane is).
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
