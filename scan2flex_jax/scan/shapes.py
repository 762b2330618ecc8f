"""Known centre curves for simulated scans: shapes independent of the rod model.

An extraction tested on rods only may be biased towards rods. These curves are pure geometry: a random smooth space
curve, a loop, a helix, and a figure of eight whose two strands nearly touch where they cross.

Symbols: ``L`` length (m), ``r`` radius of the cable around the curve (m), ``s`` arc length (m). Every function returns
points equally spaced in ``s``, centred near the origin.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.spatial.distance import cdist

from scan2flex_jax.scan.spline import arc_length

SAMPLES = 801
_FINE = 6001

Curve = Float[np.ndarray, "n 3"]


def resample(points: Curve, count: int = SAMPLES) -> Float[np.ndarray, "count 3"]:
    """``count`` points at equal arc length on the cubic spline through ``points``."""
    s = arc_length(points)
    for _ in range(2):  # the chord length is not yet the arc length: once more on the fine curve
        spline = CubicSpline(s, points)
        points = spline(np.linspace(0.0, s[-1], _FINE))
        s = arc_length(points)
    return CubicSpline(s, points)(np.linspace(0.0, s[-1], count))


def _of_length(points: Curve, length: float) -> Float[np.ndarray, "m 3"]:
    """The curve scaled to ``length`` and centred."""
    points = resample(points)
    points = points * (length / arc_length(points)[-1])
    return points - points.mean(axis=0)


def helix(length: float, radius: float, turns: float = 2.0) -> Curve:
    """A helix of ``turns`` turns whose pitch leaves at least four radii between the strands."""
    pitch = max(4.0 * radius, 0.4 * length / turns)
    across = np.sqrt(max((length / turns) ** 2 - pitch**2, (0.3 * length / turns) ** 2)) / (2.0 * np.pi)
    a = 2.0 * np.pi * turns * np.linspace(0.0, 1.0, _FINE)
    return _of_length(np.stack([across * np.cos(a), across * np.sin(a), pitch * a / (2.0 * np.pi)], axis=1), length)


def loop(length: float, radius: float) -> Curve:
    """Straight in, once around, straight out, with three radii between the strands that pass each other."""
    a = np.linspace(0.0, 1.0, _FINE)
    turn = 2.0 * np.pi * 0.5 * (1.0 + np.tanh(6.0 * (a - 0.5)) / np.tanh(3.0))
    heading = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    plane = np.cumsum(heading, axis=0) * (length / _FINE)
    lift = 1.5 * radius * np.tanh(5.0 * (a - 0.5)) * 2.0
    return _of_length(np.column_stack([plane, lift]), length)


def figure_of_eight(length: float, radius: float, clearance: float = 0.3) -> Curve:
    """An open figure of eight: a left turn, a right turn, and two crossings with ``clearance`` radii between the surfaces."""
    u = np.linspace(0.0, 1.0, _FINE)

    def rises(at):
        return 0.5 * (1.0 + np.tanh((u - at) / 0.03))

    curvature = rises(0.13) - 2.0 * rises(0.5) + rises(0.87)
    heading = np.cumsum(curvature) / _FINE * (1.6 * np.pi / 0.37)
    plane = np.cumsum(np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0) * (length / _FINE)
    lift = (2.0 + clearance) * radius * np.cos(np.pi * u)
    return _of_length(np.column_stack([plane, lift]), length)


def random_smooth(length: float, radius: float, key: int = 0) -> Curve:
    """A random space curve: two curvatures made of four harmonics, never closer to itself than 2.6 radii."""
    rng = np.random.default_rng([17, key])
    for _ in range(200):
        points = _from_curvatures(length, rng.normal(size=(2, 2, 4)))
        if _closest_approach(points, radius) > 2.6 * radius and _largest_curvature(points) * radius < 0.35:
            return _of_length(points, length)
    raise ValueError(f"no random curve of length {length} m is free of contact at radius {radius} m")


def _from_curvatures(length: float, weights: Float[np.ndarray, "2 2 4"]) -> Curve:
    """Integrate a rotation-minimising frame with random curvatures of 3.5/L RMS in all."""
    u = np.linspace(0.0, 1.0, SAMPLES)
    waves = 2.0 * np.pi * np.arange(4)[:, None] * u / 1.6
    falling = weights / (1.0 + np.arange(4))
    kappa = np.einsum("ak,kn->an", falling[:, 0], np.cos(waves)) + np.einsum("ak,kn->an", falling[:, 1], np.sin(waves))
    kappa *= 3.5 / np.sqrt(np.mean(np.sum(kappa**2, axis=0)))
    frame, points, h = np.eye(3), [np.zeros(3)], 1.0 / (SAMPLES - 1)
    for k1, k2 in kappa[:, :-1].T:
        t = frame[2] + h * (k1 * frame[0] + k2 * frame[1])
        t /= np.linalg.norm(t)
        points.append(points[-1] + 0.5 * h * (frame[2] + t))
        d1 = frame[0] - (frame[0] @ t) * t
        d1 /= np.linalg.norm(d1)
        frame = np.stack([d1, np.cross(t, d1), t])
    return np.array(points) * length


def _closest_approach(points: Curve, radius: float) -> float:
    """Smallest distance (m) between points further apart than pi r along the curve."""
    coarse = points[::8]
    s = arc_length(coarse)
    far = np.abs(s[:, None] - s[None]) > np.pi * 2.0 * radius
    return float(np.min(np.where(far, cdist(coarse, coarse), np.inf)))


def _largest_curvature(points: Curve) -> float:
    """Largest curvature (1/m) of a curve sampled evenly."""
    h = arc_length(points)[1]
    return float(np.max(np.linalg.norm(np.diff(points[::4], 2, axis=0), axis=1)) / (4 * h) ** 2)


FAMILIES: dict[str, Callable[[float, float], Curve]] = {
    "random": random_smooth,
    "loop": loop,
    "helix": helix,
    "figure of eight": figure_of_eight,
}
