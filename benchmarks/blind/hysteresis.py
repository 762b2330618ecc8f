"""Plane cables that remember, without any code of the package: Dahl's friction at every cross section.

The moment of a section is ``EI [(1 - share) k + share slip z]``, its state ``z`` follows ``dz = dk/slip (1 - z sign(dk))``
(Dahl, the simplest of the Bouc-Wen family), integrated exactly over a step in curvature. The cable is a chain of straight,
inextensible segments with hinges between them, second order in the segment; unknown are their angles and the force on a held
end, and the balance of moments is solved by Newton's method. Clamps move from pose to pose in small steps, along the straight
way of their position and angle, so a section may turn back on the way: the poses are not the end points of monotone loading.

Symbols: ``theta`` (N,) rad, angles of the segments with x; ``k`` (N + 1,) 1/m, curvatures of the hinges, ``h`` m, the length
that each stands for; ``force`` N, on the held end; x level, y up.
"""

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

SEGMENTS = 120
STEPS = 24  # of the clamps from one pose to the next
_NEWTON, _SETTLED = 40, 1e-10


@dataclass(frozen=True)
class Law:
    """Bending stiffness ``EI`` (N m^2), ``share`` (-) of it that slips, at a curvature ``slip`` (1/m); share 0 is elastic."""

    EI: float
    share: float
    slip: float

    def stepped(self, k, before, z):
        """Moment, its slope, and the new state, for curvatures ``k`` after ``before`` with the states ``z``."""
        way = np.where(k >= before, 1.0, -1.0)
        kept = np.exp(-np.abs(k - before) / self.slip)
        new = way - (way - z) * kept
        moment = self.EI * ((1 - self.share) * k + self.share * self.slip * new)
        return moment, self.EI * (1 - self.share + self.share * (1 - way * z) * kept), new

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
    law: Law
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

    def moved(self, grip: Grip) -> "Chain | None":
        """The chain in equilibrium with its end at ``grip``; None if Newton finds none."""
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
                moment, _, z = self.law.stepped(k, self.k, self.z)
                return replace(self, theta=theta, force=force, k=k, z=z)
        return None


def hanging(length: float, weight: float, law: Law, grip: Grip, kept: float = 0.0) -> Chain | None:
    """A new cable between the clamps: brought there elastically, so that it remembers nothing but this pose, and that it was
    at a curvature ``kept`` (1/m) before."""
    elastic = Law(law.EI, 0.0, 1.0)
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


def posed(length: float, weight: float, law: Law, grips: list[Grip], kept: float = 0.0) -> list[Chain] | None:
    """The chain in each pose, in their order, first as `hanging`; None if a pose has no equilibrium on the way."""
    chain = hanging(length, weight, law, grips[0], kept)
    found = [chain]
    for before, grip in pairwise(grips):
        for part in np.linspace(0.0, 1.0, STEPS + 1)[1:]:
            chain = None if chain is None else chain.moved(before.towards(grip, float(part)))
        found.append(chain)
    return None if any(c is None for c in found) else found


def without_memory(length: float, weight: float, law: Law, grips: list[Grip]) -> list[Chain] | None:
    """Each pose of a new cable."""
    found = [hanging(length, weight, law, grip) for grip in grips]
    return None if any(c is None for c in found) else found
