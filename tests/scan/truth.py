"""Known curves, scanned, and the errors of what is extracted from them."""

import numpy as np
from scipy.spatial import cKDTree

from scan2flex_jax.scan import End, extract, scanner, shapes

EYES = np.array([[0.3, -1.0, 0.6], [0.3, 1.0, 0.5], [-1.0, 0.1, 0.6]])


def ends(curve):
    tangent = np.gradient(curve, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return End(curve[0], tangent[0]), End(curve[-1], tangent[-1])


def scanned(family, length, radius, sensor=scanner.STRUCTURED_LIGHT, views=2, key=1, **more):
    curve = shapes.FAMILIES[family](length, radius)
    return curve, scanner.scan(curve, radius, EYES[:views], sensor, key, **more)


def extracted(points, curve, radius, length=1.0, **more):
    """The centre curve of points between the ends of a known curve, in m."""
    start, end = ends(curve)
    return extract(points, radius, length=length, start=start, end=end, **more)


def errors(found, curve, radius, views):
    """RMS distance (m), shift toward the sensors over the radius, relative error of the length from clamp to clamp."""
    fine = shapes.resample(curve, 8001)
    away, which = cKDTree(fine).query(found.points)
    look = EYES[:views].mean(axis=0) - fine[which]
    look /= np.linalg.norm(look, axis=1, keepdims=True)
    shift = np.mean(np.sum((found.points - fine[which]) * look, axis=1)) / radius
    whole = found.length + np.linalg.norm(found.points[0] - curve[0]) + np.linalg.norm(found.points[-1] - curve[-1])
    return np.sqrt(np.mean(away**2)), shift, whole / shapes.arc_length(fine)[-1] - 1.0
