"""The noise of measured curves: covariance of a white and a correlated part, as stated, or shown by the points.

Covariance of one normal component of one pose: ``sw^2 I + sc^2 k(|s - s'|/l)``, ``k`` a Matern kernel of smoothness 3/2; its
sizes are estimated with those of the whole model (`inference.likelihood`).
Reference: Rasmussen and Williams, "Gaussian Processes for Machine Learning" (2006), eq. 4.17.
"""

from dataclasses import dataclass

import numpy as np

from scan2flex_jax.fitting.distance import NORMALS

FINEST = 1e-5  # of the length: least noise of a sensor
_ALONE = 1.1  # times that: no other part counts
_NEIGHBOURS = np.array([-2, -1, 1, 2])  # of a point, that predict it
_TINY = 1e-300


@dataclass(frozen=True)
class Noise:
    """Standard deviations of one normal component (m) of the white and the correlated part, and its length (m)."""

    white: float
    correlated: float
    correlation_length: float

    @property
    def total(self) -> float:
        """Standard deviation of one normal component (m)."""
        return float(np.hypot(self.white, self.correlated))

    def assumed(self, length: float) -> bool:
        """Whether it is no more than that of the finest sensor assumed for this ``length`` (m): the data show less."""
        return self.total <= _ALONE * FINEST * length

    def to_json(self) -> dict:
        """As in the study format (m)."""
        return {"white": self.white, "correlated": self.correlated, "correlation_length": self.correlation_length}

    def covariance(self, s: np.ndarray) -> np.ndarray:
        """Covariance (m^2) at arc lengths ``s`` (m) of one pose."""
        return self.white**2 * np.eye(len(s)) + self.correlated**2 * matern(s, self.correlation_length)


def matern(s: np.ndarray, length: float) -> np.ndarray:
    """Matern correlation of smoothness 3/2 of arc lengths ``s`` (m)."""
    a = np.sqrt(3.0) * np.abs(s[:, None] - s[None, :]) / length
    return (1.0 + a) * np.exp(-a)


def stated_noise(study, of_all: bool = True) -> float | None:
    """The stated noise (m, one coordinate), pooled over the fitted poses; None if not all of them state it, or not ``of_all``
    but none does."""
    stated = [pose.noise for pose in study.fit_poses if pose.noise is not None]
    missing = len(stated) < len(study.fit_poses) if of_all else not stated
    return None if missing else float(np.sqrt(np.mean(np.square(stated))))


def sensor_noise(study) -> float:
    """White noise (m) of the fitted curves: the median over poses; infinite if they do not show it."""
    return float(np.median([white_noise(pose) for pose in study.fit_poses]))


def white_noise(pose) -> float:
    """Standard deviation (m) of the white noise of a coordinate of a measured curve: stated, or from its points.

    Each point is compared with the cubic through two neighbours on either side over the chords between them, across the curve
    only: along it, uneven distances between points would count as noise. Bends between the points raise it, so that a curve of
    few points casts no doubt; noise above the distance of points is found up to 20 % too small. Infinite if unknown.
    """
    if pose.noise is not None:
        return pose.noise
    if pose.curve is None:
        return np.inf
    points = np.asarray(pose.curve.points)
    apart = np.linalg.norm(np.diff(points, axis=0), axis=1)
    points = points[np.r_[True, apart > 0]]  # repeated points say nothing of the noise
    if len(points) < len(_NEIGHBOURS) + 1:
        return np.inf
    s = np.r_[0.0, np.cumsum(apart[apart > 0])]
    middle = np.arange(2, len(points) - 2)
    near = middle[:, None] + _NEIGHBOURS
    d = s[near] - s[middle, None]
    others = [np.delete(np.arange(len(_NEIGHBOURS)), k) for k in range(len(_NEIGHBOURS))]
    weight = np.stack([np.prod(d[:, o] / (d[:, o] - d[:, [k]]), axis=1) for k, o in enumerate(others)], axis=1)  # Lagrange's
    off = points[middle] - np.einsum("nk,nkc->nc", weight, points[near])
    along = points[near[:, -1]] - points[near[:, 0]]
    across = np.linalg.norm(off, axis=1) ** 2 - np.sum(off * along, axis=1) ** 2 / np.maximum(np.sum(along**2, axis=1), _TINY)
    return float(np.sqrt(np.mean(np.maximum(across, 0.0) / (NORMALS * (1.0 + np.sum(weight**2, axis=1))))))
