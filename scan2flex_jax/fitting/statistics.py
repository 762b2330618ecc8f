"""Uncertainty of a fit: covariance of the estimates, and undetermined combinations (of one parameter: `estimate`).

Residuals of a scan are correlated along the cable, so the covariance is the sandwich ``A^-1 B A^-1`` with ``A = J'J / s^2``
plus priors and ``B = J' C J / s^4`` plus priors, ``C`` the estimated noise covariance: it is valid for any weights of the fit.
Directions with a negligible singular value of the scaled ``J`` are not determined; sentences name them, and the numbers that
are vague (`estimate`).
"""

from dataclasses import dataclass

import numpy as np

from scan2flex_jax.fitting.discrepancy import Discrepancy, most_likely_part, plane_normal, usual_size
from scan2flex_jax.fitting.estimate import VAGUE, vague
from scan2flex_jax.fitting.least_squares import normal_equations
from scan2flex_jax.fitting.likelihood import Residual, estimate_noise, in_plane_normal, noise_and_discrepancy
from scan2flex_jax.fitting.noise import Noise
from scan2flex_jax.fitting.parameters import Layout
from scan2flex_jax.fitting.quadratic import UNSEEN
from scan2flex_jax.fitting.settings import USUAL, NoiseSettings

ACROSS = ("normal", "closest")  # distances whose residuals are across the cable, as those of a discrepancy
_OPEN = 1.0e-4  # singular value over the largest of the unit-column Jacobian: "not determined" (density: 6e-5 by stretching)
_PART = 0.05  # of the largest component of an open direction: entries with a larger one are not determined


@dataclass(frozen=True)
class Uncertainty:
    """Covariance of the unknowns in ``x`` (infinite variance if undetermined), masks of those that are ``determined`` and of
    those that are ``felt`` (identifiable at all, however vague), and sentences on the others."""

    covariance: np.ndarray
    determined: np.ndarray
    felt: np.ndarray
    sentences: tuple[str, ...]


def noise_of(evaluation, poses, length: float, stated: float | None, settings: NoiseSettings = USUAL) -> Noise:
    """Noise estimated from an evaluation's residuals (see `fitting.noise`)."""
    return estimate_noise(_measured(_residuals(evaluation, poses), poses), length, stated, settings)


def _measured(residuals, poses):
    """The residuals without the second row, which is empty, where markers have one coordinate only."""
    if poses.rows is None:
        return residuals
    alone = [np.count_nonzero(rows) == 1 for rows in poses.rows]
    first = [np.tile([1.0, 0.0], (len(r.s), 1)) for r in residuals]
    return [r.in_plane(u) if one else r for r, u, one in zip(residuals, first, alone, strict=True)]


def discrepancy_of(
    problem, minimum, noise: Noise, stated: float | None, settings: NoiseSettings = USUAL
) -> tuple[Noise, Discrepancy]:
    """Noise of the sensor and discrepancy, estimated together, starting from the most likely ``noise`` without one."""
    poses, length, e = problem.poses, problem.length, minimum.evaluation
    columns = _scatter(problem, minimum)
    found, curvature, _ = _noise_and_discrepancy(problem, minimum, columns, noise, stated, settings)
    if not curvature:
        return found, Discrepancy(length=length)
    parts = zip(columns, _residuals(e, poses), strict=True)
    moved = [most_likely_part(curvature, Z, pose.r, found.covariance(pose.s)) for Z, pose in parts]
    return found, Discrepancy(curvature, length, columns, tuple(moved))


def log_likelihood(problem, minimum, stated: float | None, settings: NoiseSettings = USUAL) -> float:
    """Log likelihood (nats, up to a constant) of the residual at a minimum, with the likeliest noise and discrepancy.

    The parameters are free to first order; the minimum need not be that under this noise.
    """
    noise = noise_of(minimum.evaluation, problem.poses, problem.length, stated, settings)
    return -_noise_and_discrepancy(problem, minimum, _scatter(problem, minimum), noise, stated, settings)[2]


