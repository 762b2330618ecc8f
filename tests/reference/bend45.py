"""Bathe-Bolourchi bend: a clamped eighth of a circle under a dead out-of-plane tip force, as a continuous rod.

Arc of radius 100 in the x-y plane from the origin, tangent +x there, centre at (0, 100, 0), opening angle 45 degrees;
square section 1 x 1, E = 1e7, G = 5e6 (nu = 0), tip force P along +z. Units are the benchmark's own (inch, lb).
J is the torsion constant: 1/6 is the polar moment of area, 0.141 Saint-Venant's value of a unit square; the two differ
by 0.5 % at the tip, so a comparison must say which one it means.

Symbols: r position, R = (d1, d2, d3) frame, d3 tangent, n = (0, 0, P) force, m moment, both the action of the far part.
Simo-Reissner: r' = R (e3 + C R^T n), R' = R hat(u0 + K^-1 R^T m), m' = -r' x n, C = diag(1/kGA, 1/kGA, 1/EA);
Kirchhoff: C = 0. As m(L) = 0, m(0) = r(L) x n: the two unknowns of the shooting are the tip's x and y.

Source: K.-J. Bathe, S. Bolourchi, "Large displacement analysis of three-dimensional beam structures", Int. J. Numer.
Methods Eng. 14 (1979) 961-986; J. C. Simo, L. Vu-Quoc, Comput. Methods Appl. Mech. Eng. 58 (1986) 79-116.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root

from . import rotations

RADIUS = 100.0
LENGTH = RADIUS * np.pi / 4
YOUNG, SHEAR_MODULUS = 1e7, 5e6
EI = YOUNG / 12
EA = YOUNG
GA = SHEAR_MODULUS
POLAR_J = 1 / 6
SAINT_VENANT_J = 0.141
START_FRAME = np.array([[0.0, 0, 1], [1.0, 0, 0], [0.0, 1, 0]])  # columns d1 = +y, d2 = +z, d3 = +x
NATURAL_CURVATURE = np.array([0.0, 1 / RADIUS, 0.0])  # about d2 = +z: the arc turns towards +y
ODE_TOLERANCE = 1e-12
LOAD_STEPS = 3  # they only keep the shooting near its root; the answer does not depend on them


def rhs(y, force, K, C):
    """Derivative (10,) along s of y = (r, quaternion, m)."""
    q, m = y[3:7], y[7:10]
    R = rotations.matrix(q)
    u = NATURAL_CURVATURE + (R.T @ m) / K
    tangent = R @ (np.array([0.0, 0, 1]) + C * (R.T @ force))
    q_rate = 0.5 * rotations.multiply(q, np.concatenate([[0.0], u]))
    return np.concatenate([tangent, q_rate, -np.cross(tangent, force)])


def _end_state(tip_xy, force, K, C):
    start_q = np.array([0.5, 0.5, 0.5, 0.5])  # START_FRAME is the cyclic permutation of the axes
    moment = np.cross([*tip_xy, 0.0], force)
    y0 = np.concatenate([np.zeros(3), start_q, moment])
    options = {"method": "DOP853", "rtol": ODE_TOLERANCE, "atol": ODE_TOLERANCE}
    return solve_ivp(lambda s, y: rhs(y, force, K, C), (0, LENGTH), y0, **options).y[:, -1]


def tip_position(load, torsion_constant, shear_stiffness=np.inf, axial_stiffness=np.inf):
    """Tip (3,) under the force `load` along +z; infinite shear and axial stiffness is the Kirchhoff rod."""
    K = np.array([EI, EI, SHEAR_MODULUS * torsion_constant])
    C = 1 / np.array([shear_stiffness, shear_stiffness, axial_stiffness])
    tip = np.array([RADIUS * np.sin(np.pi / 4), RADIUS * (1 - np.cos(np.pi / 4))])
    for step in np.linspace(0, load, LOAD_STEPS + 1)[1:]:
        force = np.array([0.0, 0, step])
        tip = root(lambda xy, f: _end_state(xy, f, K, C)[:2] - xy, tip, args=(force,), tol=1e-12).x
    end = _end_state(tip, force, K, C)
    if max(np.abs(end[:2] - tip).max(), np.abs(end[7:10]).max() / (load * RADIUS)) > 1e-8 * RADIUS:
        raise RuntimeError(f"the shooting for load {load} did not close: {end}")
    return end[:3]
