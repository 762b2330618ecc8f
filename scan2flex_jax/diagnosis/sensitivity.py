"""Signatures: sensitivities of the residual to every entry of the catalogue at the baseline fit, without refits.

A `Component` is one effect type at one candidate site (position, width or threshold). `Bench` maps parameters (shared, local,
amplitudes, continuous parts of the sites) to states (`fitting.states`), solves all poses, and differentiates. At zero amplitude
the columns of the whole catalogue share the factorisation of the base model, so each costs one back-substitution.

With memory the base is solved in the order of the poses; effects are added to poses whose history is that of the baseline fit.

Units: residuals in m; columns in m per unit of their parameter; amplitudes as in the catalogue.
"""

from copy import copy
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, cast

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from scan2flex_jax.compilation import lightly_compiled
from scan2flex_jax.diagnosis.slots import empty_slots, load_of_fields
from scan2flex_jax.effects import ordered
from scan2flex_jax.effects.catalogue import catalogue, entry_of
from scan2flex_jax.effects.catalogue import laws as moment_laws
from scan2flex_jax.effects.entry import CatalogueEntry, Context, Site
from scan2flex_jax.fitting import discrepancy, states
from scan2flex_jax.fitting.evaluate import Evaluator, one, target_of
from scan2flex_jax.fitting.parameters import boundary_at, model_at
from scan2flex_jax.fitting.threads import each_pose
from scan2flex_jax.rod.effect import overriding
from scan2flex_jax.rod.model import Configuration, Rod


@dataclass(frozen=True)
class Component:
    """One effect type of the catalogue at one site."""

    kind: str
    site: Site

    @property
    def entry(self) -> CatalogueEntry:
        """Its catalogue entry."""
        return entry_of(self.kind)

    @property
    def moving(self) -> tuple[str, ...]:
        """The parts of the site that are continuous."""
        return tuple(name for name in self.entry.moving if name in self.site)


class Numbers:
    """Index of the parameters of a model in one vector: shared, local of all poses, then per component amplitudes, site."""

    def __init__(self, bench, components):
        """Count the parameters of each group."""
        self.shared, self.local, self.poses = bench.layout.shared, bench.layout.local, bench.poses.count
        self.sizes = [(len(c.entry.amplitudes), len(c.moving)) for c in components]
        self.base = self.shared + self.local * self.poses
        local, known = self.local * self.poses, bench.layout.prior
        self.nuisance = np.r_[known.at, np.arange(self.shared, self.base)]
        self.prior_mean, self.prior_std = np.r_[known.mean, np.zeros(local)], np.r_[known.std, np.ones(local)]
        self.count = self.base + sum(a + s for a, s in self.sizes)

    def of_pose(self, i: int) -> np.ndarray:
        """Indices of the parameters of pose ``i``."""
        local = self.shared + i * self.local + np.arange(self.local)
        return np.r_[np.arange(self.shared), local, np.arange(self.base, self.count)].astype(int)

    def amplitudes(self, k: int) -> np.ndarray:
        """Indices of the amplitudes of component ``k``."""
        at = self.base + sum(a + s for a, s in self.sizes[:k])
        return np.arange(at, at + self.sizes[k][0])

    def site(self, k: int) -> np.ndarray:
        """Indices of the continuous parts of the site of component ``k``."""
        at = self.base + sum(a + s for a, s in self.sizes[:k]) + self.sizes[k][0]
        return np.arange(at, at + self.sizes[k][1])


