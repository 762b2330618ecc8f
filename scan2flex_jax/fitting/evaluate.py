"""Residuals of all poses and their Jacobian, for every minimiser.

Poses are solved one after the other by one compiled function: in a batch all of them would take as many steps as the slowest,
and each number of poses would be compiled separately. Unknowns and nuisance parameters of a study, and effects `Added` to it,
change only the map from its parameter vector to the state of a pose (`states`), which compiles quickly.

The Jacobian is the derivative of the equilibria by the implicit function theorem: one back-substitution per parameter with
the factors of the solve. A call without derivatives compiles and runs without it.

With memory each pose begins from the state that the one before it left (the first from the initial set of the cable), whether
that belongs to the poses evaluated or not, and the derivative of that state is a tangent of the next pose: forward mode through
the order, linear in the number of poses.
Derivatives of a pose by nuisance parameters of the clamps of earlier poses are left out: a clamp within its tolerance moves the
history by a small part of a threshold, and they would cost the square of the number of poses.
"""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, NamedTuple, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from scan2flex_jax.compilation import compiled, lightly_compiled
from scan2flex_jax.effects import ordered
from scan2flex_jax.effects.catalogue import entry_of
from scan2flex_jax.effects.entry import Context
from scan2flex_jax.fitting import states
from scan2flex_jax.fitting.parameters import Layout, boundary_at, model_at, with_ends
from scan2flex_jax.fitting.poses import History, Poses
from scan2flex_jax.fitting.threads import each_pose
from scan2flex_jax.rod.effect import AbstractEffect
from scan2flex_jax.rod.memory import Left, remembering
from scan2flex_jax.rod.model import CableModel, Configuration
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


class Added(NamedTuple):
    """Effects in addition to those of a study: entries of the vector of a pose, behind those of its `Layout`.

    ``kinds``: effect types, each with the place of its amplitudes in the vector, their number, and the parts of its site that
    follow; ``sites`` of all of them, ``null`` (n,), the vector with all of them absent; ``at`` (k,), the places of those that
    are not, and their ``values``; ``scenes``: per pose the scales and shapes that effects refer to.
    """

    kinds: tuple[tuple[str, tuple[int, int, tuple[str, ...]]], ...]
    sites: dict[str, dict[str, np.ndarray]]
    null: np.ndarray
    at: np.ndarray
    values: np.ndarray
    scenes: Sequence[dict[str, Any]] = ()

    def vector(self, x) -> np.ndarray:
        """The vector of a pose, of its numbers without the effects."""
        full = self.null.copy()
        full[: len(x)], full[self.at] = x, self.values
        return full

    def along(self, count: int) -> np.ndarray:
        """Places of all numbers that are not held, of which ``count`` come before the effects."""
        return np.r_[np.arange(count), self.at]


def _map(layout: Layout, elements, kinds, template: CableModel, boundary, x, sites, scene, slots, directions):
    """State of one pose at its vector ``x``, and its tangents along ``directions``, padded with zeros to `states.WIDTH`."""
    base = layout.shared + layout.local

    def state(x):
        model, added = model_at(layout, template, x[: layout.shared]), list[AbstractEffect]()
        seen = cast(Context, SimpleNamespace(**scene))
        for kind, (at, count, moving) in kinds:
            site = sites[kind] | {name: x[at + count + j] for j, name in enumerate(moving)}
            added += entry_of(kind).build(x[at : at + count], site, seen)
        model = with_ends(model, added)
        laws = (*states.slots_of(model.effects), *states.slots_of(added), *slots)
        model = type(model)(model.cable, model.gravity, ordered((*model.effects, *added)))
        return states.state_of(model, boundary_at(layout, boundary, x[layout.shared : base]), elements, laws)

    if not len(directions):
        return state(x), None
    tangents, rest = jax.vmap(lambda t: jax.jvp(state, (x,), (t,))[1])(directions), states.WIDTH - len(directions)
    return state(x), jax.tree.map(lambda t: jnp.pad(t, ((0, rest), *[(0, 0)] * (t.ndim - 1))), tangents)