def _scatter(problem, minimum) -> tuple[np.ndarray, ...]:
    """Columns (m, 3, k) of a unit discrepancy of each pose at a minimum."""
    columns = problem.evaluator.scatter(minimum.shared, minimum.local, minimum.evaluation.configuration)
    return tuple(Z[np.asarray(mask) > 0] for Z, mask in zip(columns, problem.poses.mask, strict=True))


def _noise_and_discrepancy(problem, minimum, columns, noise, stated, settings):
    """`likelihood.noise_and_discrepancy` of the residual at a minimum."""
    poses, e = problem.poses, minimum.evaluation
    points = np.concatenate([np.asarray(p)[np.asarray(m) > 0] for p, m in zip(poses.points, poses.mask, strict=True)])
    if poses.rows is not None:
        residuals = _measured(_residuals(e, poses, columns), poses)
        return noise_and_discrepancy(residuals, noise, problem.length, stated, usual_size(e.configuration, settings), settings)
    across, usual = plane_normal(points, problem.study.gravity), usual_size(e.configuration, settings)
    residuals = _residuals(e, poses, columns)
    if across is not None:
        axes = [a[np.asarray(mask) > 0] for a, mask in zip(e.axes, poses.mask, strict=True)]
        residuals = [r.in_plane(in_plane_normal(a, across)) for r, a in zip(residuals, axes, strict=True)]
    return noise_and_discrepancy(residuals, noise, problem.length, stated, usual, settings)


def _residuals(evaluation, poses, discrepancy=None) -> list[Residual]:
    out = []
    for i in range(poses.count):
        real = np.asarray(poses.mask[i]) > 0
        s, r, J = evaluation.s[i][real], evaluation.residual[i][real], evaluation.jacobian[i][real]
        Z = None if discrepancy is None else discrepancy[i]
        marked = None if poses.marked is None or discrepancy is None else np.asarray(poses.marked[i])[real] > 0
        marked = marked if poses.rows is None or not np.any(poses.rows[i]) else None
        out.append(Residual(s, r, J, np.arange(J.shape[-1]), Z, marked))
    return out


def uncertainty(
    minimum, poses, layout: Layout, sigma: np.ndarray, noise: Noise, discrepancy: Discrepancy | None = None
) -> Uncertainty:
    """Covariance and open directions at a minimum."""
    e = minimum.evaluation
    scaled = e.jacobian / sigma[:, None, None, None]
    JJ, _ = normal_equations(layout, e.residual / sigma[:, None, None], scaled, minimum.shared, minimum.local)
    B = spread_of_gradient(e, poses, layout, sigma, noise, len(JJ), discrepancy)
    inverse, open_part, hidden = _decomposed(JJ)
    unseen, open_part = hidden[: layout.unknowns], open_part[: layout.unknowns]
    covariance = (inverse @ B @ inverse)[: layout.unknowns, : layout.unknowns]
    lost = _involved(open_part) | unseen
    covariance[lost, :] = covariance[:, lost] = 0.0
    covariance[lost, lost] = np.inf
    wide = vague(layout.logs, np.sqrt(np.diag(covariance)))
    sentences = _open_sentences(layout, open_part, unseen) + _vague_sentences(layout, covariance, wide & ~lost)
    return Uncertainty(covariance, ~(lost | wide), ~lost, tuple(sentences))


