"""Residuals of all poses and their Jacobian, for every minimiser.

Poses are solved one after the other by one compiled function: in a batch all of them would take as many steps as the slowest,
and each number of poses would be compiled separately. Unknowns and nuisance parameters of a study change only the map from its
parameter vector to the state of a pose (`states`), which compiles quickly.

The Jacobian is the derivative of the equilibria by the implicit function theorem: one back-substitution per parameter with
the factors of the solve. A call without derivatives compiles and runs without it.

With memory each pose begins from the state that the one before it left (the first from the initial set of the cable), whether
that belongs to the poses evaluated or not, and the derivative of that state is a tangent of the next pose: forward mode through
the order, linear in the number of poses.
Derivatives of a pose by nuisance parameters of the clamps of earlier poses are left out: a clamp within its tolerance moves the
history by a small part of a threshold, and they would cost the square of the number of poses.
"""

from dataclasses import replace
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from scan2flex_jax.compilation import lightly_compiled
from scan2flex_jax.fitting import discrepancy, states
from scan2flex_jax.fitting.parameters import Layout, boundary_at, model_at
from scan2flex_jax.fitting.poses import History, Poses
from scan2flex_jax.fitting.threads import each_pose
from scan2flex_jax.rod.memory import Left, remembering
from scan2flex_jax.rod.model import CableModel, Configuration, Rod
from scan2flex_jax.statics.verdict import SOLVED, Verdict


class Evaluation(NamedTuple):
    """Per pose: residuals (P, m, 3) in m, their Jacobian (P, m, 3, shared + local) or None, arc lengths (P, m), the
    configurations, the statuses of their solves (``verdict``), and the axes (P, m, 3, 3) of the residuals."""

    residual: np.ndarray
    jacobian: np.ndarray | None
    s: np.ndarray
    configuration: Configuration
    verdict: Verdict
    axes: np.ndarray | None = None

    @classmethod
    def of(cls, shapes: list[states.Shape]) -> "Evaluation":
        """Of solved poses, one after the other."""
        shapes = [each._replace(marked=None, left=(), leaving=(), entered=()) for each in shapes]
        return cls(*jax.tree.map(lambda *x: np.stack(x), *shapes)[:6])

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


class _Before(NamedTuple):
    """State that a pose left and its derivatives by its numbers, of which the first ``shared`` are those of every pose."""

    left: Left = ()
    leaving: Left = ()
    shared: int = 0

    def moved(self, left: Left, rows: int) -> Left:
        """Derivatives of the state ``left`` by ``rows`` numbers of the next pose."""
        still = [np.zeros((rows, *np.shape(state))) for state in left]
        for moved, known in zip(still, self.leaving, strict=bool(self.leaving)):
            moved[: self.shared] = known[: self.shared]
        return tuple(still)


STRAIGHTENED = _Before()


def _entered(state, tangents, before: _Before | None) -> tuple[Left, Left]:
    """State before a pose, and its derivatives: that of the first pose, of a straightened cable, or left by the last one."""
    if before is None:
        return states.at_first(state, tangents)
    left = before.left or states.without_history(state)
    return left, before.moved(left, 0 if tangents is None else len(tangents.view))


