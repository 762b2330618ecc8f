"""Cables that hang in a plane: from a clamp, between two clamps, by collocation (scipy.integrate.solve_bvp), and as chains.

Symbols: s arc length (m), x and z the place (m), t the angle of the tangent above the horizontal, k the curvature (1/m), w the
weight per length (N/m) along -z, P a load (N) at the free end, down: x' = cos t, z' = sin t, t' = k,
EI k' = (w (L - s) + P) cos t with k(L) = 0; between clamps EI k' = H sin t - (V + w s) cos t, H and V the force at the start.
"""

from functools import cache

import numpy as np
from scipy.integrate import solve_bvp
from scipy.optimize import brentq


@cache
def solution(length, EI, weight, angle=0.0, load=0.0):
    """State (x, z, t, k) as a function of s of a cable that leaves its clamp at the origin at an ``angle`` (rad)."""

    def rhs(s, y, share):
        return np.array([np.cos(y[2]), np.sin(y[2]), y[3], share * (weight * (length - s) + load) * np.cos(y[2]) / EI])

    def ends(a, b):
        return np.array([a[0], a[1], a[2] - angle, b[3]])

    grid = np.linspace(0.0, length, 40)
    y = np.stack([grid * np.cos(angle), grid * np.sin(angle), angle + 0 * grid, 0 * grid])
    for share in (0.03, 0.1, 0.3, 0.6, 1.0):
        found = solve_bvp(lambda s, y, share=share: rhs(s, y, share), ends, grid, y, tol=1e-9, max_nodes=20_000)
        assert found.success
        grid, y = found.x, found.y
    return found.sol


def positions(length, EI, weight, angle, s, load=0.0):
    """Places (n, 3) (m) at arc lengths ``s``."""
    x, z = solution(length, EI, weight, angle, load)(s)[:2]
    return np.stack([x, 0 * x, z], axis=1)


def between_clamps(length, EI, weight, first, last, span, guess):
    """State (x, z, t, k) as a function of s between clamps ``span`` (m) apart at one height, at tangent angles (rad) ``first``
    and ``last``; ``guess`` gives t at s / L."""

    def rhs(s, y, p):
        _, _, t, k = y
        return np.array([np.cos(t), np.sin(t), k, (p[0] * np.sin(t) - (p[1] + weight * s) * np.cos(t)) / EI])

    def ends(a, b, p):
        return np.array([a[0], a[1], a[2] - first, b[0] - span, b[1], b[2] - last])

    s = np.linspace(0.0, length, 201)
    t = guess(s / length)
    x, z = (np.concatenate([[0.0], np.cumsum(0.5 * (f(t)[1:] + f(t)[:-1]) * np.diff(s))]) for f in (np.cos, np.sin))
    y = np.array([x, z, t, np.gradient(t, s)])
    found = solve_bvp(rhs, ends, s, y, p=[0.0, -0.5 * weight * length], tol=1e-8, max_nodes=50_000)
    assert found.success, found.message
    return found.sol


def tip(length, EI, weight):
    """Place (x, z) (m) of the free end of a cable that leaves its clamp level; EI and weight are functions of s."""

    def rhs(s, y):
        _, _, angle, moment, beyond = y
        return np.stack([np.cos(angle), np.sin(angle), moment / EI(s), beyond * np.cos(angle), -weight(s)])

    def ends(a, b):
        return np.array([a[0], a[1], a[2], b[3], b[4]])

    s = np.linspace(0.0, length, 401)  # eighths of the length are nodes: stiffness may have kinks there
    found = solve_bvp(rhs, ends, s, np.stack([s, 0 * s, 0 * s, 0 * s, 0 * s]), tol=1e-10, max_nodes=100_000)
    assert found.success
    return found.sol(length)[:2]


def chain(length, span, s, rise=0.0):
    """Places (n, 3) (m) of a chain at ``s`` from its lower end, whose other end is ``span`` along x and ``rise`` up."""
    a = brentq(lambda a: np.sinh(a) / a - np.sqrt(length**2 - rise**2) / span, 1e-6, 20.0)
    c = span / (2 * a)
    lowest = 0.5 * span - c * np.arctanh(rise / length)
    x = lowest + c * np.arcsinh(s / c + np.sinh(-lowest / c))
    return np.stack([x, 0 * x, c * (np.cosh((x - lowest) / c) - np.cosh(lowest / c))], axis=1)