def _decomposed(A: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inverse of a precision (b, b) in the directions that are determined, the open directions (b, k), and the mask of entries
    without influence on any residual."""
    scale = np.sqrt(np.maximum(np.diag(A), 0.0))
    hidden = scale <= UNSEEN * np.max(scale)
    A = np.where(hidden[:, None] | hidden, 0.0, A)
    scale = np.where(hidden, 1.0, scale)
    values, vectors = np.linalg.eigh(A / np.outer(scale, scale))
    closed = values > _OPEN**2 * max(values[-1], 1e-300)
    inverse = (vectors[:, closed] / values[closed]) @ vectors[:, closed].T / np.outer(scale, scale)
    return inverse, vectors[:, ~closed] / scale[:, None], hidden


def _involved(directions: np.ndarray) -> np.ndarray:
    """Mask of the entries that contribute to open directions (b, k)."""
    weight = np.abs(directions).max(axis=1, initial=0.0)
    return (weight > _PART * np.abs(directions).max(initial=0.0)) & (directions.size > 0)


def closed_inverse(A: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Inverse of a precision (b, b) in the directions that are determined, and the mask (b,) of undetermined entries."""
    inverse, directions, hidden = _decomposed(A)
    return inverse, _involved(directions) | hidden


def spread_of_gradient(e, poses, layout: Layout, sigma: np.ndarray, noise: Noise, size: int, discrepancy) -> np.ndarray:
    """Covariance (size, size) of the gradient: ``J' C J / s^4`` plus the priors' precisions; ``C`` is the covariance of sensor
    and discrepancy."""
    n, k = layout.shared, layout.local
    B = np.zeros((size, size))
    for i in range(poses.count):
        own = np.r_[np.arange(n), n + i * k + np.arange(k)]
        real = np.asarray(poses.mask[i]) > 0
        J = e.jacobian[i][real] / sigma[i] ** 2
        C = noise.covariance(e.s[i][real])
        for normal in range(J.shape[1]):
            B[np.ix_(own, own)] += J[:, normal].T @ C @ J[:, normal]
        if discrepancy is not None and discrepancy.curvature:
            moved = discrepancy.curvature * np.einsum("mnk,mnq->kq", J, discrepancy.columns[i])
            B[np.ix_(own, own)] += moved @ moved.T
    prior = np.r_[layout.prior.precision(n), np.ones(size - n)]
    B[np.diag_indices_from(B)] += prior
    return B


def _open_sentences(layout, directions, unseen):
    labels, sentences = layout.labels, []
    sentences += [f"{labels[i]} has no influence on these shapes: it is not determined" for i in np.flatnonzero(unseen)]
    for raw in directions.T:
        if np.abs(raw).max() == 0:
            continue
        d = raw / np.abs(raw).max()
        involved = np.flatnonzero(np.abs(d) > 0.05)
        if len(involved) == 1 and unseen[involved[0]]:
            continue
        names = [labels[i] for i in involved]
        stiff = [m for m in names if m.split("[")[0] != "length_density"]
        if "length_density" in names and np.ptp(np.abs(d[involved])) < 0.05 and np.ptp(np.sign(d[involved])) == 0:
            verb = "is" if len(stiff) == 1 else "are"
            sentences.append(f"only the ratio of {listed(stiff)} to the density {verb} determined")
        else:
            weights = ", ".join(f"{d[i]:+.2f} {labels[i]}" for i in involved)
            sentences.append(f"these poses do not determine the combination {weights}")
    return sentences


def _vague_sentences(layout, covariance, wide):
    """Sentences on numbers that are vague by themselves, and on vague combinations."""
    own = np.flatnonzero(wide)
    variance, vectors = np.linalg.eigh(covariance[np.ix_(own, own)])
    directions = np.zeros((len(wide), int(np.sum(variance > VAGUE**2))))
    directions[own] = vectors[:, variance > VAGUE**2]
    involved = np.abs(directions) > 0.05 * np.abs(directions).max(axis=0, initial=0.0)
    shared = np.sum(involved, axis=0) > 1
    alone = wide & ~np.any(involved[:, shared], axis=1)
    sentences = _open_sentences(layout, directions[:, shared], np.zeros(len(wide), bool))
    return sentences + [
        f"{layout.labels[i]} is not determined: its uncertainty exceeds a factor of 2.7" for i in np.flatnonzero(alone)
    ]


def listed(names) -> str:
    """Words in a row, the last two joined by "and"."""
    return names[0] if len(names) == 1 else ", ".join(names[:-1]) + " and " + names[-1]


def unseen_spread(layout, jacobian, covariance) -> float:
    """RMS displacement (m) of a pose that was not fitted, by its own tolerances and the errors of the estimates.

    Undetermined entries are excluded, since their effect is unbounded.
    """
    J = jacobian.reshape(-1, jacobian.shape[-1])
    unknowns, local = J[:, : layout.unknowns], J[:, layout.shared :]
    known = np.isfinite(np.diag(covariance))
    C = covariance[np.ix_(known, known)]
    variance = np.sum(local**2) + np.einsum("ri,ij,rj->", unknowns[:, known], C, unknowns[:, known])
    return float(np.sqrt(variance / len(jacobian)))
