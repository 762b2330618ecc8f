"""Critical values of slender rods, each from its characteristic equation.

Symbols: L length (m), EI bending and GJ torsion stiffness (N m^2), isotropic section; q weight per length (N/m);
T tension (N), M twisting moment (N m), mu = M L/EI, tau = T L^2/EI; ring radius R (m).

Heavy column, foot clamped, top free: EI phi'' + q (L - s) phi = 0 is an Airy-type equation; with z = L - s it is solved
by sqrt(z) J_{-1/3}(2/3 sqrt(q/EI) z^{3/2}), so q L^3/EI = (9/4) j^2, j the first zero of J_{-1/3} (Greenhill 1881).
Clamped-clamped compression: 2 (1 - cos k) = k sin k with k^2 = P L^2/EI, first root 2 pi (Euler).
Twist of a straight clamped-clamped rod: w = y + i z obeys w'''' - i mu w''' - tau w'' = 0 (x over L), solutions
1, x, exp(i k x) with k^2 - mu k + tau = 0. On (-1/2, 1/2) with w(-x) = conj w(x) the four clamp conditions reduce to
(k1 k2/2) sin((k2 - k1)/2) = (k2 - k1) sin(k1/2) sin(k2/2); for tau -> 0: tan(mu/2) = mu/2.
Ring with twisting moment (Michell 1889, Zajac 1962): t x t'' + (M/EI) t' + t x n = 0 about t = e_theta, n = M e_z;
with t = e_theta + a e_r + b e_z (R = 1, EI = 1): b'' + b + M a' = 0, a'' = M b'; the mode exp(i k phi) exists when
(1 - k^2) k^2 + k^2 M^2 = 0. k = 1 is a rigid motion, so k = 2 is the first: M R/EI = sqrt 3, total twist 2 pi R M/GJ.

Source: S. P. Timoshenko, J. M. Gere, "Theory of Elastic Stability" (1961), 2.12 and 2.21; J. Michell, Messenger of
Mathematics 19 (1889) 181-184; E. E. Zajac, J. Appl. Mech. 29 (1962) 136-142.
"""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq
from scipy.special import jv


def heavy_column():
    """Critical q L^3/EI of a column under its own weight."""
    zero = brentq(lambda z: jv(-1 / 3, z), 1.5, 2.2, xtol=1e-15)
    return 9 / 4 * zero**2


def heavy_column_by_integration():
    """The same from phi'' + lambda z phi = 0, phi'(z = 0) = 0 at the top and phi(z = 1) = 0 at the foot."""

    def slope_at_foot(load):
        rhs = solve_ivp(lambda z, y: [y[1], -load * z * y[0]], (0, 1), [1.0, 0.0], method="DOP853", rtol=1e-13, atol=1e-13)
        return rhs.y[0, -1]

    return brentq(slope_at_foot, 6.0, 9.0, xtol=1e-14)


def clamped_clamped_compression():
    """Critical P L^2/EI of a straight rod between two clamps, one free to slide along the axis: 4 pi^2.

    The determinant of a + b x + c cos k x + d sin k x at the clamps is 4 sin(k/2) (sin(k/2) - (k/2) cos(k/2)).
    """
    return brentq(lambda k: 2 * (1 - np.cos(k)) - k * np.sin(k), 1.0, 7.5, xtol=1e-15) ** 2


def twisted_straight_rod(tension=0.0):
    """Critical M L/EI of a straight clamped-clamped rod under twist; tension = T L^2/EI >= 0 (twist angle M L/GJ)."""
    if tension == 0:
        return 2 * brentq(lambda x: np.sin(x) - x * np.cos(x), np.pi, 1.5 * np.pi, xtol=1e-15)

    def determinant(mu):
        split = np.sqrt(mu**2 / 4 - tension)
        k1, k2 = mu / 2 - split, mu / 2 + split
        return (k1 * k2 / 2) * np.sin((k2 - k1) / 2) / (k2 - k1) - np.sin(k1 / 2) * np.sin(k2 / 2)

    floor = 2 * np.sqrt(tension)
    trial = floor + np.geomspace(1e-4, 20, 400)  # real k1, k2 only above the floor
    values = [determinant(mu) for mu in trial]
    first = next(i for i in range(len(trial) - 1) if values[i] * values[i + 1] < 0)
    return brentq(determinant, trial[first], trial[first + 1], xtol=1e-14)


def twisted_ring(mode=2):
    """Critical M R/EI of a closed ring in the mode exp(i k phi), from the determinant of its linearised balance."""

    def determinant(moment):
        system = np.array([[1 - mode**2, 1j * mode * moment], [1j * mode * moment, mode**2]])
        return np.linalg.det(system).real

    return brentq(determinant, 1e-3, 2.0 * mode, xtol=1e-15)


def ring_twist_angle(stiffness_ratio):
    """Critical total twist (rad) of a closed ring, stiffness_ratio = EI/GJ: 2 pi sqrt(3) EI/GJ."""
    return 2 * np.pi * twisted_ring() * stiffness_ratio
