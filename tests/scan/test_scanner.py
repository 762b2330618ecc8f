"""The scanner: what it sees is on the tube, faces it, and is wrong by what its parameters say."""

import numpy as np
from scipy.spatial import cKDTree

from scan2flex_jax.scan import PERFECT, STRUCTURED_LIGHT, TIME_OF_FLIGHT, scan, shapes, tube_mesh

EYE = np.array([[0.2, -1.0, 0.4]])
LENGTH, RADIUS = 1.0, 0.02


def test_the_tube_is_closed_and_has_the_volume_of_the_cable():
    for family in shapes.FAMILIES.values():
        mesh = tube_mesh(family(LENGTH, RADIUS), RADIUS)
        assert mesh.is_watertight
        assert abs(mesh.volume / (np.pi * RADIUS**2 * LENGTH) - 1.0) < 1e-3  # Pappus: the curvature does not matter


def test_a_perfect_sensor_sees_the_near_side_of_the_surface_only():
    curve = shapes.helix(LENGTH, RADIUS)
    points = scan(curve, RADIUS, EYE, PERFECT, 1).points
    away, which = cKDTree(shapes.resample(curve, 8001)).query(points)
    middle = (which > 200) & (which < 7800)
    np.testing.assert_allclose(away[middle], RADIUS, rtol=5e-3)
    off = points - shapes.resample(curve, 8001)[which]
    assert np.all(np.sum(off * (EYE[0] - points), axis=1)[middle] > 0.0)


def test_noise_is_as_declared_and_the_key_decides():
    curve = shapes.random_smooth(LENGTH, RADIUS)
    one, two, three = (scan(curve, RADIUS, EYE, STRUCTURED_LIGHT, key) for key in (1, 1, 2))
    np.testing.assert_array_equal(one.points, two.points)
    assert not np.array_equal(one.points, three.points)
    assert abs((~one.on_cable).mean() - STRUCTURED_LIGHT.outliers) < 0.005
    flown = scan(curve, RADIUS, EYE, TIME_OF_FLIGHT, 1)
    assert (~flown.on_cable).mean() > TIME_OF_FLIGHT.outliers


def test_a_gap_holds_no_points_and_a_strand_hides_another():
    curve = shapes.random_smooth(LENGTH, RADIUS)
    points = scan(curve, RADIUS, EYE, PERFECT, 1, gaps=((0.4, 0.5),)).points
    s = shapes.arc_length(curve)[cKDTree(curve).query(points)[1]]
    assert not np.any((s > 0.405) & (s < 0.495))
    line = np.linspace([-0.3, 0.0, 0.0], [0.3, 0.0, 0.0], 101)
    front = tube_mesh(line[40:61] - [0, 0.2, 0], RADIUS)
    behind = scan(line, RADIUS, np.array([[0.0, -1.0, 0.0]]), PERFECT, 1, clutter=[front])
    on = behind.points[behind.on_cable]
    assert not np.any(np.abs(on[:, 0]) < 0.04)
