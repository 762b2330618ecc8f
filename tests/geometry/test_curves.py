"""Curves given by points: lengths, tangents, and frames that do not turn about the tangent."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scan2flex_jax.geometry import curves

RADIUS, PITCH = 2.0, 0.5  # of the helix (R cos a, R sin a, c a): length of a turn 2 pi sqrt(R^2 + c^2)


def helix(count, turns=1.0):
    a = np.linspace(0.0, 2 * np.pi * turns, count)
    return jnp.array(np.stack([RADIUS * np.cos(a), RADIUS * np.sin(a), PITCH * a], axis=1))


def test_length_of_a_helix_at_second_order():
    exact = 2 * np.pi * np.hypot(RADIUS, PITCH)
    errors = np.array([exact - float(curves.arc_length(helix(n + 1))[-1]) for n in (50, 100, 200)])
    assert np.all(np.log2(errors[:-1] / errors[1:]) > 1.95)


def test_resampling_is_equally_spaced_and_keeps_the_ends():
    uneven = helix(400)[jnp.array(sorted({0, 399, *range(3, 390, 7), *range(200, 300)}))]
    points = curves.resample(uneven, 41)
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert np.ptp(steps) < 4e-3 * steps.mean()
    np.testing.assert_allclose(points[jnp.array([0, -1])], uneven[jnp.array([0, -1])], atol=1e-14)


def test_tangents_are_unit_and_exact_on_a_line():
    line = jnp.array([[0.0, 0, 0], [0.1, 0.2, 0.2], [0.3, 0.6, 0.6], [1.0, 2.0, 2.0]])
    np.testing.assert_allclose(curves.tangents(line), np.tile([1 / 3, 2 / 3, 2 / 3], (4, 1)), atol=1e-15)


@pytest.mark.parametrize("b", [[0.0, 0, 1], [0.6, 0.0, 0.8], [0.0, 0.0, -1.0], [1e-9, 0, 1], [0.0, 1e-7, -1.0]])
def test_smallest_rotation_takes_one_vector_to_the_other(b):
    a, b = np.array([0.0, 0.0, 1.0]), np.array(b) / np.linalg.norm(b)
    R = np.asarray(curves.smallest_rotation(jnp.array(a), jnp.array(b)))
    np.testing.assert_allclose(R @ a, b, atol=1e-7)
    np.testing.assert_allclose(R.T @ R, np.eye(3), atol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(Rotation.from_matrix(R).as_rotvec()), np.arccos(a @ b), atol=1e-6)


def test_transport_round_a_helix_turns_by_its_total_torsion():
    """A rotation-minimising frame lags the Frenet frame by the integral of the torsion c/(R^2 + c^2) along the arc."""
    turns, length = 1.0, 2 * np.pi * np.hypot(RADIUS, PITCH)
    total = PITCH / (RADIUS**2 + PITCH**2) * length * turns
    errors = []
    for n in (50, 100, 200):
        a = np.linspace(0.0, 2 * np.pi, n + 1)
        t = np.stack([-RADIUS * np.sin(a), RADIUS * np.cos(a), np.full_like(a, PITCH)], 1) / np.hypot(RADIUS, PITCH)
        normal = np.array([-1.0, 0.0, 0.0])
        first = np.stack([normal, np.cross(t[0], normal), t[0]], axis=1)
        last = np.asarray(curves.transported_frames(jnp.array(t), jnp.array(first))[-1])
        lag = np.arctan2(last[:, 0] @ first[:, 1], last[:, 0] @ first[:, 0])
        errors.append(abs(np.angle(np.exp(1j * (lag + total)))))
    assert np.all(np.log2(np.array(errors[:-1]) / errors[1:]) > 1.9)