class Bench:
    """A fitted study with the sensitivities of its residual to parameters and effects."""

    def __init__(self, problem, minimum, poses=None):
        """From a fit's problem and minimum; ``poses``: others than the fitted ones (for prediction)."""
        self.problem, self.minimum, self.layout = problem, minimum, problem.layout
        self.elements, self.poses = problem.elements, problem.poses if poses is None else poses
        self.start = minimum.evaluation.configuration if poses is None else self.poses.start
        self.context = context_of(problem, minimum)
        self.previous = _previous(problem, minimum, self.poses)
        self.in_order = None if self.poses.history is None else problem.evaluator_of(self.poses)
        if self.in_order is not None:
            local = minimum.local if poses is None else np.zeros((self.poses.count, self.layout.local))
            self.poses = self.in_order.remembered(minimum.shared, local, self.start)
        self.nulls, self.late = empty_slots(self.context), empty_slots(self.context, moment_laws())
        self.real = [np.asarray(m) > 0 for m in self.poses.mask]
        self.off = _root_mean_square(minimum.evaluation.residual, problem.poses.mask)
        self.solves = 0

    def only(self, which) -> "Bench":
        """The same fitted study with the poses ``which``, in this order."""
        some = copy(self)
        some.poses = self.poses.only(which)
        some.in_order = None if self.in_order is None else self.problem.evaluator_of(self.in_order.poses.only(which))
        some.start = jax.tree.map(lambda x: np.asarray(x)[np.array(which, int)], self.start)
        some.previous, some.real = ([values[i] for i in which] for values in (self.previous, self.real))
        return some

    def shapes(self, components, vector, start=None, derivative=True):
        """All poses solved at the parameters: a list of `fitting.states.Shape`, columns in the order of `Numbers.of_pose`."""
        numbers, start = Numbers(self, components), self.start if start is None else start
        if self.in_order is not None and not components:
            return self._shapes_in_order(self.in_order, vector, numbers, start)

        def solved(i):
            state, tangents = self._state(components, vector[numbers.of_pose(i)], i)
            return self._solve(state, tangents if derivative else None, i, one(start, i))

        return self._each(solved)

    def _shapes_in_order(self, evaluator: Evaluator, vector, numbers, start):
        """The shapes of the base with memory, with derivatives through the order of the poses."""
        local = vector[numbers.shared : numbers.base].reshape(numbers.poses, numbers.local)
        e = evaluator(vector[: numbers.shared], local, start=start)
        self.solves += numbers.poses
        shapes = [states.Shape(*one(e, i)) for i in range(numbers.poses)]
        marked = self.poses.marked
        return shapes if marked is None else [s._replace(marked=m) for s, m in zip(shapes, marked, strict=True)]

    def catalogue_columns(self, vector, components, start):
        """Per pose the columns (m, 3, K) of all components at zero amplitude, and the component of each column.

        ``start`` must be the equilibrium of ``vector``. Most effect types share its factorisation. A section law with a scanned
        knee changes the state at every site, and is solved once for each.
        """
        kinds, laws = self._of_catalogue(components)

        def columns(i):
            parts = self.catalogue_tangents(vector, components, start, i)
            return np.concatenate([self._solve(state, t, i, one(start, i)).columns for state, t in parts], axis=-1)

        owner = [k for same in kinds.values() for k in same] + laws
        return self._each(columns), np.array([k for k in owner for _ in components[k].entry.amplitudes])

    def catalogue_tangents(self, vector, components, start, i):
        """States of pose ``i`` and their derivatives with respect to the components at zero amplitude: one state for most
        effect types, and one for each scanned law."""
        kinds, laws = self._of_catalogue(components)
        x, here = vector[Numbers(self, ()).of_pose(i)], one(start, i)
        of_laws = [self._law(components[k], x, i) for k in laws]
        if not kinds:
            return of_laws
        parts = [self._scan(kind, [components[k] for k in same], x, i, here) for kind, same in kinds.items()]
        return [(self._state((), x, i)[0], jax.tree.map(lambda *t: np.concatenate(t), *parts)), *of_laws]

    def _of_catalogue(self, components):
        """Components by effect type, and the scanned laws."""
        laws = [k for k, c in enumerate(components) if self._is_scanned_law(c)]
        kinds: dict[str, list[int]] = {}
        for k, c in enumerate(components):
            if k not in laws:
                kinds.setdefault(c.kind, []).append(k)
        return kinds, laws

    def _is_scanned_law(self, component):
        slots = (self.nulls | self.late).get(component.kind, ())
        return bool(component.site) and bool(overriding(slots, "strain_energy"))

    def _law(self, component, x, i):
        count = len(component.entry.amplitudes)
        null = np.r_[x, np.zeros(count), [float(component.site[name]) for name in component.moving]]
        state, tangents = self._state((component,), null, i)
        return state, jax.tree.map(lambda t: t[len(x) : len(x) + count], tangents)

    def field_columns(self, vector, make, shape, start):
        """Columns of a field outside the catalogue: ``make(values)`` gives its effect."""
        numbers = Numbers(self, ())

        def columns(i):
            x = vector[numbers.of_pose(i)]
            state, _ = self._state((), x, i)
            given = (self.layout, self.elements, make, shape, self.poses.template(i), one(self.poses.boundary, i))
            tangents = _field(*given, jnp.asarray(x), self.nulls)
            return self._solve(state, jax.tree.map(np.asarray, tangents), i, one(start, i)).columns

        return self._each(columns)

    def natural_columns(self, vector, natural, start) -> list[np.ndarray]:
        """Per pose the columns (m, 3, K) of natural strains ``natural`` (poses, K, n, 6) at the equilibrium ``start``."""
        numbers = Numbers(self, ())

        def columns(i):
            state, _ = self._state((), vector[numbers.of_pose(i)], i)
            along = eqx.tree_at(lambda t: t.rod.section.natural, states.still(state, len(natural[i])), np.asarray(natural[i]))
            return self._solve(state, along, i, one(start, i)).columns

        return self._each(columns)

    def scatter(self, components, vector, start) -> tuple[np.ndarray, ...]:
        """Per pose the columns (m, 3, k) of its discrepancy at an equilibrium (`fitting.discrepancy`), in m per 1/m."""
        numbers = Numbers(self, components)

        def columns(i):
            state, _ = self._state(components, vector[numbers.of_pose(i)], i)
            return self._solve(state, discrepancy.directions(state), i, one(start, i)).columns

        return tuple(self._each(columns))

    def _each(self, work):
        self.solves += self.poses.count
        return each_pose(work, self.poses.count)

    def stiffness(self, found) -> np.ndarray:
        """Stiffness (6, 6) of the first section at the base numbers of a refit, without its effects."""
        x = found.vector[Numbers(self, found.components).of_pose(0)][: self.layout.shared + self.layout.local]
        return np.asarray(self._state((), x, 0)[0].rod.section.stiffness[0])

    def rods(self, found) -> list[tuple[Rod, Configuration]]:
        """The rod of each pose at a refit, with its energy laws, and its equilibrium."""
        of_pose = Numbers(self, found.components).of_pose
        states_ = (self._state(found.components, found.vector[of_pose(i)], i)[0] for i in range(self.poses.count))
        return [(state.rod, shape.configuration) for state, shape in zip(states_, found.shapes, strict=True)]

    def _solve(self, state, tangents, i, start):
        tangents = states.no_tangents(state) if tangents is None else tangents
        return states.evaluate(state, tangents, start, target_of(self.poses, i))

    def _state(self, components, x, i):
        kinds, sites = tuple(c.kind for c in components), tuple(_numeric(c.site) for c in components)
        moving = tuple(c.moving for c in components)
        given = (self.layout, self.elements, kinds, moving, self.poses.template(i), one(self.poses.boundary, i), jnp.asarray(x))
        nulls = self.nulls | self.late if any(c.entry.late for c in components) else self.nulls
        state, tangents = _state(*given, sites, self._scene(i), nulls)
        return state, jax.tree.map(np.asarray, tangents)

    def _scan(self, kind, components, x, i, start):
        sites = jax.tree.map(lambda *v: np.stack(v), *[_numeric(c.site) for c in components])
        given = (self.layout, self.elements, kind, len(components), self.poses.template(i), one(self.poses.boundary, i))
        return jax.tree.map(np.asarray, _scan(*given, jnp.asarray(x), sites, self._scene(i), self.nulls, start))

    def _scene(self, i):
        c = self.context
        return {"length": np.asarray(c.length), "centre": np.asarray(c.centre, float), "up": c.up, "previous": self.previous[i]}


