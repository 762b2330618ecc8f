"""Plane cables that remember, without any code of the package: friction at every cross section, by Dahl or by Bouc and Wen.

The moment of a section is ``EI [(1 - share) k + share slip z]``, and its state ``z`` follows ``dz = dk/slip (1 - z sign(dk))``
(Dahl) or ``dz = dk/slip (1 - |z|)`` where ``z`` grows and ``dk/slip`` where it falls (Bouc-Wen with equal shape parameters and
the exponent 1), integrated exactly over a step in curvature. The two load alike from zero. Turned back, a section of Bouc and
Wen has its stiffness at zero again, as layers that stick do; one of Dahl's is up to twice as stiff.

The cable is a chain of straight, inextensible segments with hinges between them, second order in the segment; unknown are their
angles and the force on a held end, and the balance of moments is solved by Newton's method. Clamps move from pose to pose in
small steps, along the straight way of their position and angle, so a section may turn back on the way: the poses are not the
end points of monotone loading. Equilibria that are no minimum of the energy in the plane are refused on the way; whether a pose
would leave the plane is asked of the chain in space (`Chain.stays_plane`).

Symbols: ``theta`` (N,) rad, angles of the segments with x; ``k`` (N + 1,) 1/m, curvatures of the hinges, ``h`` m, the length
that each stands for; ``force`` N, on the held end; x level, y up.
"""

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

SEGMENTS = 120
STEPS = 24  # of the clamps from one pose to the next
_NEWTON, _SETTLED = 40, 1e-10


@dataclass(frozen=True)
class Dahl:
    """Bending stiffness ``EI`` (N m^2), ``share`` (-) of it that slips, at a curvature ``slip`` (1/m), by Dahl; share 0 is
    elastic."""

    EI: float
    share: float
    slip: float

    def stepped(self, k, before, z):
        """Moment, its slope, and the new state, for curvatures ``k`` after ``before`` with the states ``z``."""
        new, rate = self.state(k, before, z)
        moment = self.EI * ((1 - self.share) * k + self.share * self.slip * new)
        return moment, self.EI * (1 - self.share + self.share * rate), new

    def state(self, k, before, z):
        """The new state, and ``slip`` times its derivative by curvature."""
        way = np.where(k >= before, 1.0, -1.0)
        kept = np.exp(-np.abs(k - before) / self.slip)
        return way - (way - z) * kept, (1 - way * z) * kept

    def loop_area(self, most: float, points: int = 1000) -> float:
        """Energy per length (J/m) that a steady cycle between ``-most`` and ``most`` (1/m) dissipates."""
        z, k = np.zeros(1), np.zeros(1)
        up = np.linspace(-most, most, points)
        for _ in range(12):  # until the cycle is steady
            area, m0 = 0.0, None
            for target in np.concatenate([up, up[::-1]]):
                m, _, z = self.stepped(np.array([target]), k, z)
                area += 0.0 if m0 is None else 0.5 * float((m[0] + m0) * (target - k[0]))
                k, m0 = np.array([target]), float(m[0])
        return area


class BoucWen(Dahl):
    """The same by Bouc and Wen, with equal shape parameters."""

    def state(self, k, before, z):
        """The new state, and ``slip`` times its derivative by curvature."""
        way = np.where(k >= before, 1.0, -1.0)
        far, along = np.abs(k - before) / self.slip, way * z
        past = np.maximum(far - np.maximum(-along, 0.0), 0.0)  # of the step, after the state has come back to zero
        grown = 1 - (1 - np.maximum(along, 0.0)) * np.exp(-past)
        back = along + far < 0  # not yet at zero
        return way * np.where(back, along + far, grown), np.where(back, 1.0, 1 - grown)


@dataclass(frozen=True)
class Grip:
    """The end clamp: position (m) and angle (rad) of the cable there; the start clamp is level, at the origin."""

    x: float
    y: float
    angle: float

    def towards(self, other: "Grip", part: float) -> "Grip":
        """A part of the way to another one."""
        ours, theirs = np.array([self.x, self.y, self.angle]), np.array([other.x, other.y, other.angle])
        return Grip(*(ours + part * (theirs - ours)))


