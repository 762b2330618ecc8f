"""A cable that hangs free from a clamp, in a plane, by collocation (scipy.integrate.solve_bvp).

Symbols: s arc length (m), x and z the place (m), t the angle of the tangent above the horizontal, m the moment (N m), w the
weight per length (N/m) along -z: x' = cos t, z' = sin t, EI t' = m, m' = w (L - s) cos t, with m(L) = 0.
"""

import numpy as np
from scipy.integrate import solve_bvp


def positions(length, EI, weight, angle, s):
    """Places (n, 3) (m) at arc lengths ``s`` of a cable that leaves its clamp at the origin at an ``angle`` (rad)."""

    def rhs(s, y, w):
        return np.array([np.cos(y[2]), np.sin(y[2]), y[3] / EI, w * (length - s) * np.cos(y[2])])

    def ends(a, b):
        return np.array([a[0], a[1], a[2] - angle, b[3]])

    grid = np.linspace(0.0, length, 40)
    y = np.stack([grid * np.cos(angle), grid * np.sin(angle), angle + 0 * grid, 0 * grid])
    for share in (0.03, 0.1, 0.3, 0.6, 1.0):
        found = solve_bvp(lambda s, y, w=share * weight: rhs(s, y, w), ends, grid, y, tol=1e-8, max_nodes=20_000)
        assert found.success
        grid, y = found.x, found.y
    x, z = found.sol(s)[:2]
    return np.stack([x, 0 * x, z], axis=1)
