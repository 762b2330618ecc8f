"""Residuals of all poses and their Jacobian: what every method of fitting asks for.

Poses are solved one after the other by one compiled function: a batch would run all of them to the slowest, and compile
anew for each number of poses.

The Jacobian is the derivative of the equilibria by the implicit function theorem: one back-substitution per parameter with
the factors of the solve. A call that only needs residuals compiles and runs without it.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import jax
import numpy as np

from scan2flex_jax.compilation import compiled
from scan2flex_jax.equilibrium.solve import SOLVED, Verdict, equilibrium
from scan2flex_jax.fit.distance import hausdorff_residuals, integrated_residuals, normal_residuals
from scan2flex_jax.fit.parameters import Layout, boundary_at, model_at
from scan2flex_jax.fit.poses import Poses
from scan2flex_jax.rod.model import CableModel, Configuration

DISTANCES: dict[str, Callable] = {
    "normal": normal_residuals,
    "integrated": integrated_residuals,
    "hausdorff": hausdorff_residuals,
}


class Evaluation(NamedTuple):
    """Per pose: residuals (P, m, 3) in m, their Jacobian (P, m, 3, shared + local) or None, arc lengths (P, m), the
    configurations found and their verdicts."""

    residual: np.ndarray
    jacobian: np.ndarray | None
    s: np.ndarray
    configuration: Configuration
    verdict: Verdict

    @property
    def solved(self) -> bool:
        """Whether every pose is a stable equilibrium with finite residuals."""
        return bool(np.all(np.asarray(self.verdict.code) == SOLVED) and np.all(np.isfinite(self.residual)))


@compiled
def _evaluate(layout: Layout, template: CableModel, pose: Poses, x, start, elements, distance, derivative):
    """One pose: its Jacobian, residual, arc lengths, configuration and verdict."""

    def residual(x):
        model = model_at(layout, template, x[: layout.shared])
        boundary = boundary_at(layout, pose.boundary, x[layout.shared :])
        e = equilibrium(model, boundary, start=start, elements=elements)
        distances = DISTANCES[distance]
        ds, d3 = e.rod.section.ds, e.configuration.R[:, :, 2]
        r, s = distances(e.points, d3, ds, pose.points, pose.expected, partial(observed, model))
        r = r * pose.mask[:, None]
        return r, (r, s, jax.lax.stop_gradient(e.configuration), e.verdict)

    if derivative:
        jacobian, rest = jax.jacfwd(residual, has_aux=True)(x)
        return jacobian, *rest
    return None, *residual(x)[1]


def observed(model: CableModel, points):
    """Where the scanner sees points of the centre line (m)."""
    for effect in model.effects:
        points = effect.observe(points)
    return points


class Evaluator:
    """Residuals of a study's poses; counts the equilibria that it solved."""

    def __init__(self, layout: Layout, template: CableModel, poses: Poses, elements: int, distance: str = "normal"):
        """Nothing is solved yet."""
        self.layout, self.template, self.poses = layout, template, poses
        self.elements, self.distance = elements, distance
        self.equilibria = 0

    def __call__(self, shared, local=None, *, start=None, derivative=True) -> Evaluation:
        """At ``shared`` numbers and ``local`` ones (P, local), from ``start`` (default: the measured curves)."""
        p = self.poses
        self.equilibria += p.count
        local = np.zeros((p.count, self.layout.local)) if local is None else local
        start = p.start if start is None else start
        found = [
            _evaluate(
                self.layout, self.template, one(p, i), np.concatenate([shared, local[i]]), one(start, i), self.elements,
                self.distance, derivative,
            )
            for i in range(p.count)
        ]  # fmt: skip
        jacobian, r, s, configuration, verdict = jax.tree.map(lambda *x: np.stack([np.asarray(a) for a in x]), *found)
        return Evaluation(r, jacobian, s, configuration, verdict)


def one(tree, i: int):
    """Pose ``i`` of a tree whose arrays have a leading axis of poses."""
    return jax.tree.map(lambda x: x[i], tree)
