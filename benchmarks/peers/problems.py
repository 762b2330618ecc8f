"""The problem of every program: a cable, its clamps, and the generic start of this package, from which all may start.

The cable is the simulated one of the paper: 1 m, EI 0.1, GJ 0.25 N m^2, 0.2 kg/m, shear and axial stiffness 1e5 N, straight
when free of stress. `level` hangs between clamps 0.6 m apart; `twisted` has its end 0.2 m aside and turned by 90 degrees
about the tangent; `cantilever` is clamped horizontally at its start only (weight L^3 / EI = 19.6: it drops by 0.83 L).
Frames are matrices with columns d1, d2, d3, d3 the tangent of an unsheared cable; lengths in m, forces in N.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.curves import arc_lengths, carried
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.model import Configuration
from scan2flex_jax.statics.starts import sagging_start

GRAVITY = 9.81  # m/s^2, along -z
START_FRAME = np.array([[0.0, 0, 1], [0.0, -1, 0], [1.0, 0, 0]]).T  # d1 = +z, d2 = -y, d3 = +x
_SAMPLES = 400  # elements of the start


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


def generic_start(problem: Problem, length) -> Configuration:
    """The generic start of this package for a cable ``length`` m long: it sags between the clamps, or is straight."""
    end = None if problem.free else (problem.end, problem.end_frame)
    boundary = Boundary.of((np.zeros(3), problem.start_frame), end)
    return sagging_start(boundary, length, jnp.array([0.0, 0.0, -GRAVITY]), elements=_SAMPLES)


def start_at(problem: Problem, s) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n, 3) and frames (n, 3, 3) of that start at arc lengths ``s`` (m)."""
    start = generic_start(problem, problem.length)
    at = np.asarray(s) / problem.length * _SAMPLES
    points = np.stack([np.interp(at, np.arange(_SAMPLES + 1), x) for x in np.asarray(start.r).T], axis=1)
    return points, np.asarray(start.R)[np.rint(at).astype(int)]


def start_chain(problem: Problem, links: int) -> tuple[float, np.ndarray, np.ndarray]:
    """Link length ds (m), vertices (n + 1, 3) and frames (n, 3, 3) of a chain on such a start, all links equally long.

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
    length, curve_of = problem.length, jax.jit(lambda length: generic_start(problem, length).r)
    for _ in range(30):
        curve = np.asarray(curve_of(length))
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
