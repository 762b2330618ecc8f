"""Every kind: at its null value the base model, and shapes whose derivatives are those of finite differences."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from . import scene

NOISE = 1.0e-12  # m: remaining error of a solve, for a shape of the size of 1 m
# field -> a step for each field that keeps a stencil within one polynomial piece of the smoothing and clear of the nodes
STEPS = {
    "position": 2e-4, "offset": 2e-4, "width": 2e-4, "anchor": 1e-3, "stiffness": 1e-2, "axial_stiffness": 0.5, "lever": 1e-5,
}  # fmt: skip
DEFAULT_STEP = 1e-3
FINER = {("friction", "slip_curvature"): 1e-4}  # the rounded knees of its sliders lie close together
# without history nothing has crept: `tests/fitting/test_memory.py` has the derivatives of relaxation
CASES = [(kind, name) for kind in scene.KINDS if kind != "relaxation" for name in scene.VALUES[kind][0]]


def test_null_values_are_the_base_model():
    """All kinds at once, each at its null value."""
    observed, _, found = scene.solved()
    np.testing.assert_allclose(observed, scene.base_points(), rtol=0, atol=1e-12)
    assert int(found.verdict.steps) < 50


def slope_by_differences(points_at, step):
    """Fourth-order central difference and a bound of its error: truncation (from two steps) and noise."""
    p = {k: points_at(k * step) for k in (-2, -1, 1, 2)}
    narrow, wide = (p[1] - p[-1]) / (2 * step), (p[2] - p[-2]) / (4 * step)
    fine = (4 * narrow - wide) / 3
    return fine, np.abs(narrow - wide).max() ** 2 / max(np.abs(fine).max(), 1e-30) + 3 * NOISE / step


@pytest.mark.parametrize("kind", scene.KINDS)
def test_shapes_have_derivatives_at_the_null_value(kind):
    """There an estimate begins, and a search for what is missing."""
    for name in scene.VALUES[kind][1]:
        null = np.asarray(getattr(scene.effect(kind), name))
        if np.all(np.isfinite(null)):
            slope = scene.solved(tangent=scene.direction_of(kind, name, np.ones(null.shape)))[1]
            assert np.all(np.isfinite(slope))


@pytest.mark.parametrize(("kind", "name"), CASES)
def test_shape_derivative(kind, name):
    effect = scene.active(kind)
    value = np.asarray(getattr(effect, name))
    along = np.random.default_rng(len(kind) + len(name)).normal(size=value.shape)
    along = along / np.linalg.norm(along) if value.shape else np.ones(())
    _, exact, found = scene.solved(effect, tangent=scene.direction_of(kind, name, along))

    def points_at(h):
        moved = eqx.tree_at(lambda e: getattr(e, name), effect, jnp.asarray(value + h * along))
        return scene.solved(moved, start=found.configuration)[0]  # on the same branch; contact is slow from afar

    by_differences, error = slope_by_differences(points_at, FINER.get((kind, name), STEPS.get(name, DEFAULT_STEP)))
    assert np.all(np.isfinite(exact))
    assert np.abs(exact - by_differences).max() < 1e-6 * np.abs(exact).max() + error
    assert error < 1e-3 * np.abs(exact).max() + 1e-9
