"""The clamped cables under gravity that the tests lean on: the house cases H1-H4 and the poses P1-P3.

Frames are columns (d1, d2, d3), d3 the tangent; the start clamp sits at the origin with d1 = +z, d2 = -y, d3 = +x.
H1-H4: L = 1 m, inextensible, 0.5 N/m; stiffnesses (EI1, EI2, GJ) in N m^2 and natural curvature (1/m) as listed.
P1-P3: L = 1 m, EI 0.1, GJ 0.25 N m^2, 0.2 kg/m at 9.81 m/s^2, shear and axial stiffness 1e5 N; the end clamps are level
(P1), twisted by 90 degrees about the tangent (P2), and turned by 90 degrees about z, then 45 about +y (P3).
All of them are reached from `cosserat_bvp.sag_curve`, and all have other stable equilibria, most with full turns of
twist or a loop; of the ones met from random starts these have the least energy. For P1-P3 the next energies are about
3.2, 2.3 and 2.6 J against 1.42, 1.11 and 0.94 J; for H1-H4 0.33, 0.28, 0.39 and 0.26 J against 0.10, 0.22, 0.20 and
0.16 J. `lowest` of the answer names the branch.
"""

from itertools import pairwise

import numpy as np

from . import cosserat_bvp, rotations

STATIONS = np.linspace(0, 1, 21)  # s/L at which states are recorded
START_FRAME = np.array([[0.0, 0, 1], [0.0, -1, 0], [1.0, 0, 0]]).T
H_END_FRAME = np.array([[0.8, -0.6, 0], [0.0, 0, -1], [0.6, 0.8, 0]]).T
H_END = np.array([0.55, 0.25, 0.10])
POSE_WEIGHT = 0.2 * 9.81  # N/m
POSE_K = np.array([0.1, 0.1, 0.25])
POSE_COMPLIANCE = np.full(3, 1e-5)
X, Y, Z = np.eye(3)


def _house(K, end=H_END, end_frame=H_END_FRAME, natural_curvature=(0.0, 0.0, 0.0)):
    return cosserat_bvp.Clamped(1.0, np.array(K), 0.5, end, end_frame, START_FRAME, np.array(natural_curvature))


def _pose(end, end_frame):
    rod = cosserat_bvp.Clamped(1.0, POSE_K, POSE_WEIGHT, np.array(end), end_frame, START_FRAME)
    return rod._replace(compliance=POSE_COMPLIANCE)


CASES = {
    "H1": _house([0.02, 0.02, 0.014], np.array([0.8, 0, 0]), START_FRAME),
    "H2": _house([0.02, 0.02, 0.014]),
    "H3": _house([0.02, 0.02, 0.014], natural_curvature=(1.5, -0.8, 0.6)),
    "H4": _house([0.02, 0.01, 0.01], natural_curvature=(1.5, -0.8, 0.6)),
    "P1": _pose([0.6, 0, 0], START_FRAME),
    "P2": _pose([0.6, 0.2, 0], rotations.about(X, np.pi / 2) @ START_FRAME),
    "P3": _pose([0.5, 0.3, 0.1], rotations.about(Y, np.pi / 4) @ rotations.about(Z, np.pi / 2) @ START_FRAME),
}


def path(name, steps=5):
    """Rods that lead from the generic sagging curve to the case: H3 bends H2's wire slowly, H4 softens H3's."""
    last = CASES[name]
    before = {"H3": "H2", "H4": "H3"}.get(name)
    if before is None:
        return [last]
    first = CASES[before]
    shares = np.linspace(0, 1, steps + 1)[1:]
    between = [
        last._replace(
            K=first.K + x * (last.K - first.K),
            natural_curvature=first.natural_curvature + x * (last.natural_curvature - first.natural_curvature),
        )
        for x in shares
    ]
    return [*path(before, steps), *between]


def solve_case(name):
    """Equilibrium of the named case, by continuation from the generic sagging curve."""
    rods = path(name)
    return cosserat_bvp.solve(rods, cosserat_bvp.sag_curve(rods[0]))


def with_ratios(name, stiffnesses, steps=6):
    """Equilibria of the case, unshearable and inextensible, with each of the given (EI1, EI2, GJ) (N m^2), by continuation in
    their logarithms from one to the next, the first from the generic sagging curve."""
    rod, logs = CASES[name]._replace(compliance=np.zeros(3)), np.log(stiffnesses)
    between = [a + x * (b - a) for a, b in pairwise(logs) for x in np.linspace(0, 1, steps + 1)[1:]]
    rods = [rod._replace(K=np.exp(x)) for x in (logs[0], *between)]
    exact = [i % steps == 0 for i in range(len(rods))]
    residuals = [cosserat_bvp.RESIDUAL if x else 0.1 * cosserat_bvp.COARSE_RESIDUAL for x in exact]
    found = cosserat_bvp.follow(rods, cosserat_bvp.sag_curve(rods[0]), residuals)
    return [answer for answer, x in zip(found, exact, strict=True) if x]
