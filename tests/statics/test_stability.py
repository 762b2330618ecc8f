"""Critical loads as the sign change of the Hessian's smallest eigenvalue, counted from its factorisation, to 0.5 %.

Each state is known: straight or a ring. It is put down, settled by a few plain Newton steps (which do not care whether
it is stable) and judged; the load is bisected.

Source: S. P. Timoshenko, J. M. Gere, "Theory of Elastic Stability" (1961), 2.12 and 2.21.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from reference import rotations

from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.model import Configuration

from . import cases

RIGID = 1.0e7  # N, beside EI = 1 N m^2 and L = 1 m
TO = 0.005
N = 40
X, Z = np.eye(3)[0], np.eye(3)[2]


def is_stable(model, boundary, configuration):
    negative, residual, _ = cases.stability(model, boundary, configuration, 3)
    assert residual < 1e-5
    return int(negative) == 0


def test_heavy_column_buckles():
    """Clamped at the foot, free above: q L^3/EI = (9/4) j^2, j the first zero of J_-1/3 (Greenhill 1881)."""
    boundary = cases.cantilever(np.eye(3))

    def stable(weight):
        model = cases.model(Cable(1.0, weight / 9.81, 1.0, 1.0, RIGID, RIGID))
        return is_stable(model, boundary, cases.straight(boundary, 1.0, N))

    np.testing.assert_allclose(cases.critical(stable, 5.0, 12.0), 7.837347438943, rtol=TO)


def test_compressed_rod_buckles():
    """Between clamps pushed together, under P = EA times the shortening: P L^2/EI = 4 pi^2 (Euler)."""

    def stable(load):
        shortened = 1.0 - load / RIGID
        boundary = cases.clamped((shortened, 0.0, 0.0), cases.START_FRAME)
        model = cases.model(Cable(1.0, 0.0, 1.0, 1.0, RIGID, RIGID), cases.WEIGHTLESS)
        return is_stable(model, boundary, cases.straight(boundary, shortened, N))

    np.testing.assert_allclose(cases.critical(stable, 20.0, 60.0), 4 * np.pi**2, rtol=TO)


@pytest.mark.parametrize(("GJ", "tension", "exact"), [(1.0, 0.0, 8.986818915818), (3.0, 10.0, 10.428856439277)])
def test_twisted_straight_rod_buckles(GJ, tension, exact):
    """M L/EI at a tension T L^2/EI (Greenhill: tan x = x with x = M L/(2 EI), if there is none); the twist is M L/GJ."""
    length = 1.0 + tension / RIGID

    def stable(moment):
        twist = moment / GJ
        boundary = cases.clamped((length, 0.0, 0.0), rotations.about(X, twist) @ cases.START_FRAME)
        model = cases.model(Cable(1.0, 0.0, 1.0, GJ, RIGID, RIGID), cases.WEIGHTLESS)
        return is_stable(model, boundary, cases.straight(boundary, length, N, twist))

    np.testing.assert_allclose(cases.critical(stable, 6.0, 14.0), exact, rtol=TO)


def ring(twist, elements):
    """A ring of unit length in the x-z plane through the origin, its frames twisted evenly by ``twist`` (rad)."""
    a = 2 * np.pi * np.linspace(0.0, 1.0, elements + 1)
    r = np.stack([np.sin(a), 0 * a, 1 - np.cos(a)], axis=1) / (2 * np.pi)
    frames = rotations.exp(-a[:, None] * np.eye(3)[1]) @ cases.START_FRAME  # carries +x towards +z
    return Configuration(jnp.array(r), jnp.array(frames @ rotations.exp(a[:, None] / (2 * np.pi) * twist * Z)))


@pytest.mark.parametrize("GJ", [0.75, 3.0])
def test_twisted_ring_writhes(GJ):
    """Michell's ring, closed by clamping both ends at one place: total twist 2 pi sqrt(3) EI/GJ.

    The twisting moment M turns with the tangent, which takes the force n = M/R along the binormal: M t' + t x n = 0.
    The known ring with this force and the moments of its strains is judged as it stands. Turning it about its tangent
    at the clamp costs nothing: a stiffness of 1e-3 on every node, against some 300 of the bending that writhes, takes
    that motion out of the count.
    """

    def stable(twist):
        c = ring(twist, 80)
        model = cases.model(Cable(1.0, 0.0, 1.0, GJ, RIGID, RIGID), cases.WEIGHTLESS)
        boundary = cases.clamped((0.0, 0.0, 0.0), c.R[-1], c.R[0])
        force = -GJ * twist * 2 * np.pi * np.eye(3)[1]  # t = +x, towards the centre +z: the binormal is -y
        return int(cases.stability_under_force(model, boundary, c, jnp.array(force), 1e-3)) == 0

    exact = 2 * np.pi * np.sqrt(3) / GJ
    np.testing.assert_allclose(cases.critical(stable, 0.8 * exact, 1.2 * exact), exact, rtol=TO)
