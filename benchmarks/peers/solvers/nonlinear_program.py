"""CasADi and IPOPT on the discrete energy of this package's elements (`rod.energy`, `rod.element_law`), written anew.

Unknown are the nodes' positions and their turns away from the start's frames, as Rodrigues parameters p with the quaternion
(1, p)/|(1, p)|: no constraints, no singularity below half a turn. The strain of an element is the logarithm of its relative
rigid motion; functions of the angle are series in the squared sine of half of it, for which derivatives need no branch.
IPOPT has exact gradients and Hessians from CasADi; positions are in m, the energy in units of B/L. At its tolerance rounding
ends some solves ("search direction becomes too small"); the record says which.
"""

import casadi as ca
import numpy as np

from benchmarks.peers.continuum import quaternion
from benchmarks.peers.problems import start_at
from benchmarks.peers.solvers import Found

_TERMS = 16  # of the series of asin: 1e-16 for elements that turn by less than 0.9 rad
_FADE, _HALF = 8.0, 38.0  # where the element's correction begins to fade (`rod.element_law`)


def prepare(problem, elements):
    """The program, its derivatives and IPOPT."""
    s = np.linspace(0.0, problem.length, elements + 1)
    r0, R0 = start_at(problem, s)
    q0 = np.array([quaternion(R) for R in R0])
    unit = problem.bending / problem.length
    inner = slice(1, None) if problem.free else slice(1, -1)
    free = elements if problem.free else elements - 1
    x = ca.MX.sym("x", 6 * free)
    moved = ca.reshape(x, 6, free)
    nodes = ca.horzcat(ca.vertcat(ca.DM(r0[0]), ca.DM.zeros(3)), moved)
    if not problem.free:
        nodes = ca.horzcat(nodes, ca.vertcat(ca.DM(r0[-1]), ca.DM.zeros(3)))
    energy = _element(problem, problem.length / elements).map(elements)
    q0 = ca.DM(q0.T)
    total = ca.sum2(energy(nodes[:, :-1], q0[:, :-1], nodes[:, 1:], q0[:, 1:])) / unit
    options = {"ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-9, "max_iter": 3000}, "print_time": False}
    solver = ca.nlpsol("rod", "ipopt", {"x": x, "f": total}, options)
    begin = np.concatenate([r0[inner], np.zeros((free, 3))], axis=1).ravel()

    def solve():
        answer = solver(x0=begin)
        stats = solver.stats()
        if not stats["success"]:
            raise FloatingPointError(f"IPOPT: {stats['return_status']}")
        points = r0.copy()
        points[inner] = np.asarray(answer["x"]).reshape(free, 6)[:, :3]
        return [Found(s, points, {"steps": int(stats["iter_count"]), "energy_J": float(answer["f"]) * unit})]

    return solve


def _element(problem, ds):
    """Energy (J) of an element from its nodes ``(r, p)`` and the quaternions that ``p`` turns."""
    a, qa, b, qb = (ca.SX.sym(name, size) for name, size in (("a", 6), ("qa", 4), ("b", 6), ("qb", 4)))
    qa1, qb1 = _multiply(qa, _of(a[3:])), _multiply(qb, _of(b[3:]))
    Ra, Rb = _matrix(qa1), _matrix(qb1)
    strain = _logarithm(Ra.T @ (b[:3] - a[:3]), _multiply(_conjugate(qa1), qb1)) / ds
    e = strain - ca.DM([0, 0, 1, 0, 0, 0])
    EA, EI, GJ = problem.stretching, problem.bending, problem.torsion
    K = ca.diag(ca.DM([EA, EA, EA, EI, EI, GJ]))
    A = ca.horzcat(ca.skew(ca.DM([0, 0, 1])), ca.skew(e[3:]))
    own = np.array([EI, EI, GJ])
    own = own * (1 + np.maximum((own.sum() / own - _FADE) / (_HALF - _FADE), 0.0) ** 4)
    M = 12 / ds**2 * ca.diag(ca.DM(own)) + A @ K @ A.T
    force = K @ e - (A @ K).T @ (ca.inv_minor(M) @ (A @ K @ e))
    # weight along -z on the cubic Hermite curve of the element: half of it on each node, and a lever on the tangents
    w = problem.weight
    height = 0.5 * ds * (a[2] + b[2]) + ds**2 / 12 * (Ra[2, 2] - Rb[2, 2])
    return ca.Function("element", [a, qa, b, qb], [0.5 * ds * ca.dot(force, e) + w * height])


def _of(p):
    return ca.vertcat(1, p) / ca.sqrt(1 + ca.dot(p, p))


def _multiply(p, q):
    return ca.vertcat(p[0] * q[0] - ca.dot(p[1:], q[1:]), p[0] * q[1:] + q[0] * p[1:] + ca.cross(p[1:], q[1:]))


def _conjugate(q):
    return ca.vertcat(q[0], -q[1:])


def _matrix(q):
    v = ca.skew(q[1:])
    return ca.SX.eye(3) + 2 * q[0] * v + 2 * v @ v


def _logarithm(r, q):
    """Twist (translation first) of the rigid motion ``(r, q)``, for angles that a resolved element has."""
    q = q * ca.sign(q[0])
    x2 = ca.dot(q[1:], q[1:])  # squared sine of half the angle
    series, term = 0, 1
    for k in range(_TERMS):
        series += term / (2 * k + 1)
        term *= x2 * (2 * k + 1) / (2 * k + 2)
    w = 2 * series * q[1:]  # asin(x)/x
    t = ca.dot(w, w)
    # (1 - (a/2) cot(a/2))/a^2, a^2 = t; its coefficients are |B_2k|/(2k)!
    bernoulli = [1 / 12, 1 / 720, 1 / 30240, 1 / 1209600, 1 / 47900160, 691 / 1307674368000, 1 / 74724249600]
    g = sum(c * t**k for k, c in enumerate(bernoulli))
    c = ca.cross(w, r)
    return ca.vertcat(r - 0.5 * c + g * ca.cross(w, c), w)
