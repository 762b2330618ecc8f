"""Fields along the cable, given at evenly spaced points from one end to the other.

Between the points a field is linear, a sum of hat functions. A smooth random field has a Gaussian-process prior with
the squared-exponential kernel ``exp(-(t - t')^2/(2 SMOOTH^2))``. Symbol: ``t = s/L`` (-), relative arc length.
"""

from typing import Any

import numpy as np
from jax import Array
from jaxtyping import Float

POINTS = 9  # of a random field
SMOOTH = 0.2  # correlation length, relative to the cable's length
TREND, WAVES, WIDE = 3.0, 0.5, 0.25  # of a field that is zero in the middle: standard deviation of its even growth to an end,
#                                      and that and the correlation length of the waves about it


def hats(t: Float[Array | np.ndarray, " n"], points: int) -> Float[Array | np.ndarray, "n points"]:
    """Hat functions (-) of ``points`` points at ``t`` (-); numpy for numpy input, traced for traced input."""
    away: Any = t[:, None] * (points - 1) - np.arange(points)
    return (1.0 - abs(away)).clip(min=0.0)


def smooth_root(points: int, per_point: int) -> Float[np.ndarray, "k k"]:
    """Root of the covariance of a random field of unit size on ``points`` points with ``per_point`` independent components."""
    t = np.linspace(0, 1, points)
    K = np.exp(-0.5 * ((t[:, None] - t) / SMOOTH) ** 2) + 1e-6 * np.eye(points)
    return np.kron(np.linalg.cholesky(K), np.eye(per_point))


def middle_root(t: Float[np.ndarray, " k"]) -> Float[np.ndarray, "k k"]:
    """Root of the covariance at places ``t`` (-) of a random field that is zero in the middle: even growth from end to end, of
    standard deviation `TREND` at both, and the difference to the middle of a field of `WAVES` with the Matern kernel of order
    3/2, since things have steps as well."""
    u = 2.0 * np.asarray(t, float) - 1.0
    bell, middle = _matern(t[:, None] - t), _matern(0.5 * u)
    K = TREND**2 * np.outer(u, u) + WAVES**2 * (bell - middle[:, None] - middle + 1.0)
    return np.linalg.cholesky(K + 1e-9 * np.eye(len(t)))


def _matern(lag):
    """Correlation (-) of the waves at two places so far (-) from one another."""
    d = np.sqrt(3.0) * np.abs(lag) / WIDE
    return (1.0 + d) * np.exp(-d)