def all_components(context: Context, skip=()) -> list[Component]:
    """The whole catalogue: every effect type at every site."""
    return [Component(e.kind, s) for e in catalogue() if e.kind not in skip for s in e.sites(context)]


def context_of(problem, minimum) -> Context:
    """Scales of the cable and of its shapes, from the baseline fit."""
    model = model_at(problem.layout, problem.template, jnp.asarray(minimum.shared))
    cable, c = model.cable, minimum.evaluation.configuration
    gravity = np.asarray(problem.study.gravity, float)
    up = -gravity / max(np.linalg.norm(gravity), 1e-12)
    points = [np.asarray(p)[np.asarray(m) > 0] for p, m in zip(problem.poses.points, problem.poses.mask, strict=True)]
    lowest = [float((p @ up).min()) for p in points]
    radius = problem.study.cable.get("radius")
    return Context(
        length=float(cable.length), bending_stiffness=float(np.mean(cable.bending_stiffness)),
        torsional_stiffness=float(cable.torsional_stiffness), gravity=gravity,
        weight=float(cable.length_density) * float(np.linalg.norm(gravity)),
        curvature_range=_curvature_range(c.R, problem.length), lowest_range=(min(lowest), max(lowest)),
        radius=None if radius is None else float(radius), axial_stiffness=float(cable.axial_stiffness),
        centre=np.mean(np.concatenate(points), axis=0), points=np.concatenate(points), clamped_ends=problem.study.clamped_ends,
        free_end=any(pose.end is None for pose in problem.study.fit_poses),
    )  # fmt: skip


