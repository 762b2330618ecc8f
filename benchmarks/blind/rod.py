"""The static Cosserat rod as a boundary value problem, solved by Hermite-Simpson collocation.

Unlike an energy of elements, this solves the differential equations of the continuous rod, to fourth order in the mesh:

    r' = d3 + R A^-1 R^T n          q' = q (0, kappa) / 2          A = diag(GA, GA, EA)
    n' = -f(s, r)                   m' = -r' x n                   kappa = kappa_0 + law(R^T m)

`r` (m) centre curve, `q` unit quaternion of the frame, `n` (N) and `m` (N m) the force and moment that the part beyond
`s` exerts, in world axes, `f` (N/m) the line load. A state is `y = (r, q, n, m)`, 13 numbers; point loads make `n` and
`m` jump at nodes. `N` intervals, `P` poses solved at once; rows: 7 at the start, 13 per interval, 6 at the end, so that
the Jacobian has 19 bands below and 18 above the diagonal and one banded LU per pose serves Newton and sensitivities.

Every function lets complex numbers through: the derivative of the residual by any number of the model is
`Im residual(p + i h) / h`, exact to rounding.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import lapack

from . import quaternions as qt

LOWER, UPPER = 19, 18
CLAMP, BALL, FREE = 0, 1, 2
STEP = 1e-30  # of a complex step: no subtraction, so no loss
NEWTON_DONE = 1e-9  # step over (L, 1): the error after a Newton step of this size is its square
MAX_TURN = 0.35  # largest change of a quaternion entry in one Newton step
PLANE_SINK, PLANE_SMOOTH = 2e-4, 5e-5  # of L: how deep the cable's own weight presses into a plane, and its smoothing


@dataclass
class Fields:
    """What the equations need, sampled: at nodes (`N + 1`) or at nodes and midpoints (`2 N + 1`); `P` or 1 poses."""

    sigma: np.ndarray  # mesh over [0, 1]
    length: complex  # L, m
    compliance: np.ndarray  # (2N+1, 3, 3) inverse of K_Omega, 1/(N m^2)
    natural: np.ndarray  # (1 or P, 2N+1, 3) kappa_0, 1/m
    load: np.ndarray  # (1 or P, 2N+1, 3) dead line load, N/m
    shear: complex  # 1/GA
    axial: complex  # 1/EA
    force: np.ndarray  # (1 or P, N+1, 3) dead point forces, N
    couple: np.ndarray  # (1 or P, N+1, 3) dead couples, N m
    start: tuple  # positions (P, 3) and quaternions (P, 4)
    end: tuple
    end_kind: np.ndarray  # (P,) CLAMP, BALL or FREE
    law: object = None  # a moment law along the curvature vector, see `laws.py`
    tethers: list = field(default_factory=list)  # (weights (N+1,), anchor, stiffness, rest length)
    planes: list = field(default_factory=list)  # (normal, offset, stiffness N/m^2, smoothing m)
    grip: tuple = (0.0, 0.0)  # rotational compliance of the clamps, rad/(N m)
    end_moment: np.ndarray | None = None  # (P, 3) moment on a ball joint, for continuation only


def softplus(x):
    """`log(1 + exp(x))`, for complex `x` too."""
    up = x.real > 0
    e = np.exp(np.where(up, -x, x))
    return np.where(up, x, 0) + np.log(1 + e)


def curvature(F, part, M, jac):
    """Curvature and its derivative by the material moment `M`."""
    k0 = F.natural[:, part]
    if F.law is not None:
        kappa, D = F.law(M, part, F.compliance)
        return k0 + kappa, D
    C = F.compliance[part]
    return k0 + (C @ M[..., None])[..., 0], C if jac else None


def rhs(F, part, y, jac=False):
    """Right-hand side at the sample points `part` and, when asked, its 13 x 13 derivative."""
    r, q, n, m = y[..., :3], y[..., 3:7], y[..., 7:10], y[..., 10:]
    d3 = qt.rotate(q, np.array([0.0, 0.0, 1.0]))
    a, b = F.shear, F.axial - F.shear
    dr = d3 + a * n + b * qt.dot(d3, n)[..., None] * d3
    M = qt.unrotate(q, m)
    kappa, D = curvature(F, part, M, jac)
    dq = 0.5 * (qt.left(q) @ kappa[..., None])[..., 0]
    dn = -F.load[:, part] + np.zeros_like(n)
    for normal, offset, stiffness, smooth in F.planes:
        depth = (offset - qt.dot(r, normal)) / smooth
        dn = dn - (stiffness * smooth * softplus(depth))[..., None] * normal
    f = np.concatenate([dr, dq, dn, -qt.cross(dr, n)], axis=-1)
    return (f, _jacobian(F, y, d3, dr, kappa=kappa, D=D)) if jac else f


def _jacobian(F, y, d3, dr, *, kappa, D):
    r, q, n, m = y[..., :3], y[..., 3:7], y[..., 7:10], y[..., 10:]
    a, b = F.shear, F.axial - F.shear
    J = np.zeros((*y.shape, 13), y.dtype)
    along = qt.dot(d3, n)[..., None, None]
    by_d3 = (1 + b * along) * np.eye(3) + b * d3[..., :, None] * n[..., None, :]
    r_q = by_d3 @ qt.d_rotate(q, np.array([0.0, 0.0, 1.0]) + 0 * n)
    r_n = a * np.eye(3) + b * d3[..., :, None] * d3[..., None, :]
    L = 0.5 * qt.left(q) @ D
    J[..., :3, 3:7], J[..., :3, 7:10] = r_q, r_n
    J[..., 3:7, 3:7] = 0.5 * qt.right(kappa) + L @ qt.d_unrotate(q, m)
    R_T = qt.unrotate(q[..., None, :], np.eye(3))  # rows are R^T e_j, that is R as a matrix
    J[..., 3:7, 10:] = L @ np.swapaxes(R_T, -1, -2)
    for normal, offset, stiffness, smooth in F.planes:
        depth = (offset - qt.dot(r, normal)) / smooth
        push = stiffness / (1 + np.exp(-np.clip(depth, -50, 50)))
        J[..., 7:10, :3] += push[..., None, None] * np.outer(normal, normal)
    N = qt.skew(n)
    J[..., 10:, 3:7] = N @ r_q
    J[..., 10:, 7:10] = N @ r_n - qt.skew(dr)
    return J


def jumps(F, y, jac=False):
    """What point loads take from `n` and `m` at each node, and the derivative of the jump of `n` by `r`."""
    loads = [F.force, F.couple, *(v for tether in F.tethers for v in tether)]
    dy = np.zeros(y.shape, complex if any(map(np.iscomplexobj, (y, *loads))) else float)
    dy[..., 7:10] -= F.force
    dy[..., 10:] -= F.couple
    dr = np.zeros((*y.shape[:-1], 3, 3)) if jac else None
    for weights, anchor, k, rest in F.tethers:
        to = anchor - y[..., :3]
        d = np.sqrt(qt.dot(to, to))
        pull = weights * k * np.where(d.real > np.real(rest), d - rest, 0)
        dy[..., 7:10] -= (pull / d)[..., None] * to
        if jac:
            e = to / d[..., None]
            taut = (weights * k * (d > rest))[..., None, None]
            dr += taut * e[..., :, None] * e[..., None, :]
            dr += (pull / d)[..., None, None] * (np.eye(3) - e[..., :, None] * e[..., None, :])
    return dy, dr


def intervals(F, y, jac=False):
    """Collocation residual of each interval and its derivatives by the states at both ends."""
    n = len(F.sigma) - 1
    h = (F.length * np.diff(F.sigma))[:, None]
    first, mid, last = slice(0, 2 * n, 2), slice(1, None, 2), slice(2, None, 2)
    jump, by_r = jumps(F, y, jac)
    y0, y1 = (y + jump)[:, :-1], y[:, 1:]
    if not jac:
        f0, f1 = rhs(F, first, y0), rhs(F, last, y1)
        fm = rhs(F, mid, 0.5 * (y0 + y1) + h / 8 * (f0 - f1))
        return y1 - y0 - h / 6 * (f0 + 4 * fm + f1)
    (f0, J0), (f1, J1) = rhs(F, first, y0, True), rhs(F, last, y1, True)
    fm, Jm = rhs(F, mid, 0.5 * (y0 + y1) + h / 8 * (f0 - f1), True)
    H, eye = h[..., None], np.eye(13)
    A = -eye - H / 6 * (J0 + 4 * Jm @ (0.5 * eye + H / 8 * J0))
    B = eye - H / 6 * (J1 + 4 * Jm @ (0.5 * eye - H / 8 * J1))
    if F.tethers:
        A[..., :3] += A[..., 7:10] @ by_r[:, :-1]
    return y1 - y0 - h / 6 * (f0 + 4 * fm + f1), A, B


def start_rows(F, y0):
    """Seven rows: position, rotation against the clamp (which may yield), length of the quaternion."""
    position, quaternion = F.start
    turn = qt.product(qt.conjugate(quaternion + 0 * y0[..., 3:7]), y0[..., 3:7])
    spring = qt.log_small(turn) - F.grip[0] * qt.unrotate(quaternion + 0 * y0[..., 3:7], y0[..., 10:])
    return np.concatenate([y0[..., :3] - position, spring, qt.dot(y0[..., 3:7], y0[..., 3:7])[..., None] - 1], axis=-1)


def end_rows(F, y1):
    """Six rows: what a clamp, a ball joint or a free end holds."""
    position, quaternion = F.end
    frame = quaternion + 0 * y1[..., 3:7]
    turn = qt.product(qt.conjugate(frame), y1[..., 3:7])
    spring = qt.log_small(turn) + F.grip[1] * qt.unrotate(frame, y1[..., 10:])
    kind = F.end_kind[:, None]
    moment = y1[..., 10:] - (0 if F.end_moment is None else F.end_moment)
    force = np.where(kind == FREE, y1[..., 7:10], y1[..., :3] - position)
    return np.concatenate([force, np.where(kind == CLAMP, spring, moment)], axis=-1)


def residual(F, y):
    """All rows of all poses, `(P, 13 (N + 1))`."""
    P = len(y)
    inner = intervals(F, y).reshape(P, -1)
    return np.concatenate([start_rows(F, y[:, 0]), inner, end_rows(F, y[:, -1])], axis=-1)


def _rows_jacobian(rows, F, y):
    Y = y[None] + 1j * STEP * np.eye(13)[:, None, :]
    return np.moveaxis(rows(F, Y).imag / STEP, 0, -1)


def linearise(F, y):
    """Residual, and the banded Jacobian of each pose in LAPACK's layout."""
    P, n = len(y), len(F.sigma) - 1
    inner, A, B = intervals(F, y, True)
    size = 13 * (n + 1)
    band = np.zeros((P, 2 * LOWER + UPPER + 1, size))
    row = 7 + 13 * np.arange(n)[:, None, None] + np.arange(13)[:, None]
    col = 13 * np.arange(n)[:, None, None] + np.arange(13)
    band[:, LOWER + UPPER + row - col, col + 0 * row] = A
    band[:, LOWER + UPPER + row - col - 13, col + 13 + 0 * row] = B
    i, j = np.arange(7)[:, None], np.arange(13)
    band[:, LOWER + UPPER + i - j, j + 0 * i] = _rows_jacobian(start_rows, F, y[:, 0])
    i, last = np.arange(6)[:, None], size - 13
    band[:, LOWER + UPPER + 7 + i - j, last + j + 0 * i] = _rows_jacobian(end_rows, F, y[:, -1])
    rows = [start_rows(F, y[:, 0]), inner.reshape(P, -1), end_rows(F, y[:, -1])]
    return np.concatenate(rows, axis=-1), band


