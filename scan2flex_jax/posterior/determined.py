"""Which parameters the poses determine: covariance of the estimates, and undetermined combinations (of one: `estimate`).

Directions with a negligible eigenvalue of the precision, scaled to unit diagonal, are not determined, nor are two unknowns that
can replace one another; sentences name them, and the numbers that are vague.
"""

from dataclasses import dataclass

import numpy as np

from scan2flex_jax.fitting.parameters import Layout
from scan2flex_jax.fitting.quadratic import UNSEEN
from scan2flex_jax.posterior.estimate import VAGUE, vague
from scan2flex_jax.study.model import Study

_OPEN = 1.0e-4  # singular value over the largest of the unit-column Jacobian: "not determined" (density: 6e-5 by stretching)
_PART = 0.05  # of the largest component of an unidentifiable direction: entries with a larger one are not determined
_ALIKE = 0.999  # correlation of two unknowns, all stated values fixed, from which on one can replace the other


@dataclass(frozen=True)
class Uncertainty:
    """Covariance of the unknowns in ``x`` (infinite variance if undetermined), masks of those that are ``determined`` and of
    those that are ``identifiable`` (identifiable at all, however vague), and sentences on the others."""

    covariance: np.ndarray
    determined: np.ndarray
    identifiable: np.ndarray
    sentences: tuple[str, ...]


def uncertainty(layout: Layout, A: np.ndarray, meaningless: np.ndarray | bool = False) -> Uncertainty:
    """Covariance and unidentifiable directions of the unknowns from the precision ``A`` (b, b) of all parameters.

    ``meaningless``: mask of unknowns that are not determined for another reason (`ends`), which is said elsewhere.
    """
    inverse, open_part, hidden = _decomposed(A)
    unseen, open_part = hidden[: layout.unknowns], open_part[: layout.unknowns]
    covariance = inverse[: layout.unknowns, : layout.unknowns].copy()
    lost = _involved(open_part) | unseen
    pairs = _replaceable(layout, A, lost | vague(layout.logs, np.sqrt(np.diag(covariance))))
    lost[[i for pair in pairs for i in pair[:2]]] = True
    lost |= meaningless
    covariance[lost, :] = covariance[:, lost] = 0.0
    covariance[lost, lost] = np.inf
    wide = vague(layout.logs, np.sqrt(np.diag(covariance)))
    sentences = _open_sentences(layout, open_part, unseen & ~np.asarray(meaningless))
    sentences += [_REPLACEABLE.format(layout.labels[i], layout.labels[j], c) for i, j, c in pairs]
    return Uncertainty(covariance, ~(lost | wide), ~lost, (*sentences, *_vague_sentences(layout, covariance, wide & ~lost)))


_REPLACEABLE = "{} and {} can replace one another (correlation {:+.4f}): neither is determined by itself"


def _replaceable(layout: Layout, A: np.ndarray, lost: np.ndarray) -> list[tuple[int, int, float]]:
    """Pairs of unknowns that are correlated by more than `_ALIKE` while all values with a prior, as stated ones and the steps
    of a law, are fixed, with the correlation."""
    known = np.isin(np.arange(layout.unknowns), layout.prior.at)
    own = np.flatnonzero(~lost & ~known)
    C = _decomposed(A[np.ix_(own, own)])[0] if len(own) else np.zeros((0, 0))
    spread = np.sqrt(np.maximum(np.diag(C), 1e-300))
    C = np.triu(C / np.outer(spread, spread), 1)
    return [(int(own[i]), int(own[j]), float(C[i, j])) for i, j in np.argwhere(np.abs(C) > _ALIKE)]


def ends(study: Study, layout: Layout, x: np.ndarray, length: float) -> tuple[np.ndarray, list[str]]:
    """Mask of the unknown places and widths at an end of their range, or of a span that covers the whole cable, and sentences
    on the latter; ``x``: the unknown numbers."""
    slots, lost, said = {slot.name: slot for slot in layout.slots}, np.zeros(layout.unknowns, bool), []
    for place, effect in enumerate(study.effects):
        names = {p: study.unknown_of(place, p) for p in ("position", "width")}
        own = {p: slots[name] for p, name in names.items() if name in slots}
        values = {p: slot.value(x[slot.at : slot.at + slot.size]) for p, slot in own.items()}
        at, width = (np.ravel(values.get(p, effect.parameters.get(p, np.nan))) for p in ("position", "width"))
        covers = bool(np.all(np.abs(at - length / 2) <= (width - length) / 2))
        for slot in own.values():
            here = np.arange(slot.at, slot.at + slot.size)
            lost[here] |= covers | (x[here] <= np.array(slot.low)) | (x[here] >= np.array(slot.high))
        if covers and own:
            said.append(f"the span of {effect.kind} covers the whole cable: its place and width are not determined")
    return lost, said


def _decomposed(A: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Inverse of a precision (b, b) in the directions that are determined, the others (b, k), and the mask of entries
    without influence on any residual."""
    scale = np.sqrt(np.maximum(np.diag(A), 0.0))
    hidden = scale <= UNSEEN * np.max(scale)
    seen = np.flatnonzero(~hidden)
    inverse, scale = np.zeros_like(A, dtype=float), scale[seen]
    values, vectors = np.linalg.eigh(A[np.ix_(seen, seen)] / np.outer(scale, scale))
    closed = values > _OPEN**2 * np.max(values, initial=1e-300)
    inverse[np.ix_(seen, seen)] = (vectors[:, closed] / values[closed]) @ vectors[:, closed].T / np.outer(scale, scale)
    open_part = np.zeros((len(A), int(np.sum(~closed))))
    open_part[seen] = vectors[:, ~closed] / scale[:, None]
    return inverse, open_part, hidden


def _involved(directions: np.ndarray) -> np.ndarray:
    """Mask of the entries that contribute to any of the unidentifiable directions (b, k)."""
    weight = np.abs(directions)
    return np.any(weight > _PART * weight.max(axis=0, initial=0.0), axis=1)


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
