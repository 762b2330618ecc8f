"""Confirmation: would the effect have predicted a pose that it had not seen, and is it the same in every pose?

Leaving out a whole pose (points of one pose share their noise) needs no new fit: with the whitened residual ``r``, columns
``J`` and the precision ``A`` of all numbers at a minimum, the residual of pose ``i`` predicted by the others is, to first
order,

    (I - J_i A^-1 J_i')^-1 r_i.

Reference: Cook and Weisberg, "Residuals and influence in regression" (1982), eq. 2.2.24; a test holds it against refits.
"""

import numpy as np
from scipy import stats

from scan2flex_jax.diagnosis.prior import Prior
from scan2flex_jax.diagnosis.refit import Refit
from scan2flex_jax.diagnosis.residual import orthonormal, whiten
from scan2flex_jax.diagnosis.sensitivity import Numbers


def left_out(stage, found: Refit) -> np.ndarray:
    """Per pose the RMS distance (m) between its measured points and what the other poses predict for it."""
    white, covariance = _white(stage, found), np.nan_to_num(found.covariance)
    out = []
    for i, rows in enumerate(white.rows):
        H = white.J[rows] @ covariance @ white.J[rows].T
        r = np.linalg.lstsq(np.eye(len(rows)) - H, white.r[rows], rcond=1e-10)[0]
        out.append(np.sqrt(white.squares(i, r) / len(white.metrics[i].factor)))
    return np.array(out)


def unseen(stage, found: Refit) -> float | None:
    """Error in a pose left out over that of the base, geometric mean over the poses: what an effect foretells.

    Not the error of all poses together: a pose that alone shows an effect is predicted by none of the others.
    """
    if not found.components or stage.bench.poses.count < 2:
        return None
    return float(np.exp(np.mean(np.log(left_out(stage, found) / left_out(stage, stage.base)))))


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
    return float(stats.chi2.sf(np.sum((U.T @ white.r) ** 2), max(U.shape[1], 1))) if U.shape[1] else None


def _white(stage, found):
    return whiten(found.shapes, stage.bench.real, Numbers(stage.bench, found.components), found.vector, found.law)
