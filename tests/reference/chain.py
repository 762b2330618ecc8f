"""A discrete inextensible rod: is an equilibrium of the continuous one a minimum, and is its energy right.

N + 1 nodes at the spacing h = L/N carry frames R_i, the two outer ones given; the N - 1 inner rotations are unknown.
Positions follow by the trapezoid rule on the tangents, r_N = h sum c_i t_i with c = (1/2, 1, ..., 1, 1/2), so that the
weight is linear in the tangents too; bending and twist per link are h/2 (u - u0)^T K (u - u0), u = log(R_i^T R_i+1)/h.
The far clamp's place is the constraint r_N = r(L) with the multiplier p (N), which is minus the force n(0).
All rotations vary by R_i exp(hat(x_i)), so the Lagrangian is a sum over links and nodes and its Hessian is block
tridiagonal. A minimum is a stationary point whose Hessian, reduced to the null space of the constraint, is positive.
Shear and axial strain (1e-5 in the cases here) are left out: they move no eigenvalue across zero.

The energy of the chain differs from the continuous one by a h^2 + O(h^4), so (4 E(h/2) - E(h))/3 approximates it.
Source: J. Nocedal, S. Wright, "Numerical Optimization" (2006), 12.5 (reduced Hessian).
"""

from typing import NamedTuple

import numpy as np
import scipy.linalg

from . import rotations

STEP = 1e-5  # rad, central difference of the analytic gradient: error about 1e-10 of the stiffness
BALANCED = 1e-8  # of the largest gradient over B/L, at which Newton's iteration stops
E3 = np.array([0.0, 0.0, 1.0])


class Chain(NamedTuple):
    """Discrete equilibrium: nodes (N + 1, 3) m, frames (N + 1, 3, 3), energy J, reduced eigenvalues (N m), ascending.

    There are 3N - 6 of them; `residual` is the largest gradient over B/L, or gap over L, B the mean stiffness.
    """

    positions: np.ndarray
    frames: np.ndarray
    energy: float
    eigenvalues: np.ndarray
    residual: float


def _strain(rod, R):
    h = rod.length / (len(R) - 1)
    phi = rotations.log(np.swapaxes(R[:-1], 1, 2) @ R[1:])
    return h, phi, phi / h - rod.natural_curvature


def _tangent_loads(rod, p, count):
    """Vectors (N + 1, 3) a_i with weight energy + p . r_N = sum a_i . t_i (the start clamp is at the origin)."""
    h = rod.length / (count - 1)
    c = np.ones(count)
    c[[0, -1]] = 0.5
    beyond = c[::-1].cumsum()[::-1] - c  # node weights beyond node i, in h
    lever = c * 0
    lever[:-1] += (beyond[:-1]) / 2  # t_i moves half of link (i, i+1) ...
    lever[1:] += (beyond[:-1]) / 2  # ... and half of link (i-1, i)
    return h * c[:, None] * p + rod.weight * h**2 * lever[:, None] * E3


def positions(rod, R):
    """Nodes (N + 1, 3) of frames (N + 1, 3, 3)."""
    t = R[:, :, 2]
    h = rod.length / (len(R) - 1)
    return np.vstack([np.zeros(3), np.cumsum((t[1:] + t[:-1]) / 2 * h, axis=0)])


def energy(rod, R):
    """Elastic energy and weight (J) of frames (N + 1, 3, 3)."""
    h, _, strain = _strain(rod, R)
    return h / 2 * np.sum(strain**2 @ rod.K) + np.sum(_tangent_loads(rod, np.zeros(3), len(R)) * R[:, :, 2])


def gradient(rod, R, p):
    """Derivative (N - 1, 3) of the Lagrangian energy + p . (r_N - r(L)) along R_i exp(hat(x_i)), inner nodes."""
    _, phi, strain = _strain(rod, R)
    J = rotations.right_jacobian_inverse(phi)
    moment = strain * rod.K
    g = np.zeros((len(R), 3))
    g[1:] += np.einsum("sji,sj->si", J, moment)
    g[:-1] -= np.einsum("sij,sj->si", J, moment)
    loads = np.einsum("sji,sj->si", R, _tangent_loads(rod, p, len(R)))
    return (g + np.cross(E3, loads))[1:-1]


def hessian(rod, R, p):
    """Dense symmetric Hessian (3N - 3, 3N - 3) of the Lagrangian, every third node shifted at once."""
    inner = len(R) - 2
    H = np.zeros((inner, 3, inner, 3))
    for colour in range(3):
        nodes = np.arange(colour, inner, 3)
        for axis in range(3):
            shift = np.zeros((len(R), 3))
            shift[nodes + 1, axis] = STEP
            ahead, behind = (gradient(rod, R @ rotations.exp(sign * shift), p) for sign in (1, -1))
            change = (ahead - behind) / (2 * STEP)
            for k in range(-1, 2):
                near = nodes[(nodes + k >= 0) & (nodes + k < inner)]
                H[near + k, :, near, axis] = change[near + k]
    H = H.reshape(3 * inner, 3 * inner)
    return (H + H.T) / 2


def constraint(rod, R):
    """Derivative (3, 3N - 3) of r_N: d t_i = R_i hat(x_i) e3."""
    h = rod.length / (len(R) - 1)
    return np.concatenate(list(-h * R[1:-1] @ rotations.hat(E3)), axis=1)


def _kkt_step(H, A, g, gap):
    size = len(A)
    system = np.block([[H, A.T], [A, np.zeros((size, size))]])
    return np.linalg.solve(system, -np.concatenate([g, gap]))


def equilibrium(rod, R, p, steps=20):
    """Chain next to the frames (N + 1, 3, 3) and the multiplier p (3,), by Newton's iteration on the Lagrangian."""
    scale = np.mean(rod.K) / rod.length
    for _ in range(steps):
        g, gap = gradient(rod, R, p).ravel(), positions(rod, R)[-1] - rod.end
        residual = max(np.abs(g).max() / scale, np.abs(gap).max() / rod.length)
        if residual < BALANCED:
            break
        x = _kkt_step(hessian(rod, R, p), constraint(rod, R), g, gap)
        turn = np.vstack([np.zeros(3), x[:-3].reshape(-1, 3), np.zeros(3)])
        R, p = R @ rotations.exp(turn), p + x[-3:]
    free = scipy.linalg.null_space(constraint(rod, R))
    eigenvalues = np.linalg.eigvalsh(free.T @ hessian(rod, R, p) @ free)
    return Chain(positions(rod, R), R, energy(rod, R), eigenvalues, residual)


def of_solution(solution, links):
    """Chain with `links` links next to a solution of the continuous equations (see cosserat_bvp.Equilibrium)."""
    s = np.linspace(0, solution.rod.length, links + 1)
    R = solution.frames(s)
    R[0], R[-1] = solution.rod.start_frame, solution.rod.end_frame
    return equilibrium(solution.rod, R, -solution.forces([0.0])[0])
