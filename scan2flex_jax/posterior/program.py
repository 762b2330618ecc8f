"""The poses of a study as one function of a vector that contains every effect of the catalogue at its null value.

A hypothesis chooses which entries of that vector are free; it changes no program. The poses are solved by the `Evaluator` of
fits, with the effects of the hypothesis `Added`. Two functions are compiled, whatever is tried: the map from the vector to the
discretised pose, with derivatives along given directions (once for a study's unknowns), and the equilibrium of the pose with
the residual of its points (`fitting.states`, once for all studies). Each costs a few milliseconds a pose and call.

Units: residuals in m; columns in m per unit of their parameter; amplitudes as in the catalogue (`effects.entry`).
"""

from collections.abc import Collection, Sequence
from copy import copy
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from scan2flex_jax.effects.catalogue import catalogue, entry_of, fields, laws
from scan2flex_jax.effects.entry import CatalogueEntry, Context, Site
from scan2flex_jax.fitting import discrepancy, states
from scan2flex_jax.fitting.evaluate import FEW, Added
from scan2flex_jax.fitting.parameters import model_at
from scan2flex_jax.rod.effect import AbstractEffect, Section
from scan2flex_jax.rod.model import Configuration, Rod

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
    the scales of the cable.
    """

    def __init__(self, problem, minimum, poses=None):
        """Nothing is solved yet."""
        self.problem, self.minimum, self.layout, self.elements = problem, minimum, problem.layout, problem.elements
        self.poses = problem.poses if poses is None else poses
        self.start = minimum.evaluation.configuration if poses is None else self.poses.start
        self.context = context_of(problem, minimum)
        self.previous = _previous(problem, minimum, self.poses)
        self.evaluator = problem.evaluator_of(self.poses)
        self.real = [np.asarray(m) > 0 for m in self.poses.mask]
        self.sites = {e.kind: _arrays(e.sites(self.context)[0] | e.rest(self.context)) for e in _entries(self.context)}

    @property
    def solves(self) -> int:
        """Number of equilibria solved."""
        return self.evaluator.equilibria

    @cached_property
    def layout_of_effects(self) -> dict[str, tuple[int, int, tuple[str, ...]]]:
        """Per effect type the place of its amplitudes in the vector of a pose, their number, and its moving parts."""
        at, out = self.layout.shared + self.layout.local, {}
        for kind in self.sites:
            e = entry_of(kind)
            out[kind] = at, len(e.amplitudes), tuple(e.moving)
            at += len(e.amplitudes) + len(e.moving)
        return out

    @cached_property
    def held_sites(self) -> frozenset[str]:
        """The effect types with an energy law, of whose state a site is a part even at zero amplitude."""
        return frozenset(kind for kind, own in _absent(self.context).items() if states.slots_of(own))

    def only(self, which) -> "Program":
        """The same study with the poses ``which``, in this order."""
        some = copy(self)
        some.poses = self.poses.only(which)
        some.evaluator = self.problem.evaluator_of(some.poses)
        measured = self.start is self.poses.start
        some.start = some.poses.start if measured else jax.tree.map(lambda x: np.asarray(x)[np.array(which, int)], self.start)
        some.previous, some.real = ([values[i] for i in which] for values in (self.previous, self.real))
        return some

    # --- solved poses

    def shapes(self, components, x, start: Configuration | None = None) -> list[states.Shape]:
        """All poses solved at the vector ``x`` of a hypothesis, their columns in the order of `Index.of_pose`."""
        *numbers, added = self._at(components, x)
        found = self.evaluator.shapes(*numbers, start=self.start if start is None else start, added=added)
        return [shape._replace(left=(), leaving=(), entered=()) for shape in found]

    def columns(self, components, x, start: Configuration, wanted: list[Component]) -> tuple[list[np.ndarray], np.ndarray]:
        """Per pose the columns (m, 3, K) of the components ``wanted`` at zero amplitude beside those of a hypothesis at its
        equilibrium ``start``, and the one that owns each column."""
        calls, out = _packed(wanted, self.held_sites), []
        owner = np.concatenate([[k] * len(wanted[k].entry.amplitudes) for call in calls for part in call for k in part])
        numbers = self._at(components, x)[:2]
        for call in calls:
            held = [wanted[k] for part in call for k in part if wanted[k].kind in self.held_sites]
            added = [self._added(components, x, [*held, *(wanted[k] for k in part)]) for part in call]
            places = [[self.layout_of_effects[wanted[k].kind][:2] for k in part] for part in call]
            along = [np.concatenate([np.arange(at, at + count) for at, count in part]) for part in places]
            found = self.evaluator.shapes(*numbers, start=start, added=added, along=along)
            out.append([shape.columns for shape in found])
        return [np.concatenate(each, axis=-1) for each in zip(*out, strict=True)], owner.astype(int)

    def scatter(self, components, x, start: Configuration) -> list[np.ndarray]:
        """Per pose the columns (m, 3, k) of its own discrepancy (`fitting.discrepancy`) at an equilibrium, in m per 1/m."""
        *numbers, added = self._at(components, x)
        return self.evaluator.along(lambda state, i: discrepancy.directions(state), *numbers, start, added)

    def natural_columns(self, components, x, natural, start: Configuration) -> list[np.ndarray]:
        """Per pose the columns (m, 3, K) of natural strains ``natural`` (poses, K, n, 6) at an equilibrium."""

        def directions(state, i):
            return eqx.tree_at(lambda t: t.rod.section.natural, states.still(state, len(natural[i])), np.asarray(natural[i]))

        *numbers, added = self._at(components, x)
        return self.evaluator.along(directions, *numbers, start, added, of_changes=True)

    def rods(self, components, x, shapes) -> list[tuple[Rod, Configuration]]:
        """The rod of each pose with its energy laws, and its equilibrium."""
        mapped = self.evaluator.mapped(self.poses, range(len(shapes)), *self._at(components, x))
        return [(state.rod, shape.configuration) for (state, _), shape in zip(mapped, shapes, strict=True)]

    def section(self, components, x) -> tuple[Section, Section]:
        """The sections of the first pose, and their derivatives (leading axis) in the order of `Index.of_pose`."""
        *numbers, added = self._at(components, x)
        along = (added or self.evaluator.alone).along(self.layout.shared + self.layout.local)
        state, moved = self.evaluator.mapped(self.poses, [0], *numbers, added, along)[0]
        return state.rod.section, moved.rod.section

    # --- the vector of a pose

    def _at(self, components, x):
        """The shared numbers of a hypothesis, its local ones (P, local), and its effects."""
        index = Index(self, components)
        shared, local = x[: index.shared], x[index.shared : index.base].reshape(index.poses, index.local)
        return shared, local, self._added(components, x) if components else None

    def _added(self, components, x, absent: Sequence[Component] = ()) -> Added:
        """The effects of a hypothesis; those ``absent`` have their sites, too."""
        sites = self.sites | {c.kind: self.sites[c.kind] | _arrays(c.site) for c in (*components, *absent)}
        at, count, moving = list(self.layout_of_effects.values())[-1]
        null = np.zeros(at + count + len(moving))
        for kind, (at, count, moving) in self.layout_of_effects.items():
            null[at + count : at + count + len(moving)] = [sites[kind][name] for name in moving]
        places = [np.zeros(0, int)]
        for c in components:
            at, count, moving = self.layout_of_effects[c.kind]
            places += [at + np.arange(count), at + count + np.array([moving.index(name) for name in c.moving], int)]
        kinds, values, c = tuple(self.layout_of_effects.items()), x[Index(self, components).base :], self.context
        scene = {"length": np.asarray(c.length), "centre": np.asarray(c.centre, float), "up": c.up}
        history, previous = self.poses.history, np.stack(self.previous)
        if history is not None:  # what it keeps of the pose before is declared
            previous = np.zeros((history.poses.count, *previous.shape[1:]))
        return Added(kinds, sites, null, np.concatenate(places), values, scene, previous)


def _entries(context: Context) -> list[CatalogueEntry]:
    """The effect types that have a site: some act at clamps only."""
    return [e for e in (*catalogue(), *fields(), *laws()) if e.sites(context)]


def slots_of(study) -> tuple[AbstractEffect, ...]:
    """Energy laws of the whole catalogue at zero amplitude, with which `fit` compiles what a search needs."""
    c = Context(1.0, 1.0, 1.0, 1.0, np.asarray(study.gravity, float), (1.0, 2.0), clamped_ends=study.clamped_ends)
    return states.slots_of([effect for own in _absent(c).values() for effect in own])


def _absent(c: Context) -> dict[str, tuple[AbstractEffect, ...]]:
    """The effects of each type at zero amplitude."""
    return {e.kind: e.build(jnp.zeros(len(e.amplitudes)), e.sites(c)[0] | e.rest(c), c) for e in _entries(c)}


def _packed(wanted: list[Component], held: Collection[str]) -> list[list[list[int]]]:
    """Components in calls of `states.WIDTH` amplitudes, in parts of at most `FEW`: each effect type once in a part, one whose
    site is ``held`` once in a call."""
    calls: list[list[list[int]]] = []

    def room(c, call, part):
        rivals = {wanted[j].kind for own in (call if c.kind in held else [part]) for j in own}
        return c.kind not in rivals and sum(len(wanted[j].entry.amplitudes) for j in part) + len(c.entry.amplitudes) <= FEW

    for k in sorted(range(len(wanted)), key=lambda k: -len(wanted[k].entry.amplitudes)):
        c = wanted[k]
        own = next((part for call in calls for part in call if room(c, call, part)), None)
        if own is None:
            calls.append([[] for _ in range(states.WIDTH // FEW)])
            own = calls[-1][0]
        own.append(k)
    return [[part for part in call if part] for call in calls]


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
