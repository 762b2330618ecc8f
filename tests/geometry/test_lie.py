"""Exponentials and logarithms against scipy and their power series; derivatives through the small-angle branch.

The angles 0, 1e-4, both sides of the switch at |w|^2 = 0.05, and 2 rad meet both branches of each function.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm, sqrtm
from scipy.spatial.transform import Rotation

from scan2flex_jax.geometry import lie

AXIS = np.array([0.36, -0.48, 0.8])
ANGLES = [0.0, 1e-4, 0.2236, 0.22361, 2.0]
V = np.array([0.7, -0.2, 0.4])
EPS = np.finfo(float).eps


def twist_matrix(x):
    """The 4x4 matrix whose exponential is the rigid motion of the twist ``x``."""
    top = np.hstack([np.asarray(lie.hat(jnp.array(x[3:]))), np.asarray(x[:3])[:, None]])
    return np.vstack([top, np.zeros(4)])


def series_log(M, terms=60):
    """Logarithm of a matrix near one by its power series, after square roots that bring it nearer."""
    halvings = 6
    for _ in range(halvings):
        M = np.real(sqrtm(M))
    X, power, total = M - np.eye(len(M)), np.eye(len(M)), np.zeros_like(M)
    for k in range(1, terms):
        power = power @ X
        total = total + (-1) ** (k + 1) / k * power
    return total * 2**halvings


@pytest.mark.parametrize("angle", ANGLES)
def test_so3_matches_scipy(angle):
    w = angle * AXIS
    R = Rotation.from_rotvec(w).as_matrix()
    np.testing.assert_allclose(lie.so3_exp(jnp.array(w)), R, atol=4 * EPS)
    np.testing.assert_allclose(lie.so3_log(jnp.array(R)), w, atol=1e-15, rtol=1e-14)


@pytest.mark.parametrize("angle", ANGLES)
def test_se3_exp_is_the_matrix_exponential(angle):
    x = np.concatenate([V, angle * AXIS])
    r, R = lie.se3_exp(jnp.array(x))
    M = expm(twist_matrix(x))
    np.testing.assert_allclose(r, M[:3, 3], atol=1e-15)
    np.testing.assert_allclose(R, M[:3, :3], atol=1e-15)


@pytest.mark.parametrize("angle", ANGLES)
def test_se3_log_inverts_exp(angle):
    x = jnp.array(np.concatenate([V, angle * AXIS]))
    np.testing.assert_allclose(lie.se3_log(*lie.se3_exp(x)), x, atol=3e-15)


def test_se3_log_matches_the_power_series():
    x = np.concatenate([V, AXIS])
    M = series_log(expm(twist_matrix(x)))
    got = lie.se3_log(*lie.se3_exp(jnp.array(x)))
    np.testing.assert_allclose(twist_matrix(np.asarray(got)), M, atol=1e-12)


def helix_map(x):
    """A smooth scalar of the exponential and logarithm together, with no symmetry that would hide a term."""
    r, R = lie.se3_exp(x)
    weights = jnp.arange(1.0, 10.0).reshape(3, 3)
    shifted = lie.se3_log(r + jnp.array([0.1, 0.0, -0.2]), R)
    return jnp.sum(weights * R) + r @ jnp.array([1.0, -2.0, 3.0]) + shifted @ jnp.arange(6.0)


derivative_map = jax.jit(lambda x: (helix_map(x), jax.grad(helix_map)(x), jax.hessian(helix_map)(x)))


@pytest.mark.parametrize("angle", ANGLES)
def test_value_gradient_and_hessian_are_finite_and_right(angle):
    """Gradient against central differences of values, Hessian against those of gradients (h chosen for 1e-9 noise)."""
    x = np.concatenate([V, angle * AXIS])
    value, gradient, hessian = derivative_map(jnp.array(x))
    assert all(np.all(np.isfinite(a)) for a in (value, gradient, hessian))
    h = 1e-3
    for k, step in enumerate(h * np.eye(6)):
        near = [derivative_map(jnp.array(x + c * step)) for c in (-2, -1, 1, 2)]
        for order, exact in ((0, gradient[k]), (1, hessian[k])):
            a, b, c, d = (np.asarray(n[order]) for n in near)
            np.testing.assert_allclose((8 * (c - b) - (d - a)) / (12 * h), exact, atol=2e-9)


@jax.jit
def log_derivative(x):
    """Derivative at zero of ``c -> log(exp(x) exp(c))``."""

    def moved(c):
        r, R = lie.se3_exp(x)
        dr, dR = lie.se3_exp(c)
        return lie.se3_log(r + R @ dr, R @ dR)

    return jax.jacfwd(moved)(jnp.zeros(6))


@pytest.mark.parametrize("angle", ANGLES)
def test_right_jacobian_inverse_is_the_derivative_of_the_log(angle):
    x = jnp.array(np.concatenate([V, angle * AXIS]))
    np.testing.assert_allclose(lie.right_jacobian_inverse(x), log_derivative(x), atol=1e-13)


@jax.jit
def slopes(x, wrench):
    return lie.right_jacobian_inverse_slope(x, wrench), jax.jacfwd(lambda y: lie.right_jacobian_inverse(y).T @ wrench)(x)


@pytest.mark.parametrize("angle", ANGLES)
def test_slope_of_a_wrench_under_the_right_jacobian_inverse(angle):
    x, wrench = jnp.array(np.concatenate([V, angle * AXIS])), jnp.array([0.3, -1.1, 0.6, 0.9, 0.2, -0.4])
    np.testing.assert_allclose(*slopes(x, wrench), atol=1e-13)


def test_adjoint_carries_twists_through_a_motion():
    x, a = jnp.array([0.3, -0.1, 0.6, 0.5, 0.8, -0.4]), jnp.array([0.2, 0.1, -0.3, 0.4, -0.2, 0.1])
    r, R = lie.se3_exp(x)
    da, Da = lie.se3_exp(a)
    db, Db = lie.se3_exp(lie.adjoint_inverse(r, R) @ a)
    np.testing.assert_allclose(da + Da @ r, r + R @ db, atol=1e-15)
    np.testing.assert_allclose(Da @ R, R @ Db, atol=1e-15)


def test_bracket_matrix_pairs_the_commutator():
    a, b, p = np.random.default_rng(0).normal(size=(3, 6))
    A, B = twist_matrix(a), twist_matrix(b)
    C = A @ B - B @ A
    bracket = np.array([*C[:3, 3], C[2, 1], C[0, 2], C[1, 0]])
    np.testing.assert_allclose(a @ lie.bracket_matrix(jnp.array(p)) @ b, p @ bracket, rtol=1e-13)