@dataclass(frozen=True)
class Chain:
    """A cable of ``length`` (m) and ``weight`` (N/m) between its clamps, and what its sections remember."""

    length: float
    weight: float
    law: Dahl
    theta: np.ndarray
    force: np.ndarray
    k: np.ndarray = field(default_factory=lambda: np.zeros(SEGMENTS + 1))
    z: np.ndarray = field(default_factory=lambda: np.zeros(SEGMENTS + 1))

    @property
    def points(self) -> np.ndarray:
        """Nodes (N + 1, 2) in m."""
        step = self.length / SEGMENTS * np.column_stack([np.cos(self.theta), np.sin(self.theta)])
        return np.concatenate([np.zeros((1, 2)), np.cumsum(step, axis=0)])

    def curvatures(self, theta, grip) -> np.ndarray:
        """Curvatures of the hinges (1/m); the outer ones stand for half a segment."""
        h = np.full(SEGMENTS + 1, self.length / SEGMENTS)
        h[[0, -1]] /= 2
        return np.diff(np.concatenate([[0.0], theta, [grip.angle]])) / h

    def stays_plane(self, bending: float, torsion: float) -> bool:
        """Whether no small displacement out of the plane lowers the energy, with stiffnesses ``bending`` out of the plane and
        ``torsion`` (N m^2).

        A segment turns by a1 about its normal in the plane and by a3 about its tangent. Its direction then changes in the plane
        by (a1 a3 n - a1^2 t)/2, and the rotation from one segment to the next, log(exp(-a) Q exp(a')), has components out of
        the plane of first order and one in the plane of second order, at which the moment there works.
        """
        ds, n = self.length / SEGMENTS, SEGMENTS
        h = np.full(n + 1, ds)
        h[[0, -1]] /= 2
        c, s = np.cos(self.theta), np.sin(self.theta)
        above = ds * self.weight * (n - 0.5 - np.arange(n))
        load = ds * np.column_stack([np.full(n, -self.force[0]), above - self.force[1]])
        along, across = load[:, 0] * c + load[:, 1] * s, -load[:, 0] * s + load[:, 1] * c
        moment = self.law.stepped(self.k, self.k, self.z)[0]
        H = np.zeros((2 * (n + 2), 2 * (n + 2)))  # a1, a3 of the clamp, of the segments, of the clamp
        for i, (turn, length, m) in enumerate(zip(self.k * h, h, moment, strict=True)):
            rows = slice(2 * i, 2 * i + 4)
            first, second = _hinge(turn)
            H[rows, rows] += bending / length * np.outer(first[0], first[0]) + torsion / length * np.outer(first[1], first[1])
            H[rows, rows] += m * second
        at = 2 * np.arange(1, n + 1)
        H[at, at] -= along
        H[at, at + 1] += 0.5 * across
        H[at + 1, at] += 0.5 * across
        free = H[2:-2, 2:-2]
        held = np.zeros(2 * n)
        held[::2] = 1.0  # the end stays in the plane: the a1 add up to zero
        bordered = np.block([[free, held[:, None]], [held[None], np.zeros((1, 1))]])
        return bool(np.sum(np.linalg.eigvalsh(bordered) < 0) == 1)

    def moved(self, grip: Grip) -> "Chain | None":
        """The chain in equilibrium with its end at ``grip``; None if Newton finds none, or none that is stable in the plane."""
        ds, n = self.length / SEGMENTS, SEGMENTS
        theta, force = self.theta.copy(), self.force.copy()
        above = ds * self.weight * (n - 0.5 - np.arange(n))  # weight that hangs on each segment, its own half included
        h = np.full(n + 1, ds)
        h[[0, -1]] /= 2
        for _ in range(_NEWTON):
            c, s = np.cos(theta), np.sin(theta)
            moment, slope, z = self.law.stepped(k := self.curvatures(theta, grip), self.k, self.z)
            left = moment[:-1] - moment[1:] + ds * (above * c + force[0] * s - force[1] * c)
            gap = np.array([ds * c.sum() - grip.x, ds * s.sum() - grip.y])
            H = np.zeros((n + 2, n + 2))
            at = np.arange(n)
            H[at, at] = slope[:-1] / h[:-1] + slope[1:] / h[1:] + ds * (-above * s + force[0] * c + force[1] * s)
            H[at[1:], at[:-1]] = H[at[:-1], at[1:]] = -slope[1:-1] / h[1:-1]
            H[:n, n], H[:n, n + 1] = ds * s, -ds * c
            H[n, :n], H[n + 1, :n] = -ds * s, ds * c
            move = np.linalg.solve(H, -np.concatenate([left, gap]))
            move *= min(1.0, 0.3 / np.abs(move[:n]).max())
            theta, force = theta + move[:n], force + move[n:]
            if np.abs(move[:n]).max() < _SETTLED:
                # a minimum on the two constraints: as many negative eigenvalues of the bordered matrix as constraints
                bordered = np.block([[H[:n, :n], H[:n, n:]], [H[:n, n:].T, np.zeros((2, 2))]])
                stable = np.sum(np.linalg.eigvalsh(bordered) < 0) == 2
                return replace(self, theta=theta, force=force, k=k, z=z) if stable else None
        return None


