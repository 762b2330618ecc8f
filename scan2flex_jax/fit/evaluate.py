"""Residuals of all poses and their Jacobian, from one batch of equilibria: what every method of fitting asks for.

The Jacobian is the derivative of the equilibria by the implicit function theorem: one back-substitution per parameter with
the factors of the solve. A call that only needs residuals compiles and runs without it.
"""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from scan2flex_jax.equilibrium.solve import MAX_STEPS, Verdict, equilibrium
from scan2flex_jax.fit.distance import integrated_residuals, normal_residuals
from scan2flex_jax.fit.parameters import Layout, boundary_at, model_at
from scan2flex_jax.fit.poses import Poses
from scan2flex_jax.rod.model import CableModel, Configuration

DISTANCES = {"normal": normal_residuals, "integrated": integrated_residuals}


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
        return bool(np.all(np.asarray(self.verdict.solved)) and np.all(np.isfinite(self.residual)))


@eqx.filter_jit
def _evaluate(layout: Layout, template: CableModel, poses: Poses, shared, local, start, elements, distance, derivative):
    def one(points, mask, expected, boundary, turns, start, z):
        def residual(x):
            model = model_at(layout, template, x[: layout.shared])
            e = equilibrium(
                model,
                boundary_at(layout, boundary, x[layout.shared :]),
                start=start,
                turns=turns,
                elements=elements,
                max_steps=MAX_STEPS,
            )

            def observe(p):
                for effect in model.effects:
                    p = effect.observe(p)
                return p

            ds = e.rod.section.ds
            r, s = DISTANCES[distance](e.points, e.configuration.R[:, :, 2], ds, points, expected, observe)
            r = r * mask[:, None]
            return r, (r, s, jax.lax.stop_gradient(e.configuration), e.verdict)

        x = jnp.concatenate([shared, z])
        if derivative:
            jacobian, rest = jax.jacfwd(residual, has_aux=True)(x)
            return jacobian, *rest
        return None, *residual(x)[1]

    arrays = (poses.points, poses.mask, poses.expected, poses.boundary, poses.turns, start, local)
    return jax.vmap(one)(*arrays)


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
        jacobian, r, s, configuration, verdict = _evaluate(
            self.layout, self.template, p, jnp.asarray(shared), jnp.asarray(local), start, self.elements, self.distance, derivative
        )
        jacobian = None if jacobian is None else np.asarray(jacobian)
        return Evaluation(np.asarray(r), jacobian, np.asarray(s), configuration, verdict)