def factor(band):
    """One banded LU per pose; `None` where it fails."""
    out = []
    for ab in band:
        lu, pivots, info = lapack.dgbtrf(ab, LOWER, UPPER) if np.isfinite(ab).all() else (None, None, 1)
        out.append((lu, pivots) if info == 0 else None)
    return out


def back_substitute(lu, b):
    """`J x = b` for one pose; `b` is a vector or has right-hand sides as columns."""
    return lapack.dgbtrs(lu[0], LOWER, UPPER, b, lu[1])[0]


def solve(F, y, steps=14):
    """Newton's method on all poses; the states, and which poses converged."""
    y, done, bad = y.copy(), np.zeros(len(y), bool), np.zeros(len(y), bool)
    for _ in range(steps):
        todo = np.flatnonzero(~done & ~bad)
        if not len(todo):
            break
        f, band = linearise(pick(F, todo), y[todo])
        for k, lu in zip(todo, factor(band), strict=True):
            step = None if lu is None else -back_substitute(lu, f[np.searchsorted(todo, k)]).reshape(-1, 13)
            if step is None or not np.isfinite(step).all():
                bad[k] = True
                continue
            turn, shift = np.abs(step[:, 3:7]).max(), np.abs(step[:, :3]).max() / np.real(F.length)
            y[k] += step * min(1.0, MAX_TURN / max(turn, shift, 1e-300))
            done[k] = max(turn, shift) < NEWTON_DONE
    return y, done


def pick(F, poses):
    """The fields of some poses only."""
    def cut(a):
        return a[poses] if len(a) > 1 else a

    law = F.law.pick(poses) if F.law is not None else None
    start, end = tuple(v[poses] for v in F.start), tuple(v[poses] for v in F.end)
    moment = None if F.end_moment is None else F.end_moment[poses]
    return replace(F, natural=cut(F.natural), load=cut(F.load), force=cut(F.force), couple=cut(F.couple), law=law,
                   start=start, end=end, end_kind=F.end_kind[poses], end_moment=moment)
