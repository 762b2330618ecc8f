"""The poses of a study as one function of a vector that contains every effect of the catalogue at its null value.

A hypothesis chooses which entries of that vector are free; it changes no program. Two functions are compiled, whatever is
tried: the map from the vector to the discretised pose, with derivatives along given directions (once for a study's unknowns),
and the equilibrium of the pose with the residual of its points (`fitting.states`, once for all studies). Each costs a few
milliseconds a pose and call.

Units: residuals in m; columns in m per unit of their parameter; amplitudes as in the catalogue (`effects.entry`).
"""

from copy import copy
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from scan2flex_jax.compilation import compiled
from scan2flex_jax.effects import ordered
from scan2flex_jax.effects.catalogue import catalogue, entry_of, fields, laws
from scan2flex_jax.effects.entry import CatalogueEntry, Context, Site
from scan2flex_jax.fitting import discrepancy, states
from scan2flex_jax.fitting.evaluate import one, target_of
from scan2flex_jax.fitting.parameters import boundary_at, model_at, with_ends
from scan2flex_jax.fitting.threads import each_pose
from scan2flex_jax.rod.effect import AbstractEffect, Section
from scan2flex_jax.rod.model import Configuration, Rod

WIDTH, FEW = states.WIDTH, 8  # directions of one call, and of one for most hypotheses
_HISTORY = 21  # points of the curvature of the pose before


@dataclass(frozen=True)
class Component:
    """One effect type at one site."""

    kind: str
    site: Site

    @property
    def entry(self) -> CatalogueEntry:
        """Its catalogue entry."""
        return entry_of(self.kind)

    @property
    def moving(self) -> tuple[str, ...]:
        """The parts of the site that are continuous parameters."""
        return tuple(name for name in self.entry.moving if name in self.site)


class Index:
    """Places of the parameters of a hypothesis in its vector: shared, local ones of all poses, then per component its
    amplitudes and the continuous parts of its site."""

    def __init__(self, program: "Program", components: tuple[Component, ...]):
        """Count the parameters of each group."""
        layout = program.layout
        self.shared, self.local, self.poses = layout.shared, layout.local, program.poses.count
        self.base = self.shared + self.local * self.poses
        sizes = [n for c in components for n in (len(c.entry.amplitudes), len(c.moving))]
        ends = self.base + np.cumsum([0, *sizes])
        self.spans = [np.arange(a, b) for a, b in pairwise(ends)]
        self.count = int(ends[-1])

    def amplitudes(self, k: int) -> np.ndarray:
        """Of component ``k``."""
        return self.spans[2 * k]

    def site(self, k: int) -> np.ndarray:
        """Of the continuous parts of the site of component ``k``."""
        return self.spans[2 * k + 1]

    def of_pose(self, i: int) -> np.ndarray:
        """Of pose ``i``, in the order of the columns of its shape."""
        local = self.shared + i * self.local + np.arange(self.local)
        return np.r_[np.arange(self.shared), local, np.arange(self.base, self.count)].astype(int)


