"""Moment laws start from the effects that they could stand for."""

import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax.effects.catalogue import entry_of
from scan2flex_jax.effects.moment_law import tangent
from tests.effects import scene

STIFFNESS = jnp.diag(jnp.array([1e5, 1e5, 1e4, 0.02, 0.02, 0.015]))
SLIP, RATIO = 2.0, 0.3


def test_a_law_begins_as_stiff_as_the_effects_of_another_refit():
    soft = entry_of("nonlinear_bending").build(jnp.array([1.0 - RATIO]), {"slip_curvature": SLIP}, scene.CONTEXT)
    entry, site = entry_of("bending_law"), {"most": 8.0}
    at = jnp.linspace(1.0, 8.0, 8)
    found = tangent(at, at, jnp.exp(jnp.cumsum(jnp.asarray(entry.like(soft, STIFFNESS, site)))))
    np.testing.assert_allclose(found, RATIO + (1 - RATIO) * (1 + (at / SLIP) ** 2) ** -1.5, rtol=1e-4)
    np.testing.assert_allclose(entry_of("torsion_law").like(soft, STIFFNESS, site), np.zeros(8), atol=1e-12)


def test_a_law_that_another_effect_lets_fall_begins_nearly_flat():
    """At a ratio below zero the moment falls: a law cannot, and begins with a slope of a thousandth."""
    falling = entry_of("nonlinear_bending").build(jnp.array([1.5]), {"slip_curvature": SLIP}, scene.CONTEXT)
    steps = entry_of("bending_law").like(falling, STIFFNESS, {"most": 8.0})
    assert np.all(np.isfinite(steps))
    assert np.exp(np.sum(steps)) == pytest.approx(1e-3, rel=1e-3)
