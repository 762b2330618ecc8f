"""The whole chain on scans of known curves: accuracy, one-sidedness, gaps, clutter, guide points, refusals."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.scan import cloud, extract, scanner, shapes
from tests.scan.truth import EYES, ends, errors, extracted, scanned

LENGTH, RADIUS = 1.0, 0.012
NOISE = scanner.STRUCTURED_LIGHT.noise


@pytest.mark.slow
def test_structured_light_without_guide_points():
    curve, scan = scanned("random", LENGTH, RADIUS)
    found = extracted(scan.points, curve, RADIUS)
    rms, shift, length = errors(found, curve, RADIUS, 2)
    assert rms < 0.3 * NOISE
    assert shift < 0.2
    assert abs(length) < 0.005
    assert abs(found.radius.mean / RADIUS - 1.0) < 0.02
    assert found.found_by == "cloud"


@pytest.mark.slow
def test_a_scan_from_one_side_does_not_pull_the_curve_to_the_sensor():
    curve, scan = scanned("helix", LENGTH, RADIUS, views=1)
    found = extracted(scan.points, curve, RADIUS)
    _, shift, _ = errors(found, curve, RADIUS, 1)
    assert abs(shift) < 0.02  # the mean of the points would be off by 0.6


@pytest.mark.slow
def test_a_noisy_scan_without_viewpoints_says_what_it_may_do():
    curve, scan = scanned("loop", LENGTH, 0.004, scanner.TIME_OF_FLIGHT, views=1, key=5)
    found = extracted(scan.points, curve, 0.004)
    assert any("give the viewpoints" in said for said in found.warnings)


@pytest.mark.slow
def test_a_gap_is_bridged_and_marked():
    gap = (0.35, 0.45)
    curve, scan = scanned("random", LENGTH, RADIUS, views=3, gaps=(gap,))
    found = extracted(scan.points, curve, RADIUS)
    assert len(found.gaps) == 1
    np.testing.assert_allclose(found.gaps[0], gap, atol=0.01)
    inside = (found.arc_length > gap[0] + 0.02) & (found.arc_length < gap[1] - 0.02)
    assert found.std[inside].min() > 2.0 * np.median(found.std)
    assert any("no points were seen" in said for said in found.warnings)


@pytest.mark.slow
def test_an_island_of_points_does_not_lead_the_curve_across_a_gap():
    """Nothing of the cable is seen over an eighth of its length, in the middle of which a short rod passes beside it."""
    gap = (0.38, 0.505)
    curve = shapes.FAMILIES["loop"](LENGTH, RADIUS)
    place, tangent, side, up = beside(curve, 0.44)
    piece = place + RADIUS * side + np.linspace(-0.012, 0.012, 9)[:, None] * (tangent + 0.5 * up)
    strange = scanner.tube_mesh(piece, RADIUS)
    scan = scanner.scan(curve, RADIUS, EYES[:2], scanner.STRUCTURED_LIGHT, 4, gaps=(gap,), clutter=[strange])
    found = extracted(scan.points, curve, RADIUS)
    ((low, high),) = found.gaps
    assert abs(low - gap[0]) < 0.01 and abs(high - gap[1]) < 0.01
    away = cKDTree(shapes.resample(curve, 8001)).query(found.points)[0]
    assert away[found.seen].max() < 1e-3
    assert away.max() < 3e-3


def beside(curve, place):
    """Point, unit tangent and two unit normals of a curve at a fraction of its length."""
    k = int(place * len(curve))
    d3 = np.gradient(curve, axis=0)[k]
    side = np.cross(d3, [0.1, 0.2, 1.0])
    d3, side = d3 / np.linalg.norm(d3), side / np.linalg.norm(side)
    return curve[k], d3, side, np.cross(side, d3)


def branch(curve):
    at, d3, side, _ = beside(curve, 0.4)
    return scanner.tube_mesh(at + np.linspace(0, 0.3, 60)[:, None] * (0.45 * d3 + 0.89 * side), RADIUS)


def touching(curve):
    at, d3, side, up = beside(curve, 0.5)
    u = np.linspace(-0.35, 0.35, 80)[:, None]
    return scanner.tube_mesh(at + 2.0 * RADIUS * up + u * (0.76 * d3 + 0.64 * side) + 0.5 * u**2 * up, RADIUS)


def connector(curve):
    at, d3, *_ = beside(curve, 0.6)
    place = trimesh.geometry.align_vectors([0.0, 0.0, 1.0], d3)
    place[:3, 3] = at
    return trimesh.creation.box((0.04, 0.04, 0.06), transform=place)


@pytest.mark.slow
@pytest.mark.parametrize("thing", [branch, touching, connector])
def test_what_touches_the_cable_does_not_draw_the_curve(thing):
    """Another cable is left aside. Where a connector hides the cable there is a gap, which is said."""
    curve = shapes.random_smooth(LENGTH, RADIUS)
    points = scanner.scan(curve, RADIUS, EYES[:2], scanner.STRUCTURED_LIGHT, 3, clutter=[thing(curve)]).points
    found = extracted(points, curve, RADIUS)
    away, _ = cKDTree(shapes.resample(curve, 8001)).query(found.points)
    assert found.sure
    assert away.max() < 1e-3
    if thing is connector:
        ((low, high),) = found.gaps
        assert low < 0.57 and high > 0.63
        assert any("connector" in said for said in found.warnings)
    else:
        assert not found.gaps


@pytest.mark.slow
def test_fragments_are_joined_and_a_missing_end_is_not_invented():
    gaps = ((0.1, 0.16), (0.3, 0.36), (0.5, 0.57), (0.7, 0.76))
    curve, scan = scanned("random", LENGTH, RADIUS, key=3, gaps=gaps)
    found = extracted(scan.points, curve, RADIUS)
    np.testing.assert_allclose(found.gaps, gaps, atol=0.01)
    assert errors(found, curve, RADIUS, 2)[0] < NOISE
    _, short = scanned("random", LENGTH, RADIUS, key=3, gaps=((0.8, 1.0),))
    with pytest.raises(Scan2FlexError, match="mark guide points"):
        extracted(short.points, curve, RADIUS)


def test_guide_points_and_a_table():
    curve = shapes.figure_of_eight(LENGTH, RADIUS)
    scan = scanner.scan(curve, RADIUS, EYES[:2], scanner.STRUCTURED_LIGHT, 3, clutter=[scanner.table(curve, RADIUS)])
    marks = curve[np.linspace(8, len(curve) - 9, 14).astype(int)] + np.array([0.0, 0.0, RADIUS])
    found = extract(scan.points, RADIUS, length=LENGTH, guide_points=marks)
    rms, _, _ = errors(found, curve, RADIUS, 2)
    assert rms < 0.3 * NOISE


@pytest.mark.slow
def test_a_bend_that_was_seen_thinly_is_followed():
    """One view of a loop above a table: the coarse curve cuts across the bend, further from it than the tube of points around
    the curve is wide. The points of the bend are taken in once a finer curve passes near them."""
    curve = shapes.loop(LENGTH, 0.004)
    clutter = [scanner.table(curve, 0.004)]
    points = scanner.scan(curve, 0.004, EYES[:1], scanner.STRUCTURED_LIGHT, 75, clutter=clutter).points
    found = extracted(points, curve, 0.004, viewpoints=EYES[:1])
    rms, shift, length = errors(found, curve, 0.004, 1)
    assert rms < 0.3 * NOISE
    assert shift < 0.2
    assert abs(length) < 0.005
    assert found.sure and not found.gaps


def test_a_table_is_left_out_however_thinly_it_was_seen():
    curve, scan = scanned("loop", LENGTH, 0.004)
    size, rng = [0.8, 0.6, 0.0], np.random.default_rng(3)
    table = rng.uniform(-0.5, 0.5, (2000, 3)) * size + [0.0, 0.0, curve[:, 2].min() - 0.1]
    kept = cloud.off_planes(np.concatenate([scan.points, table]), 0.004)
    assert kept[len(scan.points) :].sum() < 20
    assert kept[: len(scan.points)].mean() > 0.99


@pytest.mark.slow
def test_noise_as_large_as_the_radius_lets_the_last_stage_settle():
    """Flying pixels take information from the points beside them; a step that overlooks it goes to and fro for ever."""
    curve = shapes.loop(LENGTH, 0.004)
    points = scanner.scan(curve, 0.004, EYES[:2], scanner.TIME_OF_FLIGHT, 88).points
    found = extracted(points, curve, 0.004, viewpoints=EYES[:2])
    rms, shift, _ = errors(found, curve, 0.004, 2)
    assert found.sure
    assert rms < 0.5 * scanner.TIME_OF_FLIGHT.noise
    assert abs(shift) < 0.2


@pytest.fixture(scope="module")
def good():
    curve, scan = scanned("random", LENGTH, RADIUS)
    start, end = ends(curve)
    return scan.points, {"length": LENGTH, "start": start, "end": end}, curve


BAD = {
    "millimetres": (lambda p: 1000.0 * p, "millimetres"),
    "empty": (lambda p: p[:0], "0 points"),
    "NaN": (lambda p: np.where(np.arange(len(p))[:, None] == 7, np.nan, p), "not finite"),
    "another frame": (lambda p: p + 5.0, "clamps"),
    "no cable": (lambda p: np.random.default_rng(0).normal(size=(3000, 3)) * 0.1 + p.mean(axis=0), "cable|trusted|path"),
}


@pytest.mark.parametrize("fault", BAD)
def test_bad_clouds_are_refused_in_one_sentence(good, fault):
    points, known, _ = good
    change, word = BAD[fault]
    with pytest.raises(Scan2FlexError, match=word) as refusal:
        extract(change(points), RADIUS, **known)
    assert "\n" not in str(refusal.value)


def test_guide_points_in_a_wrong_order_are_refused(good):
    points, known, curve = good
    marks = curve[np.linspace(10, len(curve) - 11, 9).astype(int)]
    with pytest.raises(Scan2FlexError, match="wrong order"):
        extract(points, RADIUS, guide_points=marks[[0, 5, 2, 7, 4, 1, 6, 3, 8]], **known)


@pytest.mark.slow
def test_a_wrong_radius_or_length_is_reported(good):
    points, known, _ = good
    found = extract(points, RADIUS, **(known | {"length": 1.03 * LENGTH}))
    assert any("where the study says 1.03 m" in said for said in found.warnings)


@pytest.mark.slow
def test_a_good_scan_is_sure_and_a_fifth_of_the_length_unseen_is_not():
    curve, scan = scanned("random", LENGTH, RADIUS)
    assert extracted(scan.points, curve, RADIUS, viewpoints=EYES[:2]).sure
    _, half = scanned("random", LENGTH, RADIUS, gaps=((0.4, 0.6),))
    marks = curve[np.linspace(8, len(curve) - 9, 14).astype(int)]
    found = extracted(half.points, curve, RADIUS, guide_points=marks)
    assert not found.sure
    assert set(found.doubts) <= set(found.warnings)


@pytest.mark.slow
def test_viewpoints_of_another_scan_are_noticed_and_left_aside():
    curve, scan = scanned("helix", LENGTH, RADIUS, views=1)
    found = extracted(scan.points, curve, RADIUS, viewpoints=-EYES[:1])
    assert not found.along_ray
    assert any("face none of the viewpoints" in said for said in found.warnings)
