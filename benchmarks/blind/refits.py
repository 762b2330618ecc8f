"""Least squares of EI, GJ and the numbers of effects, with the rod solved anew at each step (Levenberg-Marquardt).

Misfits are in units of the noise, `left = -2 log L` of what remains; what a study knows only nearly, and the background of
each pose, are marginalised to first order (`C = I + S S^T`, `S` their columns).
"""

from dataclasses import replace

import numpy as np

from . import effects as fx
from .shapes import EPS, Model, Tolerance

NATS = 3.0  # a kind is accepted when it leaves less than `2 * NATS`
MARQUARDT_STEPS, APPROACH_STEPS = 14, 8
SETTLED = 0.005  # of what is left: a step that gains less is the last
EDGE_RANGE = 0.03  # of L: places this close to a clamp are not scanned


def free_numbers(kind, cable):
    """Per parameter: (size, lowest, highest, scale); `None` for a scale means that its logarithm is free."""
    L, W = cable.length, cable.length * cable.density * 9.81
    p = ((), EDGE_RANGE * L, (1 - EDGE_RANGE) * L, 0.02 * L)
    span, line = ((), 0.02 * L, 0.5 * L, 0.03 * L), W / L
    return {
        "natural_curvature": {"curvature": ((3,), -6 / L, 6 / L, 0.3 / L)},
        "kink": {"position": p, "angle": ((3,), -2, 2, 0.05), "width": ((), 0.02 * L, 0.2 * L, 0.02 * L)},
        "anisotropic_bending": {"ratio": ((), 0.15, 7, None), "angle": ((), -4, 4, 0.3)},
        "bend_twist_coupling": {"coupling": ((2,), -0.65, 0.65, 0.05)},
        "nonlinear_bending": {"slip_curvature": ((), 0.3 / L, 60 / L, None), "ratio": ((), 0.02, 1.0, 0.1)},
        "stiffness_profile": {"position": p, "width": span, "factor": ((), 0.05, 20, None)},
        "extensibility": {"axial_stiffness": ((), 5 * W, 1e5 * W, None)},
        "point_mass": {"position": p, "mass": ((), 0, 2 * W / 9.81, 0.05 * W / 9.81)},
        "density_profile": {"position": p, "width": span, "factor": ((), 0, 12, 0.2)},
        "uniform_load": {"force": ((3,), -line, line, 0.03 * line)},
        "point_load": {"position": p, "force": ((3,), -2 * W, 2 * W, 0.03 * W)},
        "elastic_clamp": {"stiffness": ((2,), 0.5 * cable.bending / L, 1e5 * cable.bending / L, None)},
        "clamp_rotation": {"rotation": ((2, 3), -0.6, 0.6, 0.02)},
        "clamp_offset": {"offset": ((2, 3), -0.08 * L, 0.08 * L, 3e-3 * L)},
        "length_error": {"length": ((), 0.9 * L, 1.1 * L, 4e-3 * L)},
        "scan_scale": {"factor": ((), 0.9, 1.1, 4e-3)},
        "scan_offset": {"offset": ((3,), -0.08 * L, 0.08 * L, 3e-3 * L)},
    }.get(kind)


