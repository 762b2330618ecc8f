"""A wrong curve says so: each sign that speaks against a curve, on curves made wrong in that way."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from scan2flex_jax.scan import End, extract, plausibility, scanner, shapes, strand_matching
from tests.scan.truth import EYES, ends, scanned

LENGTH, RADIUS = 1.0, 0.012


def fitted(shift=(0.0, 0.0, 0.0), sigma=5e-4, count=4000):
    """A straight cable along x whose points ask to be moved by ``shift`` (m) over the middle fifth."""
    rng = np.random.default_rng(0)
    x = np.stack([np.linspace(0.0, LENGTH, 40), np.zeros(40), np.zeros(40)], axis=1)
    t = rng.uniform(0.0, 39.0, count)
    normal = np.stack([np.zeros(count), *rng.normal(size=(2, count))], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    there = np.abs(t / 39.0 - 0.5) < 0.1
    e = sigma * rng.normal(size=count) + np.where(there, normal @ shift, 0.0)
    n = -normal
    return SimpleNamespace(
        points=x,
        parameter=t,
        sigma=sigma,
        settled=True,
        score=n * e[:, None] / sigma**2,
        information=np.einsum("ni,nj->nij", n, n) / sigma**2,
    )


def test_pulls_are_the_displacement_that_the_points_ask_for():
    shift = np.array([0.0, 2e-3, -1e-3])
    u, chi, at = plausibility.pulls(fitted(shift), RADIUS)
    there = np.abs(at / 39.0 - 0.5) < 0.08
    np.testing.assert_allclose(np.linalg.norm(u[there], axis=1), np.linalg.norm(shift), rtol=0.1)
    assert np.all(chi[there] > 100.0)
    assert np.all(np.linalg.norm(u[~(np.abs(at / 39.0 - 0.5) < 0.12)], axis=1) < 5e-4)


@pytest.mark.parametrize(("shift", "doubted"), [(0.0, False), (1e-4, False), (8e-3, True)])
def test_a_curve_beside_its_points_is_doubted(shift, doubted):
    curve = SimpleNamespace(
        points=np.stack([np.linspace(0.0, LENGTH, 201), np.zeros(201), np.zeros(201)], axis=1),
        tangents=np.tile([1.0, 0.0, 0.0], (201, 1)),
        arc_length=np.linspace(0.0, LENGTH, 201),
        length=LENGTH,
        std=np.full(201, 1e-4),
        noise=5e-4,
        gaps=(),
        radius=SimpleNamespace(mean=RADIUS, share=1.0),
    )
    start, end = (End(np.array([x, 0.0, 0.0]), np.array([1.0, 0.0, 0.0])) for x in (0.0, LENGTH))
    said = plausibility.doubts(curve, fitted((0.0, shift, 0.0)), RADIUS, LENGTH, start, end)
    assert bool(said) == doubted, said
    beside = End(end.position + np.array([0.0, 3.0 * RADIUS, 0.0]), end.tangent)
    assert any("misses the" in s for s in plausibility.doubts(curve, fitted(), RADIUS, LENGTH, start, beside))
    long = replace(start, position=start.position - np.array([0.05, 0.0, 0.0]))
    assert any("clamp to clamp" in s for s in plausibility.doubts(curve, fitted(), RADIUS, LENGTH, long, end))


def test_a_good_scan_is_sure_and_a_fifth_of_the_length_unseen_is_not():
    curve, scan = scanned("random", LENGTH, RADIUS)
    start, end = ends(curve)
    assert extract(scan.points, RADIUS, length=LENGTH, start=start, end=end, viewpoints=EYES[:2]).sure
    _, half = scanned("random", LENGTH, RADIUS, gaps=((0.4, 0.6),))
    marks = curve[np.linspace(8, len(curve) - 9, 14).astype(int)]
    found = extract(half.points, RADIUS, length=LENGTH, start=start, end=end, guide_points=marks)
    assert not found.sure
    assert set(found.doubts) <= set(found.warnings)


def test_viewpoints_of_another_scan_are_noticed_and_left_aside():
    curve, scan = scanned("helix", LENGTH, RADIUS, views=1)
    start, end = ends(curve)
    found = extract(scan.points, RADIUS, length=LENGTH, start=start, end=end, viewpoints=-EYES[:1])
    assert not found.along_ray
    assert any("face none of the viewpoints" in said for said in found.warnings)


def test_a_gap_in_a_sharp_bend_is_joined():
    """Across 2.4 rad of an arc the chords of both strands face away from each other; the bend itself leads on."""
    before, after = (arc(np.linspace(*span, 20)) for span in ((-1.8, 0.0), (2.4, 4.2)))
    costs = {}
    for bent in (False, True):
        a = strand_matching._Tip(before[-1], *strand_matching._outward(before, -1, bent))
        b = strand_matching._Tip(after[0], *strand_matching._outward(after, 0, bent))
        costs[bent] = strand_matching._join_cost(a, b, 0.02, 0.13)
    assert costs[False] is None
    assert costs[True] is not None
    out, bend = strand_matching._outward(before, -1, True)
    np.testing.assert_allclose(out, [0.0, 1.0, 0.0], atol=0.05)
    np.testing.assert_allclose(bend, [-20.0, 0.0, 0.0], atol=3.0)


def arc(a, radius=0.05):
    return radius * np.stack([np.cos(a), np.sin(a), 0.0 * a], axis=1)


def test_the_scanner_has_a_sensor_without_noise():
    """Extraction from perfect points is sure, and exact to the mesh."""
    curve = shapes.FAMILIES["helix"](LENGTH, RADIUS)
    points = scanner.scan(curve, RADIUS, EYES[:2], scanner.PERFECT, 1).points
    start, end = ends(curve)
    assert extract(points, RADIUS, length=LENGTH, start=start, end=end, viewpoints=EYES[:2]).sure
