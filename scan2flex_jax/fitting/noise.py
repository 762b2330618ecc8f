"""The noise of measured curves: covariance of a white and a correlated part, as stated, or shown by the points.

Covariance of one normal component of one pose: ``sw^2 I + sc^2 k(|s - s'|/l)``, ``k`` a Matern kernel of smoothness 3/2; its
sizes are estimated with those of the whole model (`posterior.likelihood`).
Reference: Rasmussen and Williams, "Gaussian Processes for Machine Learning" (2006), eq. 4.17.
"""

from dataclasses import dataclass

import numpy as np

from scan2flex_jax.study.facts import point_noise

FINEST = 1e-5  # of the length: least noise of a sensor
USUAL = 1e-3  # of the length: that by which poses are weighed whose noise is not known
_ALONE = 1.1  # times that: no other part counts


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
    shown = [pose.noise for pose in study.fit_poses if pose.seen]
    stated = [noise for noise in shown if noise is not None]
    missing = len(stated) < len(shown) if of_all else False
    return None if missing or not stated else float(np.sqrt(np.mean(np.square(stated))))


def metre_noise(study, pose, length: float) -> float:
    """Standard deviation (m) by which a pose is weighed: its stated noise if all poses state theirs that show points, else a
    thousandth of the ``length`` (m) of the cable. Readings in other units are scaled to it."""
    stated = stated_noise(study)
    return USUAL * length if stated is None else pose.noise or stated


def noise_ratio(study, study_poses) -> np.ndarray | None:
    """The stated noise of poses over that pooled over the fitted ones, 1 for those that state none; None where all are 1."""
    pooled = stated_noise(study, of_all=False)
    ratio = np.array([1.0 if pose.noise is None or not pooled else pose.noise / pooled for pose in study_poses])
    return None if np.allclose(ratio, 1.0) else ratio


def sensor_noise(study) -> float:
    """White noise (m) of the fitted curves: the median over poses; infinite if they do not show it."""
    shown = [white_noise(pose) for pose in study.fit_poses if pose.seen]
    return float(np.median(shown)) if shown else np.inf


def white_noise(pose) -> float:
    """Standard deviation (m) of the white noise of a coordinate of a measured curve: stated, or from its points; infinite if
    unknown."""
    if pose.noise is not None:
        return pose.noise
    return np.inf if pose.curve is None else point_noise(pose.curve.points)
