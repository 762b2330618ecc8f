"""Which parameters the poses determine: covariance of the estimates, and undetermined combinations (of one: `estimate`).

Directions with a negligible eigenvalue of the precision, scaled to unit diagonal, are not determined; sentences name them, and
the numbers that are vague.
"""

from dataclasses import dataclass

import numpy as np

from scan2flex_jax.fitting.parameters import Layout
from scan2flex_jax.fitting.quadratic import UNSEEN
from scan2flex_jax.inference.estimate import VAGUE, vague

_OPEN = 1.0e-4  # singular value over the largest of the unit-column Jacobian: "not determined" (density: 6e-5 by stretching)
_PART = 0.05  # of the largest component of an open direction: entries with a larger one are not determined


@dataclass(frozen=True)
class Uncertainty:
    """Covariance of the unknowns in ``x`` (infinite variance if undetermined), masks of those that are ``determined`` and of
    those that are ``identifiable`` (identifiable at all, however vague), and sentences on the others."""

    covariance: np.ndarray
    determined: np.ndarray
    identifiable: np.ndarray
    sentences: tuple[str, ...]


def uncertainty(layout: Layout, A: np.ndarray) -> Uncertainty:
    """Covariance and open directions of the unknowns from the precision ``A`` (b, b) of all parameters."""
    inverse, open_part, hidden = _decomposed(A)
    unseen, open_part = hidden[: layout.unknowns], open_part[: layout.unknowns]
    covariance = inverse[: layout.unknowns, : layout.unknowns].copy()
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
