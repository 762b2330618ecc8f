"""Cables with a free end, curves that only guide points find, and what a fit begins from when extraction refuses."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.scan import extract, scanner, shapes
from tests.scan.truth import EYES, ends, errors, extracted, scanned

LENGTH, RADIUS = 1.0, 0.012
NOISE = scanner.STRUCTURED_LIGHT.noise


def marks_on(curve, radius, count=10):
    """What a user would mark: points on the side that the first eye sees."""
    some = curve[np.linspace(8, len(curve) - 9, count).astype(int)]
    look = EYES[0] - some
    return some + radius * look / np.linalg.norm(look, axis=1, keepdims=True)


def test_a_free_end_is_found_where_the_cloud_ends():
    curve = shapes.helix(LENGTH, RADIUS)
    clutter = [scanner.table(curve, RADIUS)]
    cloud = scanner.scan(curve, RADIUS, EYES[:2], scanner.STRUCTURED_LIGHT, 3, clutter=clutter).points
    found = extract(cloud, RADIUS, length=LENGTH, start=ends(curve)[0])
    rms, _, _ = errors(found, curve, RADIUS, 2)
    assert rms < 0.3 * NOISE
    assert np.linalg.norm(found.points[0] - curve[0]) < 0.02 * LENGTH
    assert np.linalg.norm(found.points[-1] - curve[-1]) < RADIUS
    assert found.sure
    assert abs(found.radius.mean / RADIUS - 1.0) < 0.02
    np.testing.assert_allclose(np.linalg.det(found.frames), 1.0, atol=1e-9)
    np.testing.assert_allclose(found.frames[:, :, 2], found.tangents, atol=1e-9)
    steps = np.linalg.norm(np.diff(found.points, axis=0), axis=1)
    np.testing.assert_allclose(steps, found.arc_length[1], rtol=1e-2)
    assert {"cloud", "coarse", "snakes", "points used"} <= set(found.stages)


@pytest.mark.slow
def test_neither_clamp_nor_length_is_needed():
    curve, scan = scanned("random", LENGTH, RADIUS)
    found = extract(scan.points, RADIUS)
    order = found if np.linalg.norm(found.points[0] - curve[0]) < 0.1 else replace(found, points=found.points[::-1])
    rms, _, length = errors(order, curve, RADIUS, 2)
    assert rms < 0.3 * NOISE
    assert abs(length) < 0.01


@pytest.mark.slow
def test_a_free_end_that_is_too_short_is_doubted():
    curve, scan = scanned("random", LENGTH, RADIUS)
    cut = scan.points[np.linalg.norm(scan.points - curve[-1], axis=1) > 0.06]
    found = extract(cut, RADIUS, length=LENGTH, start=ends(curve)[0])
    assert not found.sure
    assert any("m long" in said for said in found.doubts)


@pytest.mark.slow
def test_guide_points_lead_where_the_cloud_alone_is_refused():
    """Two gaps of a fifth of the length: no way from clamp to clamp, until a user marks it."""
    curve = shapes.FAMILIES["helix"](LENGTH, RADIUS)
    gaps = ((0.1, 0.4), (0.55, 0.85))
    cloud = scanner.scan(curve, RADIUS, EYES[:2], scanner.STRUCTURED_LIGHT, 2, gaps=gaps).points
    with pytest.raises(Scan2FlexError, match="guide points"):
        extracted(cloud, curve, RADIUS)
    found = extracted(cloud, curve, RADIUS, guide_points=marks_on(curve, RADIUS, 24))
    assert found.found_by == "guide points"
    assert len(found.gaps) == 2
    assert not found.sure
    seen = np.all([(found.arc_length < a - RADIUS) | (found.arc_length > b + RADIUS) for a, b in found.gaps], axis=0)
    away = np.linalg.norm(found.points[seen][:, None] - shapes.resample(curve, 4001), axis=2).min(axis=1)
    assert np.sqrt(np.mean(away**2)) < 0.5 * NOISE
