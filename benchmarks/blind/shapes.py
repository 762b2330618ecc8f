"""Seen shapes and their change with any number of the model: what strengths and rivals are built on.

Only what is across the cable counts: with `t` the tangent and `x''` the curvature vector of the model, a difference `d`
between two curves at equal `s` becomes `(I - t t^T)(d + x'' (d . t)^2 / 2)`, the distance to the curve to third order.
Misfits are in units of the noise: `sum of squares = -2 log L`, with the true covariance along `s` (`Noise`).
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from . import effects as fx
from . import quaternions as qt
from . import rod
from .scene import observation_matrix

INTERVALS = 64  # of the mesh on which shapes are compared; the truth stands on the same mesh, so its error cancels
EPS = rod.STEP


@dataclass
class Tolerance:
    """Standard deviations (zero: exact) in m, m, rad, rad, as a study states them; `curvature` is never stated.

    `curvature` (P, K), 1/m: of the cosines of each pose's own natural curvature, each of three components.
    """

    length: float = 0.0
    clamp_position: float = 0.0
    clamp_rotation: float = 0.0
    gravity: float = 0.0
    curvature: np.ndarray | None = None


class Lens:
    """How shapes on one mesh become whitened rows: the points of each pose and the noise at them."""

    def __init__(self, sigma, length, points, noise):
        self.sigma, self.noise = sigma, noise
        self.matrices = [observation_matrix(sigma, s / length) for s in points]
        self.factors = [cholesky(noise.covariance(s), lower=True) for s in points]
        self.count = sum(map(len, points))

    def see(self, nodes, pose):
        return np.tensordot(self.matrices[pose], nodes, axes=1)

    def whiten(self, d, pose, correlated=True):
        """`(n, 3, ...)` across the cable, in units of the noise, as rows."""
        if not correlated:
            return d.reshape(3 * len(d), -1) / self.noise.sigma
        flat = d.reshape(len(d), -1)
        return solve_triangular(self.factors[pose], flat, lower=True, check_finite=False).reshape(3 * len(d), -1)


class Model:
    """A solved scene with effects: its shapes, its Jacobian, its derivatives."""

    def __init__(self, scene, effects, sigma, y):
        self.scene, self.effects = scene, effects
        self.F, self.scale, self.offset = fx.build(scene, effects, sigma)
        self.y, self.ok = rod.solve(self.F, y)
        self.lus = None

    def factor(self):
        if self.lus is None:
            self.lus = rod.factor(rod.linearise(self.F, self.y)[1])
        return self

    def shape(self, lens, pose):
        return self.scale * lens.see(self.y[pose, :, :3], pose) + self.offset

    def across(self, lens, pose, d):
        """Remove what is along the cable, `(n, 3, ...)`."""
        t = lens.see(qt.rotate(self.y[pose, :, 3:7], np.array([0.0, 0.0, 1.0])), pose)
        t = t / np.linalg.norm(t, axis=1, keepdims=True)
        return d - t.reshape(*t.shape, *[1] * (d.ndim - 2)) * np.einsum("ni,ni...->n...", t, d)[:, None]

    def difference(self, lens, pose, target):
        """From the target to this shape, across the cable."""
        d = self.shape(lens, pose) - target
        y, L = self.y[pose], np.real(self.F.length)
        d3 = qt.rotate(y[:, 3:7], np.array([0.0, 0.0, 1.0]))
        bend = lens.see(np.gradient(d3, self.F.sigma * L, axis=0), pose)
        along = np.einsum("ni,ni->n", lens.see(d3, pose), d)
        return self.across(lens, pose, d + 0.5 * bend * (along**2)[:, None])

    def residual(self, lens, targets, correlated=True):
        return np.concatenate([lens.whiten(self.difference(lens, p, x), p, correlated)[:, 0]
                               for p, x in enumerate(targets)])

    def columns(self, lens, changes, correlated=True):
        """Whitened change of the shapes, a column for each of `changes`: (Fields, scale, offset) with complex parts."""
        rows = [rod.residual(F, self.y).imag / EPS for F, _, _ in changes]
        out = []
        for p in range(len(lens.matrices)):
            dy = -rod.back_substitute(self.factor().lus[p], np.stack([r[p] for r in rows], axis=1))
            dr = dy.reshape(len(self.F.sigma), 13, -1)[:, :3]
            dx = self.scale * lens.see(dr, p)
            x = lens.see(self.y[p, :, :3], p)
            for k, (_, scale, offset) in enumerate(changes):
                dx[..., k] += np.imag(scale) / EPS * x + np.imag(offset) / EPS
            out.append(lens.whiten(self.across(lens, p, dx), p, correlated))
        return np.concatenate(out)

    def stiffness_changes(self):
        """The relative changes of EI and GJ."""
        more, cable = 1 + 1j * EPS, self.scene.cable
        cables = replace(cable, bending=cable.bending * more), replace(cable, torsion=cable.torsion * more)
        return [fx.build(replace(self.scene, cable=c), self.effects, self.F.sigma) for c in cables]

    def nuisances(self, lens, tolerance):
        """One column per unit deviation of what is known only nearly; clamps of each pose deviate by themselves."""
        common, own, eye = [], [], 1j * EPS * np.eye(3)
        if tolerance.length:
            length = self.F.length + 1j * EPS * tolerance.length
            longer = [*self.effects, {"kind": "length_error", "length": length}]
            common.append(fx.build(self.scene, longer, self.F.sigma)[0])
        if tolerance.gravity:
            tilt = tolerance.gravity * qt.cross(eye, self.F.load[..., None, :])
            common += [replace(self.F, load=self.F.load + tilt[..., k, :]) for k in range(3)]
        for name in ("start", "end"):
            x, q = getattr(self.F, name)
            if tolerance.clamp_position:
                own += [replace(self.F, **{name: (x + tolerance.clamp_position * e, q)}) for e in eye]
            if tolerance.clamp_rotation:
                own += [replace(self.F, **{name: (x, qt.product(q, qt.exp(tolerance.clamp_rotation * e + 0 * x)))})
                        for e in eye]
        if tolerance.curvature is not None:
            own += self._own_curvatures(tolerance.curvature[: len(lens.matrices)])
        blocks = []
        if common:
            blocks.append(self.columns(lens, [(F, 1.0, 0.0) for F in common]))
        if own:
            C = self.columns(lens, [(F, 1.0, 0.0) for F in own])
            pose = np.repeat(np.arange(len(lens.matrices)), [3 * len(m) for m in lens.matrices])
            blocks += [C * (pose == p)[:, None] for p in range(len(lens.matrices))]
        return np.concatenate(blocks, axis=1) if blocks else np.zeros((3 * lens.count, 0))

    def _own_curvatures(self, size):
        """Unit deviations of the cosine series of each pose's natural curvature; `size` is (P, K)."""
        out = []
        for k, axis in np.ndindex(size.shape[1], 3):
            harmonics = np.zeros((*size.shape, 3))
            harmonics[:, k, axis] = size[:, k]
            own = {"kind": "pose_curvature", "harmonics": 1j * EPS * harmonics}
            out.append(fx.build(self.scene, [*self.effects, own], self.F.sigma)[0])
        return out


def left_over(columns, d):
    """What least squares with these columns leaves of `d`."""
    return d - columns @ np.linalg.lstsq(columns, d, rcond=1e-10)[0]
