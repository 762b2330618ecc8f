"""The discrepancy of a pose: a random deviation from the model that differs from pose to pose and is not sensor noise.

Real cables have strands, friction and a history, and clamps never seat twice alike. Each pose therefore has a random natural
curvature of its own, a Gaussian process along s in material axes, and clamps rotated by random small angles:

    kappa_0(s) ~ b^2 k(|s - s'|/L),    rotation of a clamp ~ (b L SEAT)^2,

so that one size ``b`` (1/m) is estimated for both. The equilibrium maps it to the shape: with the columns ``Z`` (m per unit
of b) along `directions`, the covariance of a pose is that of its sensor plus ``b^2 Z Z'``. It satisfies clamps and balance,
and extrapolates to poses not measured. References: Girolami et al., "The statistical finite element method" (2021);
Sargsyan, Huan and Najm, "Embedded model error representation" (2019).
"""

from dataclasses import dataclass, field
from functools import lru_cache

import equinox as eqx
import numpy as np

from scan2flex_jax.fitting import states
from scan2flex_jax.geometry.fields import POINTS, hats, smooth_root
from scan2flex_jax.geometry.lie import HATS

SEAT = 0.05  # of b L: standard deviation (rad) of the rotation of a clamp


@dataclass(frozen=True)
class Discrepancy:
    """The discrepancy: ``curvature`` (1/m), its size ``b``; ``rms`` (m), its most likely displacement of the points; ``length``
    (m) of the cable. ``columns``: per pose (m, 3, k), in m per 1/m, and ``moved`` (m, 2), the most likely displacement in m
    along the normals; both empty without a discrepancy."""

    curvature: float = 0.0
    length: float = 1.0
    columns: tuple[np.ndarray, ...] = field(default=(), repr=False)
    moved: tuple[np.ndarray, ...] = field(default=(), repr=False)

    @property
    def by_pose(self) -> np.ndarray:
        """RMS displacement (m) of each pose."""
        return np.array([np.sqrt(np.mean(np.sum(d**2, axis=1))) for d in self.moved])

    @property
    def rms(self) -> float:
        """RMS displacement (m) over all poses; 0 without a discrepancy."""
        return float(np.sqrt(np.mean(self.by_pose**2))) if self.curvature and self.moved else 0.0

    @property
    def relative(self) -> float:
        """The same over the length of the cable."""
        return self.rms / self.length

    def to_json(self) -> dict:
        """As in the study format."""
        return {"rms": self.rms, "relative": self.relative, "curvature": self.curvature}


@lru_cache
def _curvatures(elements: int) -> np.ndarray:
    """Natural curvature (k, elements, 3) of the elements for each independent component of the unit field."""
    middles = (np.arange(elements) + 0.5) / elements
    field = smooth_root(POINTS, 3).T.reshape(-1, POINTS, 3)
    return np.einsum("ep,kpc->kec", hats(middles, POINTS), field)


def directions(state: states.State) -> states.State:
    """Tangents of a state on a leading axis: those of the unit curvature field, then those of the clamps."""
    section, boundary = state.rod.section, state.rod.boundary
    elements = len(np.asarray(section.s))
    length = float(section.ds) * elements
    field, held = _curvatures(elements), np.asarray(boundary.held)[:, 3:]
    count = len(field) + held.size
    natural = np.zeros((count, elements, 6))
    natural[: len(field), :, 3:] = field
    rotation = np.zeros((count, 2, 3, 3))
    for k, (end, axis) in enumerate(np.ndindex(2, 3)):
        turn = SEAT * length * held[end, axis] * np.asarray(boundary.rotation)[end] @ HATS[axis]
        rotation[len(field) + k, end] = turn
    still = states.still(state, count)
    return eqx.tree_at(lambda t: (t.rod.section.natural, t.rod.boundary.rotation), still, (natural, rotation))




def most_likely_part(curvature: float, columns: np.ndarray, residual: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """The most likely displacement (m, 2) along the normals, given a residual (m, 2) with noise of ``covariance`` (m, m): the
    posterior mean of the Gaussian process (Rasmussen and Williams 2006, eq. 2.25)."""
    factor = np.linalg.cholesky(covariance)
    Z = curvature * columns[:, :2]
    m, _, k = Z.shape
    white = np.linalg.solve(factor, np.concatenate([residual[:, :2, None], Z], axis=-1).reshape(m, -1)).reshape(2 * m, k + 1)
    weights = np.linalg.solve(np.eye(k) + white[:, 1:].T @ white[:, 1:], white[:, 1:].T @ white[:, 0])
    return Z @ weights


def usual_size(configurations, share: float) -> float:
    """Usual size ``b`` (1/m): a ``share`` of the curvature of the poses."""
    r, R = np.asarray(configurations.r), np.asarray(configurations.R)
    ds = np.linalg.norm(np.diff(r, axis=1), axis=2)
    bend = np.linalg.norm(np.cross(R[:, :-1, :, 2], R[:, 1:, :, 2]), axis=2)
    return share * max(float(np.sqrt(np.mean((bend / ds) ** 2))), 1e-3 / float(np.sum(ds[0])))