class Program:
    """The poses of a fitted study; counts the equilibria that it ``solves``.

    ``problem`` and ``minimum`` are those of the fit, ``poses`` by default the fitted ones (others: for prediction), ``context``
    the scales of the cable. With memory declared, poses keep the history that they have at the fit.
    """

    def __init__(self, problem, minimum, poses=None):
        """Nothing is solved yet."""
        self.problem, self.minimum, self.layout, self.elements = problem, minimum, problem.layout, problem.elements
        self.poses = problem.poses if poses is None else poses
        self.start = minimum.evaluation.configuration if poses is None else self.poses.start
        self.context, self.solves = context_of(problem, minimum), 0
        self.previous = _previous(problem, minimum, self.poses)
        self.evaluator = problem.evaluator_of(self.poses)
        if self.poses.history is not None:
            local = minimum.local if poses is None else np.zeros((self.poses.count, self.layout.local))
            self.poses = self.evaluator.remembered(minimum.shared, local, self.start)
        self.real = [np.asarray(m) > 0 for m in self.poses.mask]
        found = _entries(self.context)
        self.sites = {e.kind: _arrays(e.sites(self.context)[0] | e.rest(self.context)) for e in found}

    @cached_property
    def layout_of_effects(self) -> dict[str, tuple[int, int, tuple[str, ...]]]:
        """Per effect type the place of its amplitudes in the vector of a pose, their number, and its moving parts."""
        at, out = self.layout.shared + self.layout.local, {}
        for kind in self.sites:
            e = entry_of(kind)
            out[kind] = at, len(e.amplitudes), tuple(e.moving)
            at += len(e.amplitudes) + len(e.moving)
        return out

    def only(self, which) -> "Program":
        """The same study with the poses ``which``, in this order."""
        some = copy(self)
        some.poses = self.poses.only(which)
        some.evaluator = self.problem.evaluator_of(self.evaluator.poses.only(which))
        measured = self.start is self.poses.start
        some.start = some.poses.start if measured else jax.tree.map(lambda x: np.asarray(x)[np.array(which, int)], self.start)
        some.previous, some.real = ([values[i] for i in which] for values in (self.previous, self.real))
        return some

    # --- solved poses

    def shapes(self, components, x, start: Configuration | None = None) -> list[states.Shape]:
        """All poses solved at the vector ``x`` of a hypothesis, their columns in the order of `Index.of_pose`."""
        index, start = Index(self, components), self.start if start is None else start
        near = start is not self.poses.start
        if not components:
            return self._alone(x, index, start)

        def solved(i):
            own = index.of_pose(i)
            sites, at = self._placed(components), self._full(components)
            full, along = np.zeros(self._size), np.zeros((_padded(len(own)), self._size))
            self._null(full, sites)
            full[at] = x[own]
            along[np.arange(len(own)), at] = 1.0
            shape = self._solve(i, full, sites, along, one(start, i), near)
            return shape._replace(columns=shape.columns[..., : len(own)])

        return self._each(solved)

    def columns(self, components, x, start: Configuration, wanted: list[Component]) -> tuple[list[np.ndarray], np.ndarray]:
        """Per pose the columns (m, 3, K) of the components ``wanted`` at zero amplitude beside those of a hypothesis at its
        equilibrium ``start``, and the one that owns each column."""
        index, calls = Index(self, components), _packed(wanted)
        owner = np.concatenate([[k] * len(wanted[k].entry.amplitudes) for call in calls for k in call]).astype(int)

        def of(i):
            out = []
            for call in calls:
                sites = self._placed((*components, *(wanted[k] for k in call)))
                rows: list[int] = []
                full = np.zeros(self._size)
                self._null(full, sites)
                full[self._full(components)] = x[index.of_pose(i)]
                for k in call:
                    at, count, _ = self.layout_of_effects[wanted[k].kind]
                    rows += range(at, at + count)
                along = np.zeros((_padded(len(rows)), self._size))
                along[np.arange(len(rows)), rows] = 1.0
                out.append(self._solve(i, full, sites, along, one(start, i)).columns[..., : len(rows)])
            return np.concatenate(out, axis=-1)

        return self._each(of), owner

    def scatter(self, components, x, start: Configuration) -> list[np.ndarray]:
        """Per pose the columns (m, 3, k) of its own discrepancy (`fitting.discrepancy`) at an equilibrium, in m per 1/m."""
        if not components:
            return self.evaluator.scatter(*self._split(x, Index(self, components)), start)
        return self._along(components, x, start, lambda state, i: discrepancy.directions(state))

    def natural_columns(self, components, x, natural, start: Configuration) -> list[np.ndarray]:
        """Per pose the columns (m, 3, K) of natural strains ``natural`` (poses, K, n, 6) at an equilibrium."""

        def directions(state, i):
            return eqx.tree_at(lambda t: t.rod.section.natural, states.still(state, len(natural[i])), np.asarray(natural[i]))

        return self._along(components, x, start, directions, of_changes=True)

    def rods(self, components, x, shapes) -> list[tuple[Rod, Configuration]]:
        """The rod of each pose with its energy laws, and its equilibrium."""
        if not components:
            shared, local = self._split(x, Index(self, components))
            return [(self.evaluator.rod(i, shared, local), s.configuration) for i, s in enumerate(shapes)]
        return [(self._state_of(components, x, i).rod, shape.configuration) for i, shape in enumerate(shapes)]

    def section(self, components, x) -> tuple[Section, Section]:
        """The sections of the first pose, and their derivatives (leading axis) in the order of `Index.of_pose`."""
        index = Index(self, components)
        count = len(index.of_pose(0))
        if not components:
            state, moved = self.evaluator.state(0, *self._split(x, index))
            return state.rod.section, jax.tree.map(lambda t: np.asarray(t)[:count], moved.rod.section)
        along = np.zeros((_padded(count), self._size))
        along[np.arange(count), self._full(components)] = 1.0
        full, sites = self._vector(components, x, 0)
        state, tangents = self._state(0, full, sites, along)
        return state.rod.section, jax.tree.map(lambda t: np.asarray(t)[:count], tangents.rod.section)

    def _state_of(self, components, x, i):
        full, sites = self._vector(components, x, i)
        return self._state(i, full, sites, np.zeros((FEW, self._size)))[0]

    def _vector(self, components, x, i):
        """The vector of a pose and the sites of all effect types."""
        sites, full = self._placed(components), np.zeros(self._size)
        self._null(full, sites)
        full[self._full(components)] = x[Index(self, components).of_pose(i)]
        return full, sites

    def _along(self, components, x, start, directions, of_changes=False):
        """Columns along directions of the state; ``of_changes``: these are in the poses from which readings are changes too."""

        def moved(program, i, start, near):
            state = program._state_of(components, x, i)
            return states.evaluate(state, directions(state, i), start, target_of(program.poses, i), near=near).columns

        def of(i):
            columns, other = moved(self, i, one(start, i), near=True), self._reference if self._changes(i) else None
            return columns if other is None or not of_changes else columns - moved(other, i, one(other.start, i), near=False)

        return self._each(of)

    def _split(self, x, index):
        """Shared parameters, and local ones (P, local)."""
        return x[: index.shared], x[index.shared : index.base].reshape(index.poses, index.local)

    def _alone(self, x, index, start):
        """Without effects; with memory in the order of the poses, with derivatives through what each leaves to the next."""
        e, marked = self.evaluator(*self._split(x, index), start=start), self.poses.marked
        self.solves += index.poses
        shapes = [states.Shape(*one(e, i)) for i in range(index.poses)]
        return shapes if marked is None else [s._replace(marked=m) for s, m in zip(shapes, marked, strict=True)]

    # --- the vector of a pose

    @cached_property
    def _size(self):
        at, count, moving = list(self.layout_of_effects.values())[-1]
        return at + count + len(moving)

    def _placed(self, components):
        """The site of every effect type, those of the components in their places."""
        return self.sites | {c.kind: self.sites[c.kind] | _arrays(c.site) for c in components}

    def _null(self, full, sites):
        """Fill in the continuous parts of all sites."""
        for kind, (at, count, moving) in self.layout_of_effects.items():
            full[at + count : at + count + len(moving)] = [sites[kind][name] for name in moving]

    def _full(self, components):
        """Places of a hypothesis' parameters of one pose."""
        out = [np.arange(self.layout.shared + self.layout.local)]
        for c in components:
            at, count, moving = self.layout_of_effects[c.kind]
            out += [at + np.arange(count), at + count + np.array([moving.index(name) for name in c.moving], int)]
        return np.concatenate(out).astype(int)

    def _state(self, i, full, sites, along):
        c = self.context
        scene = {"length": np.asarray(c.length), "centre": np.asarray(c.centre, float), "up": c.up}
        scene |= {"previous": self.previous[i]}
        given = self.layout, self.elements, tuple(self.layout_of_effects.items()), self.poses.template(i)
        pose = one(self.poses.boundary, i), full, sites, scene
        found = [_state(*given, *pose, part) for part in np.split(along, len(along) // FEW)]
        if len(found) == 1:
            return found[0]
        return found[0][0], jax.tree.map(lambda *t: np.concatenate([part[:FEW] for part in t]), *(moved for _, moved in found))

    def _solve(self, i, full, sites, along, start, near=True):
        (state, tangents), target = self._state(i, full, sites, along), target_of(self.poses, i)
        found = states.evaluate(state, tangents, start, target, near=near)
        if not self._changes(i):
            return found
        other = self._reference
        return states.compared(found, other._solve(i, full, sites, along, one(other.start, i), False), target)

    def _changes(self, i) -> bool:
        """Whether the readings of pose ``i`` are changes from another."""
        return bool(self.poses.changes) and self.poses.changes[i]

    @cached_property
    def _reference(self) -> "Program":
        """The poses from which readings are changes."""
        other = copy(self)
        other.poses = self.poses.reference
        other.evaluator, other.start = self.problem.evaluator_of(other.poses), other.poses.start
        return other

    def _each(self, work):
        self.solves += self.poses.count
        return each_pose(work, self.poses.count)


def _entries(context: Context) -> list[CatalogueEntry]:
    """The effect types that have a site: some act at clamps only."""
    return [e for e in (*catalogue(), *fields(), *laws()) if e.sites(context)]


def slots_of(study) -> tuple[AbstractEffect, ...]:
    """Energy laws of the whole catalogue at zero amplitude, with which `fit` compiles what a search needs."""
    c = Context(1.0, 1.0, 1.0, 1.0, np.asarray(study.gravity, float), (1.0, 2.0), clamped_ends=study.clamped_ends)
    null = {e.kind: (jnp.zeros(len(e.amplitudes)), e.sites(c)[0] | e.rest(c)) for e in _entries(c)}
    return states.slots_of([effect for kind, (a, site) in null.items() for effect in entry_of(kind).build(a, site, c)])


@compiled
def _state(layout, elements, kinds, template, boundary, x, sites, scene, along):
    """State of one pose, and its derivatives along directions of its vector."""
    base = layout.shared + layout.local

    def state(x):
        model = model_at(layout, template, x[: layout.shared])
        added: list[AbstractEffect] = []
        seen = cast(Any, SimpleNamespace(**scene))
        for kind, (at, count, moving) in kinds:
            site = sites[kind] | {name: x[at + count + j] for j, name in enumerate(moving)}
            added += entry_of(kind).build(x[at : at + count], site, seen)
        model = with_ends(model, added)
        slots = (*states.slots_of(model.effects), *states.slots_of(added))
        model = type(model)(model.cable, model.gravity, ordered((*model.effects, *added)))
        return states.state_of(model, boundary_at(layout, boundary, x[layout.shared : base]), elements, slots)

    tangents = jax.vmap(partial(_pushed, state, x))(along)
    rest = WIDTH - len(along)  # `states.evaluate` takes so many
    return state(x), jax.tree.map(lambda t: jnp.pad(t, ((0, rest), *[(0, 0)] * (t.ndim - 1))), tangents)


def _pushed(function, x, direction):
    return jax.jvp(function, (x,), (direction,))[1]


def _padded(count: int) -> int:
    """Number of directions of the calls for so many."""
    return max(-(-count // FEW), 1) * FEW


def _packed(wanted: list[Component]) -> list[list[int]]:
    """Components in calls of at most `WIDTH` amplitudes, each effect type once in a call."""
    calls: list[tuple[list[int], set[str], int]] = []
    for k, c in enumerate(wanted):
        n = len(c.entry.amplitudes)
        for j, (call, kinds, count) in enumerate(calls):
            if c.kind not in kinds and count + n <= WIDTH:
                call.append(k)
                kinds.add(c.kind)
                calls[j] = call, kinds, count + n
                break
        else:
            calls.append(([k], {c.kind}, n))
    return [call for call, *_ in calls]


def _arrays(site):
    return {name: np.asarray(value, float) for name, value in site.items()}


def context_of(problem, minimum) -> Context:
    """Scales of the cable and of its shapes, from a fit."""
    model = model_at(problem.layout, problem.template, jnp.asarray(minimum.shared))
    cable, R, length = model.cable, np.asarray(minimum.evaluation.configuration.R), problem.length
    gravity = np.asarray(problem.study.gravity, float)
    up = -gravity / max(np.linalg.norm(gravity), 1e-12)
    points = _points_of(problem.poses, minimum)
    lowest = [float((p @ up).min()) for p in points]
    largest = [float(np.abs(_curvature(r, length)[:, :2]).max()) for r in R]
    radius = problem.study.cable.get("radius")
    return Context(
        length=float(cable.length), bending_stiffness=float(np.mean(cable.bending_stiffness)),
        torsional_stiffness=float(cable.torsional_stiffness), gravity=gravity,
        weight=float(cable.length_density) * float(np.linalg.norm(gravity)),
        curvature_range=(min(largest), max(largest)), lowest_range=(min(lowest), max(lowest)),
        radius=None if radius is None else float(radius), axial_stiffness=float(cable.axial_stiffness),
        centre=np.mean(np.concatenate(points), axis=0), points=np.concatenate(points), clamped_ends=problem.study.clamped_ends,
        free_end=any(pose.end is None for pose in problem.study.fit_poses),
    )  # fmt: skip


def _points_of(poses, minimum) -> list[np.ndarray]:
    """Per pose its measured points (m), or where readings are no places the nodes of the model."""
    seen = poses.seen & ~np.array(poses.changes or [False])[:, None]
    each = zip(poses.points, seen, minimum.evaluation.configuration.r, strict=True)
    return [np.asarray(p)[m] if np.any(m) else np.asarray(r) for p, m, r in each]


def _curvature(R: Float[np.ndarray, "n 3 3"], length: float) -> Float[np.ndarray, "elements 3"]:
    """Curvature (1/m, about d1, d2, d3) between nodes, to second order in the mesh."""
    Q = np.einsum("nji,njk->nik", R[:-1], R[1:])
    skew = 0.5 * np.stack([Q[:, 2, 1] - Q[:, 1, 2], Q[:, 0, 2] - Q[:, 2, 0], Q[:, 1, 0] - Q[:, 0, 1]], axis=1)
    return skew * len(Q) / length


def _previous(problem, minimum, poses):
    """Per pose the curvature of the last fitted pose measured before it; zeros without one, and for poses outside the study."""
    study, R = problem.study, np.asarray(minimum.evaluation.configuration.R)
    keep = np.round(np.linspace(0, problem.elements - 1, _HISTORY)).astype(int)
    found = {p.name: _curvature(r, problem.length)[keep] for p, r in zip(study.fit_poses, R, strict=True)}
    last, before = np.zeros((_HISTORY, 3)), {}
    for pose in study.poses:
        before[pose.name] = last
        last = found.get(pose.name, last)
    groups = ((problem.poses, study.fit_poses), (problem.held_out, study.validate_poses))
    own = next((study_poses for some, study_poses in groups if poses is some), None)
    return [np.zeros((_HISTORY, 3))] * poses.count if own is None else [before[p.name] for p in own]
