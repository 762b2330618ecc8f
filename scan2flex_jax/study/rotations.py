"""Checks of rotation matrices, their conversion to the format's quaternions, and rolls and twists of quaternions.

The columns of a rotation are d1, d2, d3 in the scan frame; a quaternion is [w, x, y, z].
"""

from typing import Annotated, Any

import numpy as np

from scan2flex_jax.errors import StudyError
from scan2flex_jax.study import values as v
from scan2flex_jax.study.values import Where

TRANSPORTED = 24  # averaged points of a curve for transporting a frame: more add noise
_TINY = 1e-12
_ROUNDING = 1e-15  # an entry below it is zero: of a frame along the axes, whose study people read
RIGID = 2e-3  # largest entries of R'R - 1 for matrices printed with three digits


def checked_rotation(matrix: Any, where: Where) -> Annotated[np.ndarray, "3 3"]:
    """A 3x3 matrix with unit, orthogonal, right-handed columns, to within `RIGID`."""
    R = _matrix(matrix, [(3, 3)], "a rotation has 3x3", where)
    if np.max(np.abs(R.T @ R - np.eye(3))) > RIGID or np.linalg.det(R) < 0:
        raise where.fail("the 3x3 matrix is no rotation: its columns must be unit, orthogonal and right-handed.")
    return R


def rigid_motion(matrix: Any, where: Where) -> tuple[Annotated[np.ndarray, "3"], Annotated[np.ndarray, "3 3"]]:
    """Position and rotation of a homogeneous 4x4 (or 3x4) matrix, whose last column is the position."""
    M = _matrix(matrix, [(4, 4), (3, 4)], "a frame has 4x4 (or 3x4)", where)
    if len(M) == 4 and not np.allclose(M[3], [0, 0, 0, 1], atol=1e-9):
        turned = np.allclose(M[:3, 3], 0) and np.isclose(M[3, 3], 1)
        advice = "it seems to be transposed: write the position in the last column" if turned else "write 0 0 0 1 there"
        raise where.fail(f"the last row of the matrix is {M[3].tolist()}: {advice}.")
    return M[:3, 3], checked_rotation(M[:3, :3], where)


def quaternion_of(R: Annotated[np.ndarray, "3 3"]) -> Annotated[np.ndarray, "4"]:
    """The unit quaternion [w, x, y, z] with w >= 0 of the rotation nearest to a checked matrix."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415  (it loads slowly, and most studies have quaternions)

    quaternion = Rotation.from_matrix(np.array(R)).as_quat(canonical=True, scalar_first=True)
    quaternion /= np.linalg.norm(quaternion)
    return np.where(np.abs(quaternion) < _ROUNDING, 0.0, quaternion)


def _matrix(matrix: Any, shapes: list[tuple[int, int]], wanted: str, where: Where) -> Annotated[np.ndarray, "r c"]:
    """A matrix of one of `shapes`, of finite numbers."""
    try:
        return np.asarray(v.array(matrix, shapes, where))
    except StudyError:
        raise where.fail(f"{wanted} finite numbers, and this is {v.shown(v.plain(matrix))}.") from None


def product(p: Annotated[np.ndarray, "4"], q: Annotated[np.ndarray, "4"]) -> Annotated[np.ndarray, "4"]:
    """The quaternion [w, x, y, z] of R(p) R(q)."""
    w = p[0] * q[0] - p[1:] @ q[1:]
    return np.r_[w, p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])]


def rolled(quaternion: Annotated[np.ndarray, "4"], angle: float) -> Annotated[np.ndarray, "4"]:
    """The quaternion of a frame rolled about its own d3 by an angle (rad)."""
    return product(quaternion, np.array([np.cos(0.5 * angle), 0.0, 0.0, np.sin(0.5 * angle)]))


def twist_along(
    points: Annotated[np.ndarray, "n 3"], start: Annotated[np.ndarray, "4"], end: Annotated[np.ndarray, "4"]
) -> float:
    """Angle (rad, up to half a turn) about d3 between an end frame and the start frame transported along a curve without twist.

    Without points the frame is rotated from one d3 to the other by the smallest rotation."""
    blocks = np.array_split(np.asarray(points), min(len(points), TRANSPORTED)) if len(points) else []
    chords = np.diff([block.mean(axis=0) for block in blocks], axis=0) if len(blocks) > 1 else np.zeros((0, 3))
    d1, tangent = columns(start)[:, 0], columns(start)[:, 2]
    for chord in [*chords, columns(end)[:, 2]]:
        onward = chord / np.linalg.norm(chord)
        d1 = d1 - (d1 @ onward) / (1.0 + tangent @ onward + _TINY) * (tangent + onward)
        tangent = onward
    frame = columns(end)
    return float(np.arctan2(-(frame[:, 1] @ d1), frame[:, 0] @ d1))


def between(a: Annotated[np.ndarray, "3"], b: Annotated[np.ndarray, "3"]) -> float:
    """Angle (rad) between two vectors."""
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def columns(quaternion: Annotated[np.ndarray, "4"]) -> Annotated[np.ndarray, "3 3"]:
    """The rotation matrix of a unit quaternion [w, x, y, z]: columns d1, d2, d3."""
    w, x, y, z = quaternion
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2 * (w * K + K @ K)
