"""Is an equilibrium a minimum of the energy?  The second variation, condensed onto the mesh nodes.

The linearised equations carry a small displacement, rotation and their forces `(u, p)` across an interval,
`u_b = a u_a + b p_a`, `p_b = c u_a + d p_a`. Solved for the forces this is the interval's exact stiffness matrix,

    K = [[b^-1 a, -b^-1], [c - d b^-1 a, d b^-1]],

a minimum over everything inside the interval (which is far too short to buckle by itself). Their sum over the
intervals, with the clamped rows removed, has as many negative eigenvalues as the energy has directions of descent.
Against the mass of the cable, `K x = omega^2 M x`, the lowest `omega^2` (1/s^2) also tells how near buckling is.
Reference: Sylvester's law of inertia with static condensation (Wittrick and Williams, Q. J. Mech. Appl. Math. 1971).
"""

import numpy as np
from scipy.linalg import LinAlgError, cholesky_banded

from . import quaternions as qt
from . import rod

BISECTIONS = 14


def node_blocks(F, y):
    """Diagonal and upper off-diagonal 6 x 6 blocks of the assembled stiffness."""
    _, A, B = rod.intervals(F, y, True)
    T = -np.linalg.solve(B, A)
    E = np.zeros((*y.shape[:2], 13, 12))
    E[..., :3, :3] = np.eye(3)
    E[..., 3:7, 3:6] = qt.spin(y[..., 3:7])
    E[..., 7:, 6:] = np.eye(6)
    back = np.swapaxes(E, -1, -2).copy()
    back[..., 3:6, 3:7] *= 4  # spin^T spin = 1/4 for a unit quaternion
    T = back[:, 1:] @ T @ E[:, :-1]
    a, b, c, d = T[..., :6, :6], T[..., :6, 6:], T[..., 6:, :6], T[..., 6:, 6:]
    inverse = np.linalg.inv(b)
    diagonal = np.zeros((*y.shape[:2], 6, 6))
    diagonal[:, :-1] += inverse @ a
    diagonal[:, 1:] += d @ inverse
    upper, lower = -inverse, c - d @ inverse @ a
    return diagonal, 0.5 * (upper + np.swapaxes(lower, -1, -2))


def stiffness(F, y):
    """Banded lower storage of the stiffness of each pose, boundary conditions applied."""
    diagonal, upper = node_blocks(F, y)
    diagonal = 0.5 * (diagonal + np.swapaxes(diagonal, -1, -2))
    if F.grip[0]:
        diagonal[:, 0, 3:, 3:] += np.eye(3) / F.grip[0]
    if F.grip[1]:
        diagonal[F.end_kind == rod.CLAMP, -1, 3:, 3:] += np.eye(3) / F.grip[1]
    _hold(diagonal, upper, 0, np.full(len(y), rod.CLAMP), F.grip[0])
    _hold(diagonal, upper, -1, F.end_kind, F.grip[1])
    P, nodes = diagonal.shape[:2]
    band = np.zeros((P, 12, 6 * nodes))
    i, j = np.arange(6)[:, None], np.arange(6)
    for k in range(nodes):
        low = i >= j
        band[:, (i - j)[low], (6 * k + j + 0 * i)[low]] = diagonal[:, k][:, low]
        if k + 1 < nodes:
            band[:, 6 + j - i, 6 * k + i + 0 * j] = upper[:, k]
    return band


def _hold(diagonal, upper, node, kinds, grip):
    held = np.zeros((len(kinds), 6), bool)
    held[kinds != rod.FREE, :3] = True
    if not grip:
        held[kinds == rod.CLAMP, 3:] = True
    p, k = np.nonzero(held)
    edge = 0 if node == 0 else -1
    diagonal[p, node, k, :] = 0
    diagonal[p, node, :, k] = 0
    diagonal[p, node, k, k] = 1e3
    if node == 0:
        upper[p, edge, k, :] = 0
    else:
        upper[p, edge, :, k] = 0


def lowest_square_frequency(F, y, density):
    """The lowest `omega^2` of each pose, 1/s^2; minus one where the state is no minimum."""
    band = stiffness(F, y)
    h = np.real(F.length) * np.diff(F.sigma)
    mass = np.zeros((len(F.sigma), 6))
    mass[1:, :3] += 0.5 * density * h[:, None]
    mass[:-1, :3] += 0.5 * density * h[:, None]
    mass[[0, -1]] = 0  # held ends carry none; at a free end the half interval does not matter
    unit = 9.81 / np.real(F.length)
    return np.array([_lowest(K, mass.ravel(), unit) for K in band])


def _lowest(K, mass, unit):
    def stable(square):
        shifted = K.copy()
        shifted[0] -= square * mass
        try:
            cholesky_banded(shifted, lower=True)
        except LinAlgError:
            return False
        return True

    if not stable(0.0):
        return -1.0
    low, high = 1e-3 * unit, 1e3 * unit
    for _ in range(BISECTIONS):
        mid = np.sqrt(low * high)
        low, high = (mid, high) if stable(mid) else (low, mid)
    return low
