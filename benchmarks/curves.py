"""Curves through points in space: tangents, arc lengths, frames carried along, and points of a tube's surface."""

import numpy as np
from scipy.spatial.transform import Rotation


def unit_tangents(curve) -> np.ndarray:
    """Unit tangents (n, 3) of a curve (n, 3)."""
    tangent = np.gradient(curve, axis=0)
    return tangent / np.linalg.norm(tangent, axis=1, keepdims=True)


def arc_lengths(curve) -> np.ndarray:
    """Length of the polygon up to each of its points."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])


def shortest_turn(a, b) -> Rotation:
    """The shortest rotation from one unit vector to another."""
    axis = np.cross(a, b)
    sine = np.linalg.norm(axis)
    return Rotation.from_rotvec(axis / max(sine, 1e-300) * np.arctan2(sine, a @ b))


def carried(tangents, frame) -> np.ndarray:
    """Frames (n, 3, 3) with d3 along the tangents, each turned the shortest way from the one before, first ``frame``."""
    frames = []
    for tangent in tangents:
        frame = shortest_turn(frame[:, 2], tangent).as_matrix() @ frame
        frames.append(frame)
    return np.array(frames)


def on_the_seen_side(curve, at, radius: float, eye) -> np.ndarray:
    """Points of the surface at the indices ``at`` of a centre curve, on the side that a viewpoint sees."""
    tangent, look = unit_tangents(curve)[at], eye - curve[at]
    look -= np.sum(look * tangent, axis=1, keepdims=True) * tangent
    return curve[at] + radius * look / np.linalg.norm(look, axis=1, keepdims=True)