class Evaluator:
    """Residuals of a study's poses; counts the equilibria that it solved."""

    def __init__(self, layout: Layout, poses: Poses, elements: int, distance: str = "normal", slots: tuple = ()):
        """Nothing is solved yet; ``slots`` are null energy laws, placeholders in the states for effects added later."""
        self.layout, self.poses = layout, poses
        self.elements, self.distance, self.slots = elements, distance, slots
        self.equilibria = 0
        self._between: dict[int, Configuration] = {}  # of poses of the history that are not of these: their last equilibria

    def __call__(self, shared, local=None, *, start=None, derivative=True) -> Evaluation:
        """At ``shared`` numbers and ``local`` ones (P, local), from ``start`` (default: the measured curves)."""
        p = self.poses
        self.equilibria += p.count
        local = np.zeros((p.count, self.layout.local)) if local is None else local
        near, start = start is not None and start is not p.start, p.start if start is None else start
        if p.history is None:
            found = each_pose(lambda i: self._pose(p, i, shared, local[i], one(start, i), derivative, near=near), p.count)
        else:
            found = self._in_order(p.history, shared, local, start, derivative, near)
        return Evaluation.of(found)

    def _rows(self, x, derivative):
        """Number of tangents of a call."""
        return -(-len(x) // states.WIDTH) * states.WIDTH if derivative else 0

    def _pose(self, poses, i, shared, local, start, derivative, before=None, held=None, near=False):
        """One pose; with memory ``before`` is what the one before it left, None for the first pose."""
        x = np.concatenate([shared, local])
        given = self.layout, poses.template(i), one(poses.boundary, i), x, self.slots, self.elements
        state, tangents = _state(*given, self._rows(x, derivative))
        left: Left = ()
        if held is not None:  # the first pose has a state too, so that one compiled function serves all
            left, moved = _entered(state, tangents, before)
            state, tangents = states.after(state, left), None if tangents is None else states.after(tangents, moved)
        target = target_of(poses, i)
        found = states.evaluate(state, tangents, start, target, self.distance, held, near)
        found = found._replace(entered=left, columns=None if found.columns is None else found.columns[..., : len(x)])
        if not (poses.changes and poses.changes[i]):
            return found
        other = poses.reference
        return states.compared(found, self._pose(other, i, shared, local, one(other.start, i), derivative), target)

    def _in_order(self, history: History, shared, local, start, derivative, near=False) -> list[states.Shape]:
        """The shape of each pose; poses of the history that are not of these have no part of their own but what they leave."""
        found: dict[int, states.Shape] = {}
        own, before = {int(q): i for i, q in enumerate(history.at)}, None
        for q in range(max(own) + 1):
            before = STRAIGHTENED if history.reset[q] else before
            held, i = np.asarray(history.held[q]), own.get(q)
            if i is not None:
                shape = self._pose(self.poses, i, shared, local[i], one(start, i), derivative, before, held, near)
            else:
                shape = self._passed(history.poses, q, shared, derivative, before, held)
            found[q] = shape
            before = _Before(shape.left, shape.leaving, len(shared))
        return [found[int(q)] for q in history.at]

    def _passed(self, poses, q, shared, derivative, before, held) -> states.Shape:
        """A pose of the history that is not of these, solved from its last equilibrium, or from its measured curve."""
        none, last = np.zeros(self.layout.local), self._between.pop(q, None)
        for start, near in [*([(last, True)] if last is not None else []), (one(poses.start, q), False)]:
            shape = self._pose(poses, q, shared, none, start, derivative, before, held, near)
            if int(shape.verdict.code) == SOLVED:
                self._between[q] = shape.configuration
                break
        return shape

    def states_before(self, shared, local, start) -> list[Left]:
        """For each pose the state that those before it left; empty without memory."""
        history = self.poses.history
        if history is None:
            return [()] * self.poses.count
        found = self._in_order(history, shared, local, start, derivative=True)  # by the functions that a fit has compiled
        return [shape.entered for shape in found]

    def remembered(self, shared, local, start) -> Poses:
        """The poses with the states that those before them left at these numbers in their models; unchanged without memory."""
        if self.poses.history is None:
            return self.poses
        before = self.states_before(shared, local, start)
        models = [self.poses.template(i) for i in range(self.poses.count)]
        models = [
            eqx.tree_at(lambda m: m.effects, m, remembering(m.effects, left)) for m, left in zip(models, before, strict=True)
        ]
        return replace(self.poses, templates=tuple(models), group=tuple(range(len(models))))

    def state(self, i: int, shared, local) -> tuple[states.State, states.State]:
        """The state of pose ``i`` at these numbers, without its history, and its derivatives (leading axis)."""
        x = np.concatenate([shared, local[i]])
        given = self.layout, self.poses.template(i), one(self.poses.boundary, i), x, self.slots, self.elements
        return _state(*given, self._rows(x, derivative=True))

    def rod(self, i: int, shared, local) -> Rod:
        """The rod of pose ``i`` at these numbers, with its energy laws; without its history."""
        return self.state(i, shared, local)[0].rod

    def scatter(self, shared, local, start) -> list[np.ndarray]:
        """Per pose the columns (m, 3, k) of its discrepancy (`fitting.discrepancy`) at equilibria, in m per 1/m."""
        before = self.states_before(shared, local, start)

        def columns(i):
            x = np.concatenate([shared, local[i]])
            boundary = one(self.poses.boundary, i)
            given = self.layout, self.poses.template(i), boundary, x, self.slots, self.elements
            state = states.after(_state(*given, self._rows(x, derivative=True))[0], before[i])
            along, target, held = discrepancy.directions(state), target_of(self.poses, i), np.zeros(()) if before[i] else None
            found = states.evaluate(state, along, one(start, i), target, self.distance, held, near=True)
            return np.asarray(found.columns)

        return each_pose(columns, self.poses.count)


def target_of(poses: Poses, i: int) -> states.Target:
    """The measured points of pose ``i``."""
    return states.Target(*one((poses.points, poses.mask, poses.expected, poses.marked, poses.rows, poses.readings), i))


def one(tree, i: int):
    """Pose ``i`` of a tree whose arrays have a leading axis of poses."""
    return jax.tree.map(lambda x: x[i], tree)
