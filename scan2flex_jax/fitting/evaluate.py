"""Residuals of all poses and their Jacobian, for every minimiser.

Poses are solved one after the other by one compiled function: in a batch all of them would take as many steps as the slowest,
and each number of poses would be compiled separately. Unknowns and nuisance parameters of a study change only the map from its
parameter vector to the state of a pose (`states`), which compiles quickly.

The Jacobian is the derivative of the equilibria by the implicit function theorem: one back-substitution per parameter with
the factors of the solve. A call without derivatives compiles and runs without it.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from scan2flex_jax.compilation import lightly_compiled
from scan2flex_jax.fitting import discrepancy, states
from scan2flex_jax.fitting.parameters import Layout, boundary_at, model_at
from scan2flex_jax.fitting.poses import Poses
from scan2flex_jax.fitting.threads import each_pose
from scan2flex_jax.rod.model import CableModel, Configuration, Rod
from scan2flex_jax.statics.verdict import SOLVED, Verdict


class Evaluation(NamedTuple):
    """Per pose: residuals (P, m, 3) in m, their Jacobian (P, m, 3, shared + local) or None, arc lengths (P, m), the
    configurations and the statuses of their solves (``verdict``)."""

    residual: np.ndarray
    jacobian: np.ndarray | None
    s: np.ndarray
    configuration: Configuration
    verdict: Verdict

    @property
    def solved(self) -> bool:
        """Whether every pose is a stable equilibrium with finite residuals."""
        return bool(np.all(np.asarray(self.verdict.code) == SOLVED) and np.all(np.isfinite(self.residual)))


@lightly_compiled
def _state(layout: Layout, template: CableModel, boundary, x, slots, elements, rows):
    """State of one pose at parameters ``x``, and its tangents by them, padded with zeros to ``rows`` (0: no tangents)."""

    def state(x):
        model = model_at(layout, template, x[: layout.shared])
        own = states.slots_of(model.effects)
        return states.state_of(model, boundary_at(layout, boundary, x[layout.shared :]), elements, (*own, *slots))

    if not rows:
        return state(x), None
    return state(x), jax.vmap(lambda t: jax.jvp(state, (x,), (t,))[1])(jnp.eye(rows, len(x)))


def observed(model: CableModel, points):
    """Points of the centre line (m) as the scanner observes them."""
    for effect in model.effects:
        points = effect.observe(points)
    return points


class Evaluator:
    """Residuals of a study's poses; counts the equilibria that it solved."""

    def __init__(self, layout: Layout, poses: Poses, elements: int, distance: str = "normal", slots: tuple = ()):
        """Nothing is solved yet; ``slots`` are null energy laws, placeholders in the states for effects added later."""
        self.layout, self.poses = layout, poses
        self.elements, self.distance, self.slots = elements, distance, slots
        self.width = states.FEW if not slots and layout.shared + layout.local <= states.FEW else states.CHUNK
        self.equilibria = 0

    def __call__(self, shared, local=None, *, start=None, derivative=True) -> Evaluation:
        """At ``shared`` numbers and ``local`` ones (P, local), from ``start`` (default: the measured curves)."""
        p = self.poses
        self.equilibria += p.count
        local = np.zeros((p.count, self.layout.local)) if local is None else local
        start = p.start if start is None else start
        numbers = [np.concatenate([shared, own]) for own in local]
        found = each_pose(lambda i: self._pose(i, numbers[i], one(start, i), derivative), p.count)
        r, jacobian, s, configuration, verdict, _ = jax.tree.map(lambda *x: np.stack(x), *found)
        return Evaluation(r, jacobian, s, configuration, verdict)

    def _pose(self, i, x, start, derivative):
        boundary = one(self.poses.boundary, i)
        wanted = derivative or bool(self.slots)  # with placeholders, one compiled function serves all calls
        rows = -(-len(x) // self.width) * self.width if wanted else 0
        state, tangents = _state(self.layout, self.poses.template(i), boundary, x, self.slots, self.elements, rows)
        found = states.evaluate(state, tangents, start, target_of(self.poses, i), self.distance, self.width)
        return found if found.columns is None else found._replace(columns=found.columns[..., : len(x)])

    def rod(self, i: int, shared, local, configuration) -> tuple[Rod, Configuration]:
        """The rod of pose ``i`` at these numbers, with its energy laws, and its configuration."""
        given = self.poses.template(i), one(self.poses.boundary, i), np.concatenate([shared, local[i]]), self.slots
        return _state(self.layout, *given, self.elements, 0)[0].rod, one(configuration, i)

    def scatter(self, shared, local, start) -> list[np.ndarray]:
        """Per pose the columns (m, 3, k) of its discrepancy (`fitting.discrepancy`) at equilibria, in m per 1/m."""

        def columns(i):
            x = np.concatenate([shared, local[i]])
            rows = -(-len(x) // self.width) * self.width
            boundary = one(self.poses.boundary, i)
            state, _ = _state(self.layout, self.poses.template(i), boundary, x, self.slots, self.elements, rows)
            given = discrepancy.directions(state), one(start, i), target_of(self.poses, i), self.distance, self.width
            return np.asarray(states.evaluate(state, *given).columns)

        return each_pose(columns, self.poses.count)


def target_of(poses: Poses, i: int) -> states.Target:
    """The measured points of pose ``i``."""
    return states.Target(*one((poses.points, poses.mask, poses.expected, poses.marked), i))


def one(tree, i: int):
    """Pose ``i`` of a tree whose arrays have a leading axis of poses."""
    return jax.tree.map(lambda x: x[i], tree)
