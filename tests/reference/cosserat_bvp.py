"""The continuous Cosserat rod between two clamps under its own weight, by collocation (scipy.integrate.solve_bvp).

Symbols: s arc length in [0, L] (m), r position (m), R = (d1, d2, d3) frame as columns, d3 the tangent of an unsheared
rod, n force (N) and m moment (N m) that the part beyond s exerts on the part before it, in space; u, v body strains;
K = (EI1, EI2, GJ) (N m^2), compliance C = (1/GA1, 1/GA2, 1/EA) (1/N), zero for an inextensible, unshearable rod;
u0 natural curvature (1/m), w weight per length (N/m) along -z.

r' = R v, R' = R hat(u), n' = w e_z, m' = -r' x n, with v = e3 + C R^T n and u = u0 + K^-1 R^T m. The 13 unknowns are
(r, q, n, m), q the unit quaternion of R; conditions: r and R at both ends, 7 + 6 (the length of q is conserved).
Inside, lengths are measured by L, forces by B/L^2 and moments by B/L with B the mean of K.
Energy: E = int 1/2 (u - u0)^T K (u - u0) + 1/2 (R^T n)^T C (R^T n) + w z ds, heights from z = 0 of the given frame.

A clamped rod has many equilibria. The caller's curve picks one: its frames come from parallel transport with the
remaining twist spread evenly, its forces from the overall balance, and the answer tells its lowest point.

Source: S. S. Antman, "Nonlinear Problems of Elasticity" (2005), chapter 8.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_bvp, solve_ivp
from scipy.optimize import minimize_scalar

from . import rotations

RESIDUAL = 1e-9  # relative, of the collocation; the positions are then good to about 1e-10 L
COARSE_RESIDUAL = 1e-3  # of the first pass on the mesh of the guess
MAX_NODES = 20_000
HANDED_ON = 300  # nodes of a mesh that the next rod starts from: scipy adds nodes and never takes any away
E3 = np.array([0.0, 0.0, 1.0])


class Clamped(NamedTuple):
    """A rod between two clamps; frames are (3, 3) with the directors as columns."""

    length: float
    K: NDArray
    weight: float
    end: NDArray
    end_frame: NDArray
    start_frame: NDArray
    natural_curvature: NDArray = np.zeros(3)
    compliance: NDArray = np.zeros(3)
    turns: int = 0  # full turns on top of the twist that the guess curve leaves, which lies in (-pi, pi]


class Equilibrium:
    """State of a solved rod; every method takes arc lengths s (n,) in metres."""

    def __init__(self, rod, solution):
        self.rod, self._solution = rod, solution
        self._B = np.mean(rod.K)

    def _state(self, s):
        return self._solution.sol(np.asarray(s, float) / self.rod.length)

    def positions(self, s):
        """(n, 3) in m."""
        return self.rod.length * self._state(s)[:3].T

    def frames(self, s):
        """(n, 3, 3), directors as columns."""
        return np.moveaxis(rotations.matrix(self._state(s)[3:7]), -1, 0)

    def forces(self, s):
        """(n, 3) in N, in space."""
        return self._B / self.rod.length**2 * self._state(s)[7:10].T

    def moments(self, s):
        """(n, 3) in N m, in space."""
        return self._B / self.rod.length * self._state(s)[10:].T

    def energy(self):
        """Total potential energy (J), Gauss-Legendre on 200 panels."""
        x, weights = np.polynomial.legendre.leggauss(5)
        h = self.rod.length / 200
        s = (h * (np.arange(200)[:, None] + (x + 1) / 2)).ravel()
        R = self.frames(s)
        m = np.einsum("sji,sj->si", R, self.moments(s))
        n = np.einsum("sji,sj->si", R, self.forces(s))
        density = m**2 @ (0.5 / self.rod.K) + n**2 @ (0.5 * self.rod.compliance)
        density += self.rod.weight * self.positions(s)[:, 2]
        return density @ np.tile(weights * h / 2, 200)

    def lowest(self):
        """(z, s) of the lowest point, both in m."""
        s = np.linspace(0, self.rod.length, 401)
        i = np.clip(np.argmin(self.positions(s)[:, 2]), 1, 399)
        best = minimize_scalar(
            lambda x: self.positions([x])[0, 2], bounds=(s[i - 1], s[i + 1]), method="bounded", options={"xatol": 1e-10}
        )
        return float(best.fun), float(best.x)

    def shooting_error(self):
        """Largest miss (in L, and rad) of the far clamp when integrated as an initial value problem from s = 0."""
        options = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-12}
        end = solve_ivp(lambda s, y: _rhs(s, y, self.rod), (0, 1), self._state(0.0), **options).y[:, -1]
        turn = rotations.log(self.rod.end_frame.T @ rotations.matrix(end[3:7]))
        return max(np.abs(end[:3] - self.rod.end / self.rod.length).max(), np.abs(turn).max())


def _rhs(_, y, rod):
    """Dimensionless derivative (13, ...) of y = (r, q, n, m), components leading."""
    L, B = rod.length, np.mean(rod.K)
    shape = (3,) + (1,) * (y.ndim - 1)
    q, n, m = y[3:7], y[7:10], y[10:]
    R = rotations.matrix(q)
    u = (L * rod.natural_curvature).reshape(shape) + np.einsum("ji...,j...->i...", R, m) / (rod.K / B).reshape(shape)
    v = E3.reshape(shape) + (rod.compliance * B / L**2).reshape(shape) * np.einsum("ji...,j...->i...", R, n)
    tangent = np.einsum("ij...,j...->i...", R, v)
    q_rate = 0.5 * rotations.multiply(q, np.concatenate([np.zeros_like(u[:1]), u]))
    load = np.zeros_like(n)
    load[2] = rod.weight * L**3 / B
    return np.concatenate([tangent, q_rate, load, -np.cross(tangent, n, axis=0)])


def _transport(tangents, frame):
    """Frames (n, 3, 3) that follow the tangents (n, 3) from `frame` without turning about them."""
    frames = [frame]
    for a, b in pairwise(tangents):
        axis = np.cross(a, b)
        sine = np.linalg.norm(axis)
        turn = axis * (np.arctan2(sine, a @ b) / sine if sine > 1e-14 else 1.0)
        frames.append(rotations.exp(turn) @ frames[-1])
    return np.array(frames)


def _guess(rod, curve):
    """Dimensionless guess: mesh (n,) in [0, 1] and state (13, n) from positions (n, 3) along the rod."""
    steps = np.linalg.norm(np.diff(curve, axis=0), axis=1)
    s = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
    r = curve / rod.length
    tangents = np.gradient(r, s, axis=0)
    tangents[0], tangents[-1] = rod.start_frame[:, 2], rod.end_frame[:, 2]
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    frames = _transport(tangents, rod.start_frame)
    left = rotations.log(frames[-1].T @ rod.end_frame)[2] + 2 * np.pi * rod.turns
    frames = frames @ rotations.exp(np.outer(s * left, E3))
    turns = rotations.log(np.swapaxes(frames[:-1], 1, 2) @ frames[1:]) / np.diff(s)[:, None]
    u = np.stack([np.interp(s, (s[1:] + s[:-1]) / 2, turns[:, i]) for i in range(3)], axis=1)
    m = np.einsum("sij,sj->si", frames, (u - rod.length * rod.natural_curvature) * rod.K / np.mean(rod.K))
    n, m = _balanced(rod, s, r, m)
    q = [rotations.quaternion(rod.start_frame)]
    for turn in turns * np.diff(s)[:, None]:
        half = np.linalg.norm(turn) / 2
        q.append(rotations.multiply(q[-1], np.array([np.cos(half), *(np.sinc(half / np.pi) / 2 * turn)])))
    return s, np.vstack([r.T, np.array(q).T, n.T, m.T])


def _balanced(rod, s, r, m):
    """Forces and moments (n, 3) in exact balance along the curve r that come closest to the given moments m."""
    weight = rod.weight * rod.length**3 / np.mean(rod.K)
    lever = np.cross(np.gradient(r, s, axis=0), weight * s[:, None] * E3)
    arm = np.vstack([np.zeros(3), np.cumsum((lever[1:] + lever[:-1]) / 2 * np.diff(s)[:, None], axis=0)])
    A = np.concatenate([np.tile(np.eye(3), (len(s), 1, 1)), -rotations.hat(r - r[0])], axis=2).reshape(-1, 6)
    x = np.linalg.lstsq(A, (m + arm).ravel(), rcond=None)[0]
    return x[3:] + weight * s[:, None] * E3, (A @ x).reshape(-1, 3) - arm


def _collocate(rod, s, y, residual):
    """Solution of solve_bvp from the dimensionless guess (s, y), first coarsely on the mesh of the guess."""
    start = np.concatenate([np.zeros(3), rotations.quaternion(rod.start_frame)])
    start[3:] *= np.sign(start[3:] @ y[3:7, 0])

    def ends(ya, yb):
        miss = rotations.matrix(yb[3:7]).T @ rod.end_frame
        turn = [miss[2, 1] - miss[1, 2], miss[0, 2] - miss[2, 0], miss[1, 0] - miss[0, 1]]
        return np.concatenate([ya[:7] - start, yb[:3] - rod.end / rod.length, turn])

    for tolerance in (COARSE_RESIDUAL, residual):
        answer = solve_bvp(lambda s, y: _rhs(s, y, rod), ends, s, y, tol=tolerance, max_nodes=MAX_NODES)
        if not answer.success:
            raise RuntimeError(f"solve_bvp at tolerance {tolerance}: {answer.message}")
        s, y = answer.x, answer.y
    return answer


def follow(rods, curve, residuals):
    """Equilibria of `rods`, each solved to its residual from the one before, the first from the curve (n, 3).

    The curve runs from the start clamp at the origin to the end clamp; a path of rods pins the branch by continuation.
    """
    s, y = _guess(rods[0], np.asarray(curve, float))
    former = rods[0]
    for rod, residual in zip(rods, residuals, strict=True):
        scale = np.mean(former.K) / np.mean(rod.K)
        answer = _collocate(rod, s, np.concatenate([y[:7], y[7:] * scale]), residual)
        yield Equilibrium(rod, answer)
        keep = np.r_[: len(answer.x) - 1 : max(1, len(answer.x) // HANDED_ON), len(answer.x) - 1]
        s, y, former = answer.x[keep], answer.y[:, keep], rod


def solve(rods, curve):
    """Equilibrium of the last of `rods`, at the end of `follow`."""
    *_, last = follow(rods, curve, [COARSE_RESIDUAL] * (len(rods) - 1) + [RESIDUAL])
    return last


def sag_curve(rod, samples=81):
    """Positions (samples, 3): the cubic Hermite curve of the clamps plus a hanging bump that makes up the length."""
    x = np.linspace(0, 1, samples)[:, None]
    reach = rod.length / 2
    t0, t1 = reach * rod.start_frame[:, 2], reach * rod.end_frame[:, 2]
    base = (x**3 - 2 * x**2 + x) * t0 + (3 * x**2 - 2 * x**3) * rod.end + (x**3 - x**2) * t1

    def curve(depth):
        return base - depth * (16 * x**2 * (1 - x) ** 2) * E3

    def length(depth):
        return np.linalg.norm(np.diff(curve(depth), axis=0), axis=1).sum()

    low, high = 0.0, rod.length
    for _ in range(50):  # bisection: the length grows with the depth
        middle = (low + high) / 2
        low, high = (middle, high) if length(middle) < rod.length else (low, middle)
    return curve(high)