_map_of_study, _map_of_effects = lightly_compiled(_map), compiled(_map)
FEW = 8  # directions of one call of a map


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
    """Residuals of a study's poses; counts the equilibria that it solved.

    ``shared`` (n,) and ``local`` (P, k) are the numbers of the `Layout`, ``added`` effects that the study does not have.
    """

    def __init__(self, layout: Layout, poses: Poses, elements: int, distance: str = "normal", slots: tuple = ()):
        """Nothing is solved yet; ``slots`` are null energy laws, placeholders in the states for effects added later."""
        self.layout, self.poses = layout, poses
        self.elements, self.distance, self.slots = elements, distance, slots
        self.equilibria = 0
        self._between: dict[int, Configuration] = {}  # of poses of the history that are not of these: their last equilibria

    def __call__(self, shared, local=None, *, start=None, derivative=True) -> Evaluation:
        """At ``shared`` numbers and ``local`` ones (P, local), from ``start`` (default: the measured curves)."""
        return Evaluation.of(self.shapes(shared, local, start=start, derivative=derivative))

    def shapes(
        self, shared, local=None, *, start=None, derivative=True, added: Added | None = None, along=None
    ) -> list[states.Shape]:
        """The solved poses; their columns are those of shared, local and added numbers, or ``along`` places of the vector.

        Effects are ``added`` to poses without memory, or with the states that it left in them (`remembered`).
        """
        p = self.poses
        self.equilibria += p.count
        local = np.zeros((p.count, self.layout.local)) if local is None else local
        near, start = start is not None and start is not p.start, p.start if start is None else start
        given = derivative, added or self._alone, along
        if p.history is None:
            return each_pose(lambda i: self._pose(p, i, shared, local[i], one(start, i), *given, near=near), p.count)
        return self._in_order(p.history, shared, local, start, derivative, near)

    def _mapped(self, poses, i, x, along, added: Added):
        """The state of a pose at its numbers ``x``, and its tangents ``along`` places of its vector; None: without tangents."""
        full, rows = added.vector(x), 0 if along is None else max(-(-len(along) // FEW), 1) * FEW
        directions = np.zeros((rows, len(full)))
        if along is not None:
            directions[np.arange(len(along)), along] = 1.0
        pose = poses.template(i), one(poses.boundary, i), full, added.sites, added.scenes[i] if added.scenes else {}
        of, slots = (_map_of_effects, ()) if added.kinds else (_map_of_study, self.slots)
        parts = np.split(directions, max(rows // FEW, 1))
        found = [of(self.layout, self.elements, added.kinds, *pose, slots, directions=part) for part in parts]
        if len(found) == 1:
            return found[0]
        return found[0][0], jax.tree.map(lambda *t: np.concatenate([part[:FEW] for part in t]), *(moved for _, moved in found))

    @property
    def _alone(self) -> Added:
        """No effects beside those of the study."""
        none = np.zeros(0, int)
        return Added((), {}, np.zeros(self.layout.shared + self.layout.local), none, none)

    def _pose(
        self, poses, i, shared, local, start, derivative, added, along=None, before=None, held=None, near=False
    ):  # fmt: skip
        """One pose; with memory ``before`` is what the one before it left, None for the first pose."""
        x = np.concatenate([shared, local])
        if derivative and along is None:
            along = added.along(len(x))
        state, tangents = self._mapped(poses, i, x, along, added)
        left: Left = ()
        if held is not None:  # the first pose has a state too, so that one compiled function serves all
            left, moved = _entered(state, tangents, before)
            state, tangents = states.after(state, left), None if tangents is None else states.after(tangents, moved)
        target = target_of(poses, i)
        found = states.evaluate(state, tangents, start, target, self.distance, held, near)
        found = found._replace(entered=left, columns=None if found.columns is None else found.columns[..., : len(along)])
        if not (poses.changes and poses.changes[i]):
            return found
        other = poses.reference
        own = self._pose(other, i, shared, local, one(other.start, i), derivative, added, along)
        return states.compared(found, own, target)

    def _in_order(self, history: History, shared, local, start, derivative, near=False) -> list[states.Shape]:
        """The shape of each pose; poses of the history that are not of these have no part of their own but what they leave."""
        found: dict[int, states.Shape] = {}
        own, before = {int(q): i for i, q in enumerate(history.at)}, None
        for q in range(max(own) + 1):
            before = STRAIGHTENED if history.reset[q] else before
            held, i = np.asarray(history.held[q]), own.get(q)
            if i is not None:
                given = shared, local[i], one(start, i), derivative, self._alone
                shape = self._pose(self.poses, i, *given, before=before, held=held, near=near)
            else:
                shape = self._passed(history.poses, q, shared, derivative, before, held)
            found[q] = shape
            before = _Before(shape.left, shape.leaving, len(shared))
        return [found[int(q)] for q in history.at]

    def _passed(self, poses, q, shared, derivative, before, held) -> states.Shape:
        """A pose of the history that is not of these, solved from its last equilibrium, or from its measured curve."""
        none, last = np.zeros(self.layout.local), self._between.pop(q, None)
        for start, near in [*([(last, True)] if last is not None else []), (one(poses.start, q), False)]:
            shape = self._pose(poses, q, shared, none, start, derivative, self._alone, before=before, held=held, near=near)
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
        return replace(self.poses, templates=tuple(models), group=tuple(range(len(models))), history=None)

    def state(self, i: int, shared, local, added: Added | None = None, derivative=False):
        """The state of pose ``i`` at these numbers, without its history, and its derivatives by them (leading axis)."""
        x, added = np.concatenate([shared, local[i]]), added or self._alone
        return self._mapped(self.poses, i, x, added.along(len(x)) if derivative else np.zeros(0, int), added)

    def along(self, directions, shared, local, start, added: Added | None = None, of_changes=False) -> list[np.ndarray]:
        """Per pose the columns (m, 3, k) along ``directions(state, i)`` of its state at equilibria ``start``.

        ``of_changes``: the directions are in the poses from which readings are changes too.
        """
        before, added, none = self.states_before(shared, local, start), added or self._alone, np.zeros(0, int)
        self.equilibria += self.poses.count

        def columns(poses, i, start, near):
            state, held = self._mapped(poses, i, np.concatenate([shared, local[i]]), none, added)[0], None
            if before[i]:
                state, held = states.after(state, before[i]), np.zeros(())
            moved = directions(state, i)
            return states.evaluate(state, moved, start, target_of(poses, i), self.distance, held, near).columns

        def of(i):
            own, changes = columns(self.poses, i, one(start, i), near=True), self.poses.changes
            other = self.poses.reference if of_changes and changes and changes[i] else None
            return np.asarray(own) if other is None else own - columns(other, i, one(other.start, i), near=False)

        return each_pose(of, self.poses.count)


def target_of(poses: Poses, i: int) -> states.Target:
    """The measured points of pose ``i``."""
    return states.Target(*one((poses.points, poses.mask, poses.expected, poses.marked, poses.rows, poses.readings), i))


def one(tree, i: int):
    """Pose ``i`` of a tree whose arrays have a leading axis of poses."""
    return jax.tree.map(lambda x: x[i], tree)