def with_shapes(context: Context, configuration) -> Context:
    """The scales with the range of curvatures of other shapes, those of a model that bends elsewhere."""
    return replace(context, curvature_range=_curvature_range(configuration.R, context.length))


def _curvature_range(R, length):
    """Smallest and largest of the poses' largest curvatures (1/m), from their node frames."""
    largest = [float(np.abs(_curvature(r, length)[:, :2]).max()) for r in np.asarray(R)]
    return min(largest), max(largest)


def _root_mean_square(residual, mask) -> float:
    """RMS (m) of the coordinates of residuals at all real points."""
    weight = np.asarray(mask)[:, :, None]
    return float(np.sqrt(np.sum(weight * np.asarray(residual) ** 2) / (3.0 * np.sum(weight))))


def _curvature(R, length):
    """Curvature (1/m, about d1, d2, d3) between nodes, to second order in the mesh."""
    Q = np.einsum("nji,njk->nik", R[:-1], R[1:])
    skew = 0.5 * np.stack([Q[:, 2, 1] - Q[:, 1, 2], Q[:, 0, 2] - Q[:, 2, 0], Q[:, 1, 0] - Q[:, 0, 1]], axis=1)
    return skew * len(Q) / length


def _previous(problem, minimum, poses):
    """Per pose the curvature (21, 3) of the last fitted pose measured before it; zeros without one, and for poses outside the
    study."""
    study, R = problem.study, np.asarray(minimum.evaluation.configuration.R)
    keep, length = np.round(np.linspace(0, problem.elements - 1, 21)).astype(int), problem.length
    found = {p.name: _curvature(r, length)[keep] for p, r in zip(study.fit_poses, R, strict=True)}
    last, before = np.zeros((21, 3)), {}
    for pose in study.poses:
        before[pose.name] = last
        last = found.get(pose.name, last)
    groups = ((problem.poses, study.fit_poses), (problem.held_out, study.validate_poses))
    own = next((study_poses for some, study_poses in groups if poses is some), None)
    return [np.zeros((21, 3))] * poses.count if own is None else [before[p.name] for p in own]


