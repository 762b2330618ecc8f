"""Discrepancy fields: nonparametric descriptions of a residual that no effect type explains, one per family of physics.

A discrepancy field is a Gaussian process along the cable (or per pose) with one amplitude ``a`` and no candidate site. With
``Z = U diag(d) V'`` its whitened columns, projected off the base columns, its log marginal likelihood over the base model is

    max_a  sum_i 1/2 (u_i' y)^2 a^2 d_i^2/(1 + a^2 d_i^2) - 1/2 log(1 + a^2 d_i^2).

Such a field describes the residual without naming its cause, and one that differs between poses predicts no other pose.
Reference: Girolami et al., "The statistical finite element method" (2021).
"""

from dataclasses import dataclass
from typing import get_args

import numpy as np

from scan2flex_jax.effects.curvature_profile import CurvatureProfile
from scan2flex_jax.effects.distributed_load import DistributedLoad
from scan2flex_jax.effects.entry import Varied
from scan2flex_jax.geometry.fields import POINTS, smooth_root

_AMPLITUDES = np.geomspace(0.05, 300.0, 28)  # of a times the largest d
POSE_LOADS = "pose loads"  # may imitate contact and much else: it describes, and never replaces an effect
WORDS = {
    "curvature": "a natural curvature that varies along the cable",
    "load": "a load that varies along the cable, the same in every pose",
    POSE_LOADS: "loads that differ from pose to pose",
    "stiffness": "a stiffness that varies along the cable",
    "mass": "a mass per length that varies along the cable",
}


@dataclass(frozen=True)
class Described:
    """A discrepancy field reported where no effect explains the residual: the ``parameter`` (``unit``) of an effect at `POINTS`
    positions, three components each."""

    effect: type[CurvatureProfile] | type[DistributedLoad]
    parameter: str
    unit: str


DESCRIBED = {
    "curvature": Described(CurvatureProfile, "curvature", "1/m"),
    "load": Described(DistributedLoad, "force", "N/m"),
}


@dataclass(frozen=True)
class Family:
    """One discrepancy field: ``U`` (n, k) and ``d`` (k,) of its projected columns."""

    name: str
    U: np.ndarray
    d: np.ndarray

    def gain(self, Y: np.ndarray) -> np.ndarray:
        """Log evidence over the base model for each column of ``Y``, at the most likely amplitude."""
        return np.maximum(best_amplitude(self.U, self.d, Y)[1], 0.0)


def best_amplitude(U: np.ndarray, d: np.ndarray, Y: np.ndarray):
    """The most likely amplitude of a field for ``Y`` (n,) or each column of (n, B), and its log evidence over no field."""
    grid = _AMPLITUDES / max(d[0], 1e-300)
    t = (grid[:, None] * d) ** 2
    values = (0.5 * (t / (1 + t)) @ (U.T @ Y) ** 2).T - 0.5 * np.sum(np.log1p(t), axis=1)
    return grid[np.argmax(values, axis=-1)], values.max(axis=-1)


def family_of(name: str, columns: np.ndarray, base: np.ndarray, mix: np.ndarray | None = None) -> Family:
    """From whitened columns (n, k); ``mix`` is a root of their prior covariance."""
    Z = columns if mix is None else columns @ mix
    Z = Z - base @ (base.T @ Z)
    U, d, _ = np.linalg.svd(Z, full_matrices=False)
    keep = d > 1e-6 * max(d[0], 1e-300)
    return Family(name, U[:, keep], d[keep])


def discrepancy_columns(bench, vector, start) -> dict:
    """Columns (m, 3, K) per pose of the curvature and load fields."""
    return {name: bench.field_columns(vector, d.effect, (POINTS, 3), start) for name, d in DESCRIBED.items()}


def families(white, fields, columns, owner, components, base) -> list[Family]:
    """All discrepancy fields, from their columns and those of the catalogue's narrowest spans (sites with a width)."""
    root = smooth_root(POINTS, 3)
    curvature, load = white.stack(fields["curvature"]), white.stack(fields["load"])
    per_pose = np.concatenate([load * _only(rows, len(load)) for rows in white.rows], axis=1)
    out = [family_of("curvature", curvature, base, root), family_of("load", load, base, root)]
    out.append(family_of(POSE_LOADS, per_pose, base, np.kron(np.eye(len(white.rows)), root)))
    for name in get_args(Varied):
        widths = {k: float(c.site["width"]) for k, c in enumerate(components) if c.entry.varies == name and "width" in c.site}
        keep = np.isin(owner, [k for k, width in widths.items() if np.isclose(width, min(widths.values()))])
        out.append(family_of(name, columns[:, keep], base, smooth_root(int(keep.sum()), 1)))
    return out


def _only(rows, n):
    mask = np.zeros((n, 1))
    mask[rows] = 1.0
    return mask
