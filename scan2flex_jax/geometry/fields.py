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


def hats(t: Float[Array | np.ndarray, " n"], points: int) -> Float[Array | np.ndarray, "n points"]:
    """Hat functions (-) of ``points`` points at ``t`` (-); numpy for numpy input, traced for traced input."""
    away: Any = t[:, None] * (points - 1) - np.arange(points)
    return (1.0 - abs(away)).clip(min=0.0)


def smooth_root(points: int, per_point: int) -> Float[np.ndarray, "k k"]:
    """Root of the covariance of a random field of unit size on ``points`` points with ``per_point`` independent components."""
    t = np.linspace(0, 1, points)
    K = np.exp(-0.5 * ((t[:, None] - t) / SMOOTH) ** 2) + 1e-6 * np.eye(points)
    return np.kron(np.linalg.cholesky(K), np.eye(per_point))
