"""Residuals of all poses and their Jacobian, for every minimiser.

Poses are solved one after the other by one compiled function: in a batch all of them would take as many steps as the slowest,
and each number of poses would be compiled separately. Unknowns and nuisance parameters of a study, and effects `Added` to it,
change only the map from its parameter vector to the states of poses (`states`), which compiles quickly; `LANES` poses share one
call of it, and what is common to them is computed once.

The Jacobian is the derivative of the equilibria by the implicit function theorem: one back-substitution per parameter with
the factors of the solve. A call without derivatives compiles and runs without it.

With memory each pose begins from the state that the one before it left (the first from the initial set of the cable), whether
that belongs to the poses evaluated or not, and the derivative of that state is a tangent of the next pose: forward mode through
the order, linear in the number of poses.
Derivatives of a pose by nuisance parameters of the clamps of earlier poses are left out: a clamp within its tolerance moves the
history by a small part of a threshold, and they would cost the square of the number of poses.
"""

from collections.abc import Iterator, Sequence
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
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.effect import AbstractEffect
from scan2flex_jax.rod.memory import Left
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
    are not, and their ``values``; ``scene``: the scales that effects refer to; ``previous`` (P, m, 3): curvatures (1/m) of the
    pose before each.
    """

    kinds: tuple[tuple[str, tuple[int, int, tuple[str, ...]]], ...]
    sites: dict[str, dict[str, np.ndarray]]
    null: np.ndarray
    at: np.ndarray
    values: np.ndarray
    scene: dict[str, Any]
    previous: np.ndarray

    @property
    def vector(self) -> np.ndarray:
        """The vector of a pose, with zeros for its numbers without the effects."""
        full = self.null.copy()
        full[self.at] = self.values
        return full

    def along(self, count: int) -> np.ndarray:
        """Places of all numbers that are not held, of which ``count`` come before the effects."""
        return np.r_[np.arange(count), self.at]


class _Lanes(NamedTuple):
    """What poses have of their own: gravity (m/s^2), supports, nuisance parameters, and the curvature of the pose before."""

    gravity: np.ndarray
    boundary: Boundary
    local: np.ndarray
    previous: np.ndarray


def _map(layout: Layout, elements, kinds, template, lanes: _Lanes, shared, effects, sites, scene, slots, directions):
    """States of `LANES` poses at the numbers that they share, the ``local`` ones of each, and those of added ``effects``, and
    their tangents along ``directions`` of the three together. What is common to the poses is computed once."""
    base = layout.shared + layout.local

    def of_pose(own: _Lanes):
        def state(shared, local, effects):
            model, added = model_at(layout, eqx.tree_at(_gravity, template, own.gravity), shared), list[AbstractEffect]()
            seen = cast(Context, SimpleNamespace(**scene, previous=own.previous))
            for kind, (at, count, moving) in kinds:
                amplitudes, places = jnp.split(effects[at - base : at - base + count + len(moving)], [count])
                site = sites[kind] | dict(zip(moving, places, strict=True))
                added += entry_of(kind).build(amplitudes, site, seen)
            model = with_ends(model, added)
            laws = (*states.slots_of(model.effects), *states.slots_of(added), *slots)
            model = type(model)(model.cable, model.gravity, ordered((*model.effects, *added)))
            return states.state_of(model, boundary_at(layout, own.boundary, local), elements, laws)

        at = shared, own.local, effects
        if not len(directions):
            return state(*at), None
        along = jnp.split(directions, [len(shared), len(shared) + len(own.local)], axis=1)
        return state(*at), jax.vmap(lambda *t: jax.jvp(state, at, t)[1])(*along)

    return jax.vmap(of_pose)(lanes)


def _gravity(model):
    return model.gravity


_map_of_study, _map_of_effects = lightly_compiled(_map), compiled(_map)
LANES, FEW = 8, 8  # poses and directions of one call of a map


def observed(model: CableModel, points):
    """Points of the centre line (m) as the scanner observes them."""
    for effect in model.effects:
        points = effect.observe(points)
    return points


class _Before(NamedTuple):
    """State that a pose left and its derivatives by its numbers, of which those ``common`` are the numbers of every pose."""

    left: Left = ()
    leaving: Left = ()
    common: np.ndarray = np.zeros(0, int)

    def moved(self, left: Left, rows: int) -> Left:
        """Derivatives of the state ``left`` by ``rows`` numbers of the next pose."""
        still = [np.zeros((rows, *np.shape(state))) for state in left]
        for moved, known in zip(still, self.leaving, strict=bool(self.leaving)):
            moved[self.common] = known[self.common]
        return tuple(still)


STRAIGHTENED = _Before()
_Mapped = tuple[states.State, states.State | None]  # a state, and its tangents (leading axis)


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
        self, shared, local=None, *, start=None, derivative=True, added: Added | list[Added] | None = None, along=None
    ) -> list[states.Shape]:
        """The solved poses; their columns are those of shared, local and added numbers, or ``along`` places of the vector."""
        p = self.poses
        self.equilibria += p.count
        local = np.zeros((p.count, self.layout.local)) if local is None else local
        near, start = start is not None and start is not p.start, p.start if start is None else start
        if derivative and along is None and not isinstance(added, list):
            along = (added or self.alone).along(len(shared) + self.layout.local)
        at = shared, local, added, along
        if p.history is None:
            found = self._solved(p, range(p.count), start, at, near)
        else:
            found = self._in_order(p.history, shared, local, start, along, near, added)
        changed = [i for i, change in enumerate(p.changes) if change]
        for i, own in zip(changed, self._solved(p.reference, changed, None, at), strict=True):
            found[i] = states.compared(found[i], own, target_of(p, i))
        return found

    def _solved(self, poses: Poses | None, which: Sequence[int], start, at, near=False) -> list[states.Shape]:
        """Some poses without history, from ``start``, or from their measured curves."""
        if poses is None or not which:
            return []
        mapped, start = self.mapped(poses, which, *at), poses.start if start is None else start
        return each_pose(lambda k: self._pose(poses, which[k], mapped[k], one(start, which[k]), near=near), len(which))

    def mapped(
        self, poses: Poses, which, shared, local, added: Added | list[Added] | None = None, along: Any = ()
    ) -> list[_Mapped]:
        """Of some poses the states, and their tangents ``along`` places of the vector of each; with None another, smaller
        function is compiled. Of several ``added`` the state of the first, and the tangents of each along places of its own."""
        several, along = (added, along) if isinstance(added, list) else ([added or self.alone], [along])
        of, slots = (_map_of_effects, ()) if several[0].kinds else (_map_of_study, self.slots)
        parts = [(own, None) if at is None else (own, np.array(at[k : k + FEW], int))
                 for own, at in zip(several, along, strict=True)
                 for k in range(0, 1 if at is None else max(len(at), 1), FEW)]  # fmt: skip
        out, base = dict[int, tuple](), self.layout.shared + self.layout.local
        for template, same in poses.similar(which):
            for first in range(0, len(same), LANES):
                own = same[first : first + LANES]
                filled = (own * LANES)[:LANES]
                lane, gravity = np.array(filled), np.stack([np.asarray(poses.template(i).gravity) for i in filled])
                previous = several[0].previous
                previous = previous[lane] if len(previous) else np.zeros((LANES, 0, 3))
                lanes = _Lanes(gravity, one(poses.boundary, lane), np.asarray(local)[lane], previous)
                given = self.layout, self.elements, several[0].kinds, template, lanes, np.asarray(shared)
                found = [of(*given, x.vector[base:], x.sites, x.scene, slots, _directions(x, at)) for x, at in parts]
                out |= zip(own, _of_lanes(found, [0 if at is None else len(at) for _, at in parts]), strict=False)
        return [out[i] for i in which]

    @property
    def alone(self) -> Added:
        """No effects beside those of the study."""
        none = np.zeros(0, int)
        return Added((), {}, np.zeros(self.layout.shared + self.layout.local), none, none, {}, np.zeros((0, 0, 3)))

    def _pose(self, poses, i, mapped: _Mapped, start, *, before=None, held=None, near=False) -> states.Shape:
        """One pose; with memory ``before`` is what the one before it left, None for the first pose."""
        (state, tangents), left = mapped, Left()
        if held is not None:  # the first pose has a state too, so that one compiled function serves all
            left, moved = _entered(state, tangents, before)
            state, tangents = states.after(state, left), None if tangents is None else states.after(tangents, moved)
        found = states.evaluate(state, tangents, start, target_of(poses, i), self.distance, held, near)
        return found._replace(entered=left)

    def _in_order(self, history: History, shared, local, start, along, near=False, added=None) -> list[states.Shape]:
        """The shape of each pose; poses of the history that are not of these have no part of their own but what they leave."""
        found: dict[int, states.Shape] = {}
        own, before = {int(q): i for i, q in enumerate(history.at)}, None
        others = [q for q in range(max(own)) if q not in own]
        mapped = dict(zip(own, self.mapped(self.poses, range(self.poses.count), shared, local, added, along), strict=True))
        none, beyond = np.zeros((history.poses.count, self.layout.local)), len(shared) + self.layout.local
        mapped |= dict(zip(others, self.mapped(history.poses, others, shared, none, added, along), strict=True))
        places = np.concatenate(along if isinstance(added, list) else [() if along is None else along]).astype(int)
        common = np.flatnonzero((places < len(shared)) | (places >= beyond))
        for q in range(max(own) + 1):
            before = STRAIGHTENED if history.reset[q] else before
            held, i = np.asarray(history.held[q]), own.get(q)
            if i is None:
                shape = self._passed(history.poses, q, mapped[q], before, held)
            else:
                shape = self._pose(self.poses, i, mapped[q], one(start, i), before=before, held=held, near=near)
            found[q] = shape
            before = _Before(shape.left, shape.leaving, common)
        return [found[int(q)] for q in history.at]

    def _passed(self, poses, q, mapped, before, held) -> states.Shape:
        """A pose of the history that is not of these, solved from its last equilibrium, or from its measured curve."""
        last = self._between.pop(q, None)
        for start, near in [*([(last, True)] if last is not None else []), (one(poses.start, q), False)]:
            shape = self._pose(poses, q, mapped, start, before=before, held=held, near=near)
            if int(shape.verdict.code) == SOLVED:
                self._between[q] = shape.configuration
                break
        return shape

    def states_before(self, shared, local, start, added: Added | None = None) -> list[Left]:
        """For each pose the state that those before it left; empty without memory."""
        history = self.poses.history
        if history is None:
            return [()] * self.poses.count
        along = (added or self.alone).along(len(shared) + self.layout.local)  # by the functions that a fit has compiled
        found = self._in_order(history, shared, local, start, along, added=added)
        return [shape.entered for shape in found]

    def along(self, directions, shared, local, start, added: Added | None = None, of_changes=False) -> list[np.ndarray]:
        """Per pose the columns (m, 3, k) along ``directions(state, i)`` of its state at equilibria ``start``.

        ``of_changes``: the directions are in the poses from which readings are changes too.
        """
        before = self.states_before(shared, local, start, added)
        self.equilibria += self.poses.count

        def columns(poses, which, start, near):
            mapped = self.mapped(poses, which, shared, local, added)

            def of(k):
                i, held = which[k], np.zeros(()) if before[which[k]] else None
                state, target = states.after(mapped[k][0], before[i]), target_of(poses, i)
                return states.evaluate(state, directions(state, i), one(start, i), target, self.distance, held, near).columns

            return each_pose(of, len(which))

        found = columns(self.poses, range(self.poses.count), start, near=True)
        other, changed = self.poses.reference, [i for i, change in enumerate(self.poses.changes) if change and of_changes]
        if other is not None:
            for i, own in zip(changed, columns(other, changed, other.start, near=False), strict=True):
                found[i] = found[i] - own
        return found


def _directions(added: Added, at) -> np.ndarray:
    """`FEW` directions, the first of them along places ``at`` of the vector; none for None."""
    out = np.zeros((0 if at is None else FEW, len(added.null)))
    if at is not None:
        out[np.arange(len(at)), at] = 1.0
    return out


def _of_lanes(parts: list[_Mapped], counts: list[int]) -> Iterator[_Mapped]:
    """Of each lane the state of the first of some calls, and so many tangents of each; None without tangents."""
    leaves, structure = jax.tree.flatten(parts[0][0])
    tree = cast(Any, structure)  # jaxtyping hides its methods
    moved = [jax.tree.leaves(each) for _, each in parts]
    state, *moved = [[np.asarray(leaf) for leaf in each] for each in (leaves, *moved)]
    each = zip(*moved, strict=True)
    whole = [np.concatenate([leaf[:, :n] for leaf, n in zip(leaves, counts, strict=True)], axis=1) for leaves in each]
    for k in range(LANES):
        tangents = tree.unflatten([leaf[k] for leaf in whole]) if whole else None
        yield tree.unflatten([leaf[k] for leaf in state]), tangents


def target_of(poses: Poses, i: int) -> states.Target:
    """The measured points of pose ``i``."""
    return states.Target(*one((poses.points, poses.mask, poses.expected, poses.marked, poses.rows, poses.readings), i))


def one(tree, i: int | np.ndarray):
    """Pose ``i`` of a tree whose arrays have a leading axis of poses, or several."""
    return jax.tree.map(lambda x: x[i], tree)
