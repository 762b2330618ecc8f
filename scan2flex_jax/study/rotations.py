"""Rotation matrices of frames, checked, and made into the format's quaternions.

The columns of a rotation are d1, d2, d3 in the scan frame; a quaternion is [w, x, y, z].
"""

from typing import Annotated, Any

import numpy as np

from scan2flex_jax.study.values import LARGEST, Where, as_array, shown

RIGID = 2e-3
"""Entries of R'R - 1 that matrices printed with three digits leave."""


def checked_rotation(matrix: Any, where: Where) -> Annotated[np.ndarray, "3 3"]:
    """A 3x3 matrix with unit, orthogonal, right-handed columns, to within `RIGID`."""
    R = _matrix(matrix, ((3, 3),), "a rotation has 3x3 finite numbers", where)
    if np.max(np.abs(R.T @ R - np.eye(3))) > RIGID or np.linalg.det(R) < 0:
        raise where.fail("the 3x3 matrix is no rotation: its columns must be unit, orthogonal and right-handed.")
    return R


def rigid_motion(matrix: Any, where: Where) -> tuple[Annotated[np.ndarray, "3"], Annotated[np.ndarray, "3 3"]]:
    """Position and rotation of a homogeneous 4x4 (or 3x4) matrix, whose last column is the position."""
    M = _matrix(matrix, ((4, 4), (3, 4)), "a frame has 4x4 (or 3x4) finite numbers", where)
    if len(M) == 4 and not np.allclose(M[3], [0, 0, 0, 1], atol=1e-9):
        turned = np.allclose(M[:3, 3], 0) and np.isclose(M[3, 3], 1)
        advice = "it seems to be transposed: write the position in the last column" if turned else "write 0 0 0 1 there"
        raise where.fail(f"the last row of the matrix is {M[3].tolist()}: {advice}.")
    return M[:3, 3], checked_rotation(M[:3, :3], where)


def quaternion_of(R: Annotated[np.ndarray, "3 3"]) -> Annotated[np.ndarray, "4"]:
    """The unit quaternion [w, x, y, z] with w >= 0 of the rotation nearest to a checked matrix."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415  (it loads slowly, and most studies have quaternions)

    quaternion = Rotation.from_matrix(np.array(R)).as_quat(canonical=True, scalar_first=True)
    return quaternion / np.linalg.norm(quaternion)


def _matrix(matrix: Any, shapes: tuple[tuple[int, int], ...], wanted: str, where: Where) -> Annotated[np.ndarray, "r c"]:
    """A matrix of one of `shapes`, in float64."""
    try:
        M = as_array(matrix)
    except (TypeError, ValueError) as error:
        raise where.fail(f"{wanted}: got {shown(matrix)}.") from error
    if M.shape not in shapes:
        raise where.fail(f"{wanted}, this one has the shape {M.shape}.")
    if M.dtype.kind not in "iuf" or not np.all(np.abs(M) <= LARGEST):
        raise where.fail(f"{wanted}, and this one has others.")
    return M.astype(np.float64)
