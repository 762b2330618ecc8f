"""Moment laws along the curvature vector: `m_b = EI k g(|k|^2)` for bending, `m_3 = GJ kappa_3` for twist.

The rod needs the inverse, `k = m_b / (EI g(u))` where `u = |k|^2` solves `u g(u)^2 = w`, `w = |m_b|^2 / EI^2`. In `u`
and `w` all is smooth at zero, so that derivatives (and complex steps) are exact there.
"""

from dataclasses import dataclass, replace

import numpy as np

ITERATIONS = 30  # Newton for k; it is monotone, and ends after 5 to 8


class Law:
    """`g` of the squared curvature `u`, and its derivative."""

    def g(self, u):
        raise NotImplementedError

    def pick(self, poses):
        """The law of some poses only."""
        return self

    def __call__(self, M, part, compliance):
        return invert(self, M, 1 / compliance[part, 0, 0], compliance[part, 2, 2])


@dataclass
class Slip(Law):
    """Stick and slip: `g = ratio + (1 - ratio) / sqrt(1 + u / k_s^2)`, `k_s` (1/m) the slip curvature."""

    slip: complex
    ratio: complex

    def g(self, u):
        root = np.sqrt(1 + u / self.slip**2)
        return self.ratio + (1 - self.ratio) / root, -(1 - self.ratio) / (2 * self.slip**2 * root**3)


@dataclass
class Friction(Law):
    """A moment `M_f` (N m) that opposes the approach: `g = 1 + sign M_f / (EI sqrt(u + k_s^2))`, one sign per pose."""

    excess: complex  # M_f / EI, 1/m
    scale: float  # k_s, 1/m: the curvature over which friction sets in
    sign: np.ndarray  # (P, 1)

    def g(self, u):
        root = np.sqrt(u + self.scale**2)
        return 1 + self.sign * self.excess / root, -0.5 * self.sign * self.excess / root**3

    def pick(self, poses):
        return replace(self, sign=self.sign[poses])


def invert(law, M, EI, twist):
    """Curvature from the material moment, and its derivative."""
    w = (M[..., 0] ** 2 + M[..., 1] ** 2) / EI**2
    k, goal = np.zeros(w.shape), np.sqrt(np.maximum(w.real, 0))
    for _ in range(ITERATIONS):
        g, dg = (x.real for x in law.g(k * k))
        step = (goal - k * g) / (g + 2 * k * k * dg)
        k = np.maximum(k + step, 0)
        if np.abs(step).max() < 1e-12 * (1 + goal.max()):
            break
    u = k * k
    for _ in range(2):
        g, dg = law.g(u)
        u = u - (u * g * g - w) / (g * g + 2 * u * g * dg)
    g, dg = law.g(u)
    c = 1 / (EI * g)
    kappa = np.stack([M[..., 0] * c, M[..., 1] * c, M[..., 2] * twist], axis=-1)
    slope = -2 * dg / (EI**3 * g**2 * (g * g + 2 * u * g * dg))
    D = np.zeros((*M.shape, 3), kappa.dtype)
    D[..., :2, :2] = slope[..., None, None] * M[..., :2, None] * M[..., None, :2]
    D[..., 0, 0] += c
    D[..., 1, 1] += c
    D[..., 2, 2] = twist
    return kappa, D