class Fit:
    """Least squares over log EI, log GJ and the free numbers of some effects, tolerances as priors."""

    def __init__(self, model, lens, targets, tolerance, effects=()):
        self.lens, self.targets, self.effects = lens, targets, list(effects)
        self.cable, self.model = model.scene.cable, model
        self.nuisance = model.nuisances(lens, tolerance)
        self.table = [(i, name, *v) for i, e in enumerate(effects)
                      for name, v in (free_numbers(e["kind"], self.cable) or {}).items()]

    def start(self):
        z = [0.0, 0.0]
        for i, name, _, _, _, scale in self.table:
            value = np.asarray(self.effects[i][name], float).ravel()
            z += list(np.log(np.maximum(value, 1e-12)) if scale is None else value / scale)
        return np.array(z)

    def amplitudes(self):
        """Which free numbers are zero when the effect is absent."""
        absent = {"angle", "curvature", "force", "mass", "coupling", "rotation", "offset"}
        flags = [False, False]
        for i, name, size, *_ in self.table:
            zero = name in absent and not (name == "angle" and self.effects[i]["kind"] == "anisotropic_bending")
            flags += int(np.prod(size)) * [zero]
        return np.array(flags)

    def bounds(self):
        low, high = [-4.0, -4.0], [4.0, 4.0]
        for _, _, size, a, b, scale in self.table:
            n = int(np.prod(size))
            low += n * [np.log(a) if scale is None else a / scale]
            high += n * [np.log(b) if scale is None else b / scale]
        return np.array(low), np.array(high)

    def unpack(self, z):
        scene = replace(self.model.scene, cable=replace(
            self.cable, bending=self.cable.bending * np.exp(z[0]), torsion=self.cable.torsion * np.exp(z[1])))
        effects, k = [dict(e) for e in self.effects], 2
        for i, name, size, _, _, scale in self.table:
            n = int(np.prod(size))
            value = z[k : k + n]
            effects[i][name] = (np.exp(value) if scale is None else value * scale).reshape(size)
            k += n
        return scene, effects

    def at(self, z, y):
        model = Model(*self.unpack(z), self.model.F.sigma, y)
        return model if model.ok.all() else None

    def misfit(self, model):
        """Residual with the nuisances marginalised."""
        return self.free(model.residual(self.lens, self.targets)[:, None])[:, 0]

    def free(self, columns):
        """Apply `C^-1/2`, `C = I + S S^T`: marginalise the nuisances."""
        if not self.nuisance.shape[1]:
            return columns
        if not hasattr(self, "_svd"):
            U, s, _ = np.linalg.svd(self.nuisance, full_matrices=False)
            self._svd = U, 1 / np.sqrt(1 + s**2) - 1
        U, w = self._svd
        return columns + U @ (w[:, None] * (U.T @ columns))

    def columns(self, model, z):
        changes = [fx.build(*self.unpack(z + 1j * EPS * e), model.F.sigma) for e in np.eye(len(z))]
        return self.free(model.columns(self.lens, changes))

    def run(self, enough=NATS, steps=MARQUARDT_STEPS, settled=SETTLED):
        """Levenberg-Marquardt within bounds; `(left, model, z)`. Stops early when the fit is good, or hopeless."""
        low, high = self.bounds()
        damping = 1e-3
        for share in (1.0, 0.4, 0.1, 0.0):  # of the first-order effect, where all of it is too much for Newton
            z = np.clip(self.start() * np.where(self.amplitudes(), share, 1.0), low, high)
            model = self.at(z, self.model.y)
            if model is not None:
                break
        else:
            return np.inf, None, z
        d = self.misfit(model)
        for _ in range(steps):
            J = self.columns(model, z)
            stuck = True
            for _ in range(5):
                stack = np.concatenate([J, np.sqrt(damping) * np.diag(np.linalg.norm(J, axis=0) + 1e-9)])
                step = -np.linalg.lstsq(stack, np.concatenate([d, np.zeros(len(z))]), rcond=None)[0]
                new = np.clip(z + step * min(1.0, 3 / max(np.abs(step).max(), 1e-9)), low, high)
                trial = self.at(new, model.y)
                e = None if trial is None else self.misfit(trial)
                if e is not None and e @ e < d @ d:
                    stuck = e @ e > (1 - settled) * (d @ d)
                    z, model, d, damping = new, trial, e, max(damping / 8, 1e-9)
                    break
                damping *= 8
            if d @ d < enough or stuck:
                break
        return float(d @ d), model, z


def refit(model, lens, targets, tolerance, effects=(), steps=MARQUARDT_STEPS):
    """`(left, model)` of the best fit with some effects; infinite, and no model, where there is none.

    Columns of a background are larger than what they must tell apart unless they stand near the best fit: it is sought
    without them first.
    """
    if tolerance.curvature is not None:
        _, model, z = (first := Fit(model, lens, targets, Tolerance(), effects)).run(steps=min(steps, APPROACH_STEPS))
        if model is None:
            return np.inf, None
        effects = first.unpack(z)[1]
    return Fit(model, lens, targets, tolerance, effects).run(steps=steps)[:2]