def _numeric(site):
    return {name: np.asarray(value, float) for name, value in site.items()}


def _model(layout, template, x, kinds, amplitudes, sites, scene, nulls):
    """Model and slots with components added to the template at the shared parameters."""
    model = model_at(layout, template, x[: layout.shared])
    scene = SimpleNamespace(**scene)
    built = {k: entry_of(k).build(a, s, scene) for k, a, s in zip(kinds, amplitudes, sites, strict=True)}
    added = tuple(e for effects in built.values() for e in effects)
    slots = states.slots_of(model.effects)
    for kind, null in nulls.items():
        slots += states.slots_of(built[kind]) if kind in built else null
    return replace_effects(model, added), slots


def replace_effects(model, added):
    """The model with effects added, in the order of the format."""
    return type(model)(model.cable, model.gravity, ordered((*model.effects, *added)))


@lightly_compiled
def _state(layout, elements, kinds, moving, template, boundary, x, sites, scene, nulls):
    """State of one pose and its derivatives with respect to ``x``: shared, local, then amplitudes and sites."""
    base = layout.shared + layout.local

    def state(x):
        at, amplitudes, placed = base, [], []
        for kind, names, site in zip(kinds, moving, sites, strict=True):
            n = len(entry_of(kind).amplitudes)
            amplitudes.append(x[at : at + n])
            placed.append(site | {name: x[at + n + j] for j, name in enumerate(names)})
            at += n + len(names)
        model, slots = _model(layout, template, x, kinds, amplitudes, placed, scene, nulls)
        return states.state_of(model, boundary_at(layout, boundary, x[layout.shared : base]), elements, slots)

    return state(x), jax.vmap(lambda t: jax.jvp(state, (x,), (t,))[1])(jnp.eye(len(x)))


@lightly_compiled
def _scan(layout, elements, kind, count, template, boundary, x, sites, scene, nulls, start):
    """Derivatives of the state with respect to the zero amplitudes of one effect type, at all sites: (sites * amplitudes).

    To first order an outer field is the dead load that it exerts at the equilibrium ``start``, so that one state serves all
    its sites.
    """
    null = jnp.zeros(len(entry_of(kind).amplitudes))

    def at_site(site):
        def state(a):
            model, slots = _model(layout, template, x, (kind,), (a,), (site,), scene, nulls)
            return states.state_of(model, boundary_at(layout, boundary, x[layout.shared :]), elements, slots)

        def load(a):
            fields = entry_of(kind).build(a, site, cast(Any, SimpleNamespace(**scene)))
            return load_of_fields(fields, state(null), start)

        tangents = jax.vmap(lambda t: jax.jvp(state, (null,), (t,))[1])(jnp.eye(len(null)))
        if not overriding(nulls.get(kind, ()), "node_potential"):
            return tangents
        loads = jax.vmap(lambda t: jax.jvp(load, (null,), (t,))[1])(jnp.eye(len(null)))
        still = jax.tree.map(jnp.zeros_like, tangents.rod.effects)
        return eqx.tree_at(lambda t: (t.rod.load, t.rod.effects), tangents, (loads, still))

    return jax.tree.map(lambda v: v.reshape(-1, *v.shape[2:]), jax.vmap(at_site, axis_size=count)(sites))


@lightly_compiled
def _field(layout, elements, make, shape, template, boundary, x, nulls):
    size = int(np.prod(shape))
    slots = tuple(s for null in nulls.values() for s in null)

    def state(values):
        model = model_at(layout, template, x[: layout.shared])
        model = replace_effects(model, (make(values.reshape(shape)),))
        b = boundary_at(layout, boundary, x[layout.shared :])
        return states.state_of(model, b, elements, states.slots_of(model.effects) + slots)

    return jax.vmap(lambda t: jax.jvp(state, (jnp.zeros(size),), (t,))[1])(jnp.eye(size))