def _hinge(turn: float, step: float = 1e-3) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives by a1, a3 of the two segments at a hinge that turns by ``turn`` (rad) in the plane: the first ones (2, 4) of
    the rotation's components about the normal and the tangent, the second ones (4, 4) of that in the plane."""

    def rotation(a):
        flat = a.reshape(-1, 4)
        none = np.zeros(len(flat))
        one, other = (Rotation.from_rotvec(np.column_stack([flat[:, k], none, flat[:, k + 1]])) for k in (0, 2))
        return (one.inv() * Rotation.from_rotvec([0.0, turn, 0.0]) * other).as_rotvec().reshape(*a.shape[:-1], 3)

    unit = step * np.eye(4)
    first = (rotation(unit) - rotation(-unit))[:, [0, 2]].T / (2 * step)
    pairs = [rotation(i * unit[:, None] + j * unit[None]) * i * j for i in (1, -1) for j in (1, -1)]
    return first, sum(pairs)[..., 1] / (4 * step**2)


def hanging(length: float, weight: float, law: Dahl, grip: Grip, kept: float = 0.0) -> Chain | None:
    """A new cable between the clamps: brought there elastically, so that it remembers nothing but this pose, and that it was
    at a curvature ``kept`` (1/m) before."""
    elastic = Dahl(law.EI, 0.0, 1.0)
    chain = Chain(length, weight, elastic, np.zeros(SEGMENTS), np.zeros(2))
    bowed = replace(chain, theta=np.linspace(-0.05, 0.05, SEGMENTS))
    found: Chain | None = bowed
    straight = Grip(0.999 * length, 0.0, 0.0)
    for part in np.linspace(0.0, 1.0, 40):
        found = None if found is None else found.moved(straight.towards(grip, float(part)))
    if found is None:
        return None
    fresh = replace(found, law=law, k=np.full(SEGMENTS + 1, kept), z=np.zeros(SEGMENTS + 1))
    return fresh.moved(grip)


def posed(length: float, weight: float, law: Dahl, grips: list[Grip], kept: float = 0.0) -> list[Chain] | None:
    """The chain in each pose, in their order, first as `hanging`; None if a pose has no equilibrium on the way."""
    chain = hanging(length, weight, law, grips[0], kept)
    found = [chain]
    for before, grip in pairwise(grips):
        for part in np.linspace(0.0, 1.0, STEPS + 1)[1:]:
            chain = None if chain is None else chain.moved(before.towards(grip, float(part)))
        found.append(chain)
    return None if any(c is None for c in found) else found


def without_memory(length: float, weight: float, law: Dahl, grips: list[Grip]) -> list[Chain] | None:
    """Each pose of a new cable."""
    found = [hanging(length, weight, law, grip) for grip in grips]
    return None if any(c is None for c in found) else found
