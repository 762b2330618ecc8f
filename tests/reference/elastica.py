"""Cantilevers of an inextensible planar rod: tip load by elliptic integrals, own weight by shooting.

Symbols: s arc length from the clamp, L length (m), EI bending stiffness (N m^2), P tip load (N), q weight per length
(N/m), theta slope below the horizontal (rad), theta_L its value at the tip. The clamp is horizontal, both loads are
dead and transverse; the drop w is counted along the load, u = L - x_tip is the tip's way back towards the clamp.

Tip load: EI theta'' = -P cos theta, theta(0) = theta'(L) = 0. With k^2 = (1 + sin theta_L)/2 and
sin phi_0 = 1/(k sqrt 2): sqrt(P L^2/EI) = a = K(k) - F(phi_0, k), w/L = 1 - 2 (E(k) - E(phi_0, k))/a, and the moment at
the clamp, P x_tip = EI theta'(0) = sqrt(2 P EI sin theta_L), gives x_tip/L = sqrt(2 sin theta_L)/a.
Own weight: EI theta'' = -q (L - s) cos theta with the same ends.

Source: K. Mattiasson, "Numerical results from large deflection beam and frame problems analysed by means of elliptic
integrals", Int. J. Numer. Methods Eng. 17 (1981) 145-153.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import ellipe, ellipeinc, ellipkinc, ellipkm1

ODE_TOLERANCE = 1e-13  # DOP853 stays a digit or two above it; the tables have 8 to 10 digits


def _elliptic(delta):
    """(a, w/L) of the tip-loaded cantilever whose tip slope is pi/2 - delta."""
    m1 = np.sin(delta / 2) ** 2  # 1 - k^2, kept apart: k -> 1 under a large load
    m = 1 - m1
    phi0 = np.arctan2(1.0, np.sqrt(max(2 * m - 1, 0.0)))  # sin^2 phi_0 = 1/(2m)
    a = ellipkm1(m1) - ellipkinc(phi0, m)
    return a, 1 - 2 * (ellipe(m) - ellipeinc(phi0, m)) / a


def tip_loaded_cantilever(load):
    """(w/L, u/L, theta_L in rad) of a cantilever under a dead transverse tip load; load = P L^2/EI, 0.01 to 200."""
    a = np.sqrt(load)
    log_delta = brentq(lambda x: _elliptic(np.exp(x))[0] - a, np.log(1e-9), np.log(np.pi / 2 - 1e-6), xtol=1e-15)
    delta = np.exp(log_delta)
    return _elliptic(delta)[1], 1 - np.sqrt(2 * np.cos(delta)) / a, np.pi / 2 - delta


def _from_the_tip(delta, force):
    """End state of delta = pi/2 - theta, its slope, and the integrals of cos and sin theta, from the tip inwards.

    `force(sigma)` is the dimensionless transverse force at the distance sigma from the tip.
    """

    def rhs(sigma, y):
        return [y[1], force(sigma) * np.sin(y[0]), np.sin(y[0]), np.cos(y[0])]

    end = solve_ivp(rhs, (0, 1), [delta, 0.0, 0.0, 0.0], method="DOP853", rtol=ODE_TOLERANCE, atol=ODE_TOLERANCE)
    return end.y[:, -1]


def shoot_cantilever(force):
    """(drop/L, x_tip/L, theta_L in rad) for a dimensionless transverse force `force(sigma)`, sigma from the tip.

    The wanted equilibrium has a monotone slope: it is the first root met when delta at the tip grows from zero.
    """
    trial = np.geomspace(1e-6, np.pi / 2, 200)
    short = next(i for i, d in enumerate(trial) if _from_the_tip(d, force)[0] > np.pi / 2)
    delta = brentq(lambda d: _from_the_tip(d, force)[0] - np.pi / 2, trial[short - 1], trial[short], xtol=1e-16)
    _, _, x, drop = _from_the_tip(delta, force)
    return drop, x, np.pi / 2 - delta


def heavy_cantilever(weight):
    """(drop/L, x_tip/L, theta_L in rad) of a horizontally clamped cantilever; weight = q L^3/EI, 0.1 to 200."""
    return shoot_cantilever(lambda sigma: weight * sigma)
