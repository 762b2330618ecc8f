"""The continuous Cosserat rod as a two-point boundary value problem (scipy's `solve_bvp`): the reference, and one peer.

Unknowns (r, q, n, m): position, unit quaternion (scalar first) of the frame R, force and moment (space axes) that the part
beyond s exerts on the part before. With v = e3 + C R'n, u = K^-1 R'm and the weight w along -z,

    r' = R v,   q' = q (0, u) / 2,   n' = w e_z,   m' = -r' x n,

s measured by L, forces by B/L^2, moments by B/L, B the bending stiffness. Conditions: r and q at the start; at a clamp r and
the rotation (three numbers: the length of q is conserved), at a free end n and m. 13 in all.

Source: S. S. Antman, "Nonlinear Problems of Elasticity" (2005), chapter 8. Shares no code with the package.
"""

from typing import NamedTuple

import numpy as np
from scipy.integrate import solve_bvp
from scipy.spatial.transform import Rotation

from benchmarks.peers.problems import Problem, start_at

TIGHT = (1e-8, 1e-10)  # tolerances of the reference; what the last step still moves is its stated error
LOAD_STEPS = (0.05, 0.2, 0.5, 1.0)  # of a cantilever's weight: from the straight rod there is no one way down
_GUESS = 21  # nodes of the first mesh
_MOST = 20_000


class Curve(NamedTuple):
    """A solution: ``at(s)`` gives points (n, 3) in m; ``nodes`` of its mesh; ``answer`` of scipy."""

    problem: Problem
    answer: object

    def at(self, s) -> np.ndarray:
        """Points (n, 3) at arc lengths ``s`` (m)."""
        L = self.problem.length
        return L * self.answer.sol(np.asarray(s) / L)[:3].T

    @property
    def nodes(self) -> np.ndarray:
        """Arc lengths (m) of the mesh."""
        return self.problem.length * self.answer.x


def reference(problem: Problem) -> tuple[Curve, dict]:
    """The curve at the tightest tolerance, and what is known of its error (parts of L)."""
    s = np.linspace(0.0, problem.length, 401)
    first = solve(problem, TIGHT[0], guess(problem))
    finer = Curve(problem, _collocate(problem, first.answer.x, first.answer.y, TIGHT[1])[2])
    return finer, {
        "moved by the last refinement": _apart(first.at(s), finer.at(s)),
        "mesh nodes": len(finer.nodes),
    }


def solve(problem: Problem, tolerance: float, start: tuple) -> Curve:
    """From a mesh and its state (`guess`) to ``tolerance`` (relative residual of the collocation), by its own continuation."""
    s, y = start
    steps = LOAD_STEPS if problem.free else (1.0,)
    for share in steps:
        s, y = _collocate(problem._replace(density=share * problem.density), s, y, max(tolerance, 1e-2))[:2]
    return Curve(problem, _collocate(problem, s, y, tolerance)[2])


def _apart(a, b):
    return float(np.linalg.norm(a - b, axis=1).max())


def _scaled(p):
    """Weight, stiffnesses and the one compliance, dimensionless."""
    stiffness = np.array([1.0, 1.0, p.torsion / p.bending])
    return p.weight * p.length**3 / p.bending, stiffness, p.bending / (p.stretching * p.length**2)


def _matrix(q):
    w, x, y, z = q / np.sqrt(np.sum(q * q, axis=0))
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def _cross(a, b):
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _rate(y, load, K, C):
    q, n, m = y[3:7], y[7:10], y[10:]
    R = _matrix(q)
    u = np.einsum("ji...,j...->i...", R, m) / K.reshape(3, *[1] * (y.ndim - 1))
    tangent = R[:, 2] + C * n  # R (e3 + C R' n) with one compliance for shear and stretch
    turn = 0.5 * np.concatenate([-np.sum(q[1:] * u, axis=0)[None], q[0] * u + _cross(q[1:], u)])
    weight = np.zeros_like(n)
    weight[2] = load
    return np.concatenate([tangent, turn, weight, -_cross(tangent, n)])


def _collocate(problem, s, y, tolerance):
    load, K, C = _scaled(problem)
    first = np.concatenate([np.zeros(3), quaternion(problem.start_frame)])
    first[3:] *= np.sign(first[3:] @ y[3:7, 0])

    def ends(a, b):
        if problem.free:
            return np.concatenate([a[:7] - first, b[7:]])
        miss = _matrix(b[3:7]).T @ problem.end_frame
        turn = [miss[2, 1] - miss[1, 2], miss[0, 2] - miss[2, 0], miss[1, 0] - miss[0, 1]]
        return np.concatenate([a[:7] - first, b[:3] - problem.end / problem.length, turn])

    answer = solve_bvp(lambda _, y: _rate(y, load, K, C), ends, s, y, tol=tolerance, max_nodes=_MOST)
    if not answer.success:
        raise RuntimeError(f"{problem.name}: solve_bvp at {tolerance}: {answer.message}")
    return answer.x, answer.y, answer


def guess(problem):
    """Mesh and state of the generic curve; moments of its curvature, forces from the balance as a least square."""
    s = np.linspace(0.0, 1.0, _GUESS)
    r, R = start_at(problem, s * problem.length)
    r = r / problem.length
    q = [quaternion(R[0])]
    for x in R[1:]:
        q.append(quaternion(x) * np.sign(quaternion(x) @ q[-1]))
    q = np.array(q)
    if problem.free:
        return s, np.concatenate([r.T, q.T, np.zeros((6, _GUESS))])
    load, K, _ = _scaled(problem)
    rate = np.gradient(q, s, axis=0)
    u = 2 * (q[:, :1] * rate[:, 1:] - rate[:, :1] * q[:, 1:] - np.cross(q[:, 1:], rate[:, 1:]))
    m = np.einsum("sij,sj->si", R, u * K)
    n = _forces(s, r, m, load)
    return s, np.concatenate([r.T, q.T, n.T, m.T])


def _forces(s, r, m, load):
    """Forces (n, 3) in balance with the weight, with the constant that comes closest to m' = -r' x n."""
    tangent, weight = np.gradient(r, s, axis=0), load * s[:, None] * np.array([0.0, 0, 1])
    rows = np.array([[[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]] for t in tangent]).reshape(-1, 3)
    right = (-np.gradient(m, s, axis=0) - np.cross(tangent, weight)).ravel()
    return np.linalg.lstsq(rows, right, rcond=None)[0] + weight


def quaternion(R) -> np.ndarray:
    """Unit quaternion (scalar first) of a rotation matrix."""
    return Rotation.from_matrix(R).as_quat(scalar_first=True)
