"""Rods under an end moment alone: circle, helix and pure torsion in closed form.

Symbols: s arc length, L length (m), EI, GJ (N m^2) of an isotropic section, no natural curvature; m moment (N m), a
constant vector in space because no force acts (n = 0); R(s) = (d1, d2, d3), d3 tangent.

The tangent obeys t' = (m/EI) x t and m . t is constant, so the frame is a product of two steady rotations:
R(s) = exp(s hat(m)/EI) R(0) exp(s (m . t0) (1/GJ - 1/EI) hat(e3)), and the centre line is a helix about m,
r(s) = r(0) + int_0^s exp(x hat(w)) t0 dx with w = m/EI. m perpendicular to t0 gives a circle, parallel pure torsion.
An end moment that is constant in space has no potential in three dimensions; a minimiser meets these shapes by
clamping both ends in the exact poses, where n = 0 and the given m come out as the reactions.

Helix case: R0 = 10, height 50 over 2 coils, E = 1, G = 1/2, circular section of diameter L/1e4, so EI = GJ.
Source: the example 02_helix of the code cardillo (github.com/cardillo/cardillo); the closed form is derived above.
"""

from typing import NamedTuple

import numpy as np

from . import rotations

E3 = np.array([0.0, 0.0, 1.0])


class Helix(NamedTuple):
    """Radius (m), slope c = pitch/(2 pi radius), length (m), curvature and torsion (1/m), EI = GJ (N m^2)."""

    radius: float
    slope: float
    length: float
    curvature: float
    torsion: float
    stiffness: float


def helix_case(radius=10.0, height=50.0, coils=2, slenderness=1e4):
    """Parameters of the helix case; the end moment has the body components GJ torsion (d3) and EI curvature."""
    slope = height / (2 * np.pi * radius * coils)
    length = np.sqrt(1 + slope**2) * 2 * np.pi * radius * coils
    curvature = 1 / (radius * (1 + slope**2))
    stiffness = np.pi * (length / slenderness) ** 4 / 64  # E = 1; G = E/2 gives GJ = EI
    return Helix(radius, slope, length, curvature, slope * curvature, stiffness)


def helix_moment(case, start_frame):
    """Moment (3,) in space that bends about d2 of the start frame and twists about d3 into the helix `case`."""
    return case.stiffness * start_frame @ np.array([0.0, case.curvature, case.torsion])


def under_end_moment(s, moment, EI, GJ, start_frame, *, start=(0.0, 0.0, 0.0)):
    """Positions (n, 3) and frames (n, 3, 3) at the arc lengths s (n,) of a straight rod under the moment (3,)."""
    s = np.asarray(s, float)
    w = np.asarray(moment, float) / EI
    t0 = start_frame[:, 2]
    rate = np.linalg.norm(w)
    turn = rate * s[:, None]
    along = w * (w @ t0) / rate**2
    across, sideways = t0 - along, np.cross(w, t0) / rate
    r = np.asarray(start) + s[:, None] * along + (np.sin(turn) * across + (1 - np.cos(turn)) * sideways) / rate
    twist = (np.asarray(moment) @ t0) * (1 / GJ - 1 / EI)
    return r, rotations.exp(s[:, None] * w) @ start_frame @ rotations.exp(s[:, None] * twist * E3)


def rolled_up(s, length, EI, turns):
    """(x, z) each (n,) of a cantilever along x under the end moment 2 pi EI turns/length, rolled towards +z."""
    curvature = 2 * np.pi * turns / length
    s = np.asarray(s, float)
    return np.sin(curvature * s) / curvature, (1 - np.cos(curvature * s)) / curvature


def pure_torsion(length, GJ, angle):
    """(moment in N m, energy in J) of a straight rod twisted by `angle` (rad) between its ends."""
    return GJ * angle / length, GJ * angle**2 / (2 * length)
