"""A cable in its poses, and how it becomes the fields of the rod equations.

`Scene` holds what is true of the cable and its clamps before any effect; `Parts` is the form that effects change: plain
numbers and arrays, rebound and never written in place, so that complex numbers (derivatives) pass through.
Units: m, kg, N, rad. Sample points `s` are nodes and midpoints of the mesh, `2 N + 1` of them.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from . import quaternions as qt
from . import rod

EDGE = 0.02  # of L: the edges of a span are smoothed over this length


RIGID = 1e9  # N: GA and EA that change a length by less than 1e-7 under a cable's weight; a study does not state them


@dataclass
class Cable:
    length: float
    radius: float
    density: float  # kg/m
    bending: float  # EI, N m^2
    torsion: float  # GJ, N m^2
    shear: float = 1e5  # GA, N
    axial: float = 1e5  # EA, N


@dataclass
class Scene:
    cable: Cable
    gravity: np.ndarray
    start: tuple  # positions (P, 3), quaternions (P, 4)
    end: tuple
    end_kind: np.ndarray  # rod.CLAMP, BALL or FREE

    def pick(self, poses):
        start, end = tuple(v[poses] for v in self.start), tuple(v[poses] for v in self.end)
        return Scene(self.cable, self.gravity, start, end, self.end_kind[poses])


class Parts:
    """What effects change; the null values of all of them."""

    def __init__(self, scene, sigma, length):
        cable, n = scene.cable, 2 * len(sigma) - 1
        self.sigma, self.length, self.cable, self.gravity = sigma, length, cable, scene.gravity
        self.nodes = length * sigma
        self.s = np.interp(np.arange(n), np.arange(0, n, 2), sigma) * length
        self.bend, self.twist, self.density = np.ones(n), np.ones(n), np.ones(n)  # factors
        self.natural, self.line = np.zeros((1, n, 3)), np.zeros((1, n, 3))
        self.ratio, self.angle, self.coupling = 1.0, 0.0, np.zeros(2)
        self.slip, self.friction, self.axial = None, None, 1 / cable.axial
        self.force, self.couple = (np.zeros((1, len(sigma), 3)) for _ in range(2))
        self.tethers, self.planes = [], []
        self.turn = [np.zeros((1, 3)), np.zeros((1, 3))]  # of the clamps, in their own frames
        self.shift = [np.zeros((1, 3)), np.zeros((1, 3))]
        self.grip = [0.0, 0.0]
        self.scale, self.offset = 1.0, np.zeros(3)

    def step(self, at):
        """Smooth step from 0 to 1 around `at`, over `EDGE` L."""
        t = (self.s - at) / (EDGE * self.length) + 0.5
        t = np.where(t.real <= 0, 0, np.where(t.real >= 1, 1, t))
        return t * t * (3 - 2 * t)

    def box(self, position, width):
        """One inside the span, zero outside; its integral is `width`."""
        return self.step(position - width / 2) - self.step(position + width / 2)

    def hat(self, position):
        """Weights that hang a point load on the two nodes beside it (on one, when the mesh has a node there)."""
        i = int(np.clip(np.searchsorted(self.nodes.real, np.real(position)) - 1, 0, len(self.nodes) - 2))
        x = (position - self.nodes[i]) / (self.nodes[i + 1] - self.nodes[i])
        w = np.zeros(len(self.nodes), np.asarray(x).dtype)
        w[i], w[i + 1] = 1 - x, x
        return w

    def compliance(self):
        """Inverse of K_Omega at the sample points."""
        EI, GJ = self.cable.bending, self.cable.torsion
        b = np.stack([-np.sin(self.angle), np.cos(self.angle)])
        c = np.sqrt(EI * GJ) * np.asarray(self.coupling)
        K = np.zeros((len(self.s), 3, 3), np.result_type(b, c, EI, GJ, self.ratio, self.bend, self.twist))
        plane = EI * (np.eye(2) + (self.ratio - 1) * b[:, None] * b)
        K[:, :2, :2] = self.bend[:, None, None] * plane
        K[:, 2, 2] = GJ * self.twist
        K[:, :2, 2] = K[:, 2, :2] = c
        return np.linalg.inv(K)

    def clamp(self, scene, end):
        position, quaternion = (scene.start, scene.end)[end]
        return position + qt.rotate(quaternion, self.shift[end]), qt.product(quaternion, qt.exp(self.turn[end]))

    def fields(self, scene):
        load = self.cable.density * self.density[:, None] * self.gravity + self.line
        return rod.Fields(
            self.sigma, self.length, self.compliance(), self.natural, load, 1 / self.cable.shear, self.axial,
            self.force, self.couple, self.clamp(scene, 0), self.clamp(scene, 1), scene.end_kind,
            law=self.slip or self.friction, tethers=self.tethers, planes=self.planes, grip=tuple(self.grip))


def mesh(intervals, length, points=(), spans=()):
    """Nodes over [0, 1]: even, with nodes at `points` and around the edges of `spans` (position, width), both in m."""
    own = [p / length for p in points]
    for position, width in spans:
        for edge in (position - width / 2, position + width / 2):
            own += list(edge / length + EDGE * np.linspace(-0.5, 0.5, 5))
    own = np.unique(np.round([x for x in own if 0 < x < 1], 9))
    own = own[np.concatenate([[True], np.diff(own) > 0.1 / intervals])] if len(own) else own
    even = np.linspace(0, 1, intervals + 1)
    if len(own):
        far = np.abs(even[:, None] - own).min(axis=1) > 0.3 / intervals
        even = np.union1d(even[far], np.concatenate([own, [0.0, 1.0]]))
    return even


def interpolate(sigma, y, new):
    """States on another mesh, by the cubic spline through the nodes."""
    return y if len(sigma) == len(new) and np.array_equal(sigma, new) else CubicSpline(sigma, y, axis=1)(new)


def observation_matrix(sigma, at):
    """The matrix that takes node values to values at `at` (both over [0, 1]), through a cubic spline."""
    return CubicSpline(sigma, np.eye(len(sigma)))(at)
