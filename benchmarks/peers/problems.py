"""The problem of every program: a cable, its clamps, and the generic curve that a solve may start from.

The cable is the simulated one of the paper: 1 m, EI 0.1, GJ 0.25 N m^2, 0.2 kg/m, shear and axial stiffness 1e5 N, straight
when free of stress. `level` hangs between clamps 0.6 m apart; `twisted` has its end 0.2 m aside and turned by 90 degrees
about the tangent; `cantilever` is clamped horizontally at its start only (weight L^3 / EI = 19.6: it drops by 0.83 L).
Frames are matrices with columns d1, d2, d3, d3 the tangent of an unsheared cable; lengths in m, forces in N.
"""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.curves import arc_lengths, carried

GRAVITY = 9.81  # m/s^2, along -z
START_FRAME = np.array([[0.0, 0, 1], [0.0, -1, 0], [1.0, 0, 0]]).T  # d1 = +z, d2 = -y, d3 = +x
_SAMPLES = 401  # of the start curve


class Problem(NamedTuple):
    """One cable in one pose. ``end`` (m) and ``end_frame`` are None for a free end; the start clamp is at the origin."""

    name: str
    end: np.ndarray | None = None
    end_frame: np.ndarray | None = None
    start_frame: np.ndarray = START_FRAME
    length: float = 1.0
    density: float = 0.2  # kg/m
    bending: float = 0.1  # N m^2
    torsion: float = 0.25  # N m^2
    stretching: float = 1.0e5  # N, shear as well

    @property
    def free(self) -> bool:
        """Whether the end is free."""
        return self.end is None

    @property
    def weight(self) -> float:
        """Weight per length (N/m)."""
        return GRAVITY * self.density

    @property
    def slowest(self) -> float:
        """Rough angular frequency (rad/s) of the slowest mode, by which relaxation codes choose their damping."""
        number = 1.875 if self.free else 4.730  # of a straight beam, clamped-free or clamped-clamped
        return number**2 / self.length**2 * float(np.sqrt(self.bending / self.density))


class Solution(NamedTuple):
    """Points (n, 3) m at arc lengths ``s`` (n,) m; processor ``seconds`` up to here, if not those of the whole solve."""

    s: np.ndarray
    points: np.ndarray
    facts: dict
    seconds: float | None = None


PROBLEMS = {
    p.name: p
    for p in (
        Problem("level", np.array([0.6, 0.0, 0.0]), START_FRAME),
        Problem("twisted", np.array([0.6, 0.2, 0.0]), Rotation.from_euler("x", 90, degrees=True).as_matrix() @ START_FRAME),
        Problem("cantilever"),
    )
}


def start_curve(problem: Problem, length: float | None = None) -> np.ndarray:
    """Points (m, 3): straight for a free end, else a cubic Hermite curve with a bump along gravity, ``length`` m long."""
    length = problem.length if length is None else length
    x = np.linspace(0.0, 1.0, _SAMPLES)[:, None]
    first = problem.start_frame[:, 2]
    if problem.free:
        return x * length * first
    reach = 0.5 * length
    base = (x**3 - 2 * x**2 + x) * reach * first + (3 * x**2 - 2 * x**3) * problem.end
    base = base + (x**3 - x**2) * reach * problem.end_frame[:, 2]
    low, high = 0.0, length
    for _ in range(50):  # bisection: the length grows with the depth
        depth = 0.5 * (low + high)
        curve = base - depth * 16 * x**2 * (1 - x) ** 2 * np.array([0.0, 0, 1])
        low, high = (depth, high) if arc_lengths(curve)[-1] < length else (low, depth)
    return curve


def start_at(problem: Problem, s) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 3) and frames (n, 3, 3) of the start curve at arc lengths ``s`` (m).

    Frames are carried along without turning about the tangent; the twist that the end clamp then lacks is spread evenly.
    """
    curve = start_curve(problem)
    along = arc_lengths(curve)
    along *= problem.length / along[-1]
    tangent = np.gradient(curve, along, axis=0)
    tangent[0] = problem.start_frame[:, 2]
    if not problem.free:
        tangent[-1] = problem.end_frame[:, 2]
    frames = _framed(problem, tangent)
    points = np.stack([np.interp(s, along, curve[:, k]) for k in range(3)], axis=1)
    return points, frames[[int(np.argmin(np.abs(along - x))) for x in s]]


def start_chain(problem: Problem, links: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Link length ds (m), vertices (n + 1, 3) and frames (n, 3, 3) of a chain on such a curve, all links equally long.

    Codes with nearly rigid links would otherwise start from stretched ones and throw the cable about. The outer link is centred
    on the clamp, half of it outside: n = links + 1 between clamps; before a free end n = links, ds = L/(links - 1/2).
    """
    ds = problem.length / (links - (0.5 if problem.free else 0.0))
    lead = 0.5 * ds  # of the outer link, inside the cable
    first = problem.start_frame[:, 2]
    inner = problem._replace(length=problem.length - lead * (1 if problem.free else 2))
    if not problem.free:
        last = problem.end_frame[:, 2]
        inner = inner._replace(end=problem.end - lead * (first + last))
    vertices = _polygon(inner, round(inner.length / ds)) + lead * first
    vertices = np.vstack([-lead * first, vertices])
    if not problem.free:
        vertices = np.vstack([vertices, problem.end + lead * last])
    return ds, vertices, _framed(problem, np.diff(vertices, axis=0))


def _polygon(problem, links):
    """Vertices of equal links L/links, inscribed in a curve that is a little longer."""
    length = problem.length
    for _ in range(30):
        curve = start_curve(problem, length)
        along = arc_lengths(curve)
        s = np.linspace(0.0, along[-1], links + 1)
        for _ in range(20):
            vertices = np.stack([np.interp(s, along, curve[:, k]) for k in range(3)], axis=1)
            chord = arc_lengths(vertices)
            s = np.interp(np.linspace(0.0, chord[-1], links + 1), chord, s)
        length *= 1 + 0.7 * (problem.length / chord[-1] - 1)
    return vertices


def end_twist(problem: Problem, tangents) -> float:
    """Angle (rad) by which the end clamp is turned against a frame carried along the tangents; 0 for a free end."""
    if problem.free:
        return 0.0
    tangents = tangents / np.linalg.norm(tangents, axis=1, keepdims=True)
    lack = carried(np.vstack([tangents, problem.end_frame[:, 2]]), problem.start_frame)[-1].T @ problem.end_frame
    return float(np.arctan2(lack[1, 0], lack[0, 0]))


def _framed(problem, tangents):
    """Frames on equally spaced tangents, with the twist towards the end clamp."""
    tangents = tangents / np.linalg.norm(tangents, axis=1, keepdims=True)
    frames = carried(tangents, problem.start_frame)
    if problem.free:
        return frames
    twist = np.linspace(0.0, end_twist(problem, tangents), len(frames))
    return frames @ Rotation.from_euler("z", twist[:, None]).as_matrix()
