"""One cable with every effect at once, each at its null value: compiled once, it serves all tests of single effects.

The model also carries what the catalogue builds of classes of its own (`BUILT`), from amplitudes that are zero.
"""

from dataclasses import replace
from functools import cache, partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import scan2flex_jax.effects as fx
from scan2flex_jax.effects.catalogue import catalogue
from scan2flex_jax.effects.entry import Context
from scan2flex_jax.geometry import lie
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.model import CableModel, Configuration
from scan2flex_jax.statics.solve import equilibrium
from scan2flex_jax.statics.starts import curve_start
from scan2flex_jax.statics.verdict import SOLVED, UNBALANCED

ELEMENTS = 16
DOWN = jnp.array([0.3, -0.5, -9.8])
CABLE = Cable(1.0, 0.1, 0.02, 0.015, axial_stiffness=1.0e4, shear_stiffness=1.0e5)
NORMAL, ANCHOR = [0.1, 0.2, 1.0], [0.3, 0.25, 0.05]
ROWS = np.array([[0.4, -0.3, 0.2], [-0.2, 0.5, 0.1], [0.3, 0.2, -0.4]])
PLACES = np.array([0.1, 0.45, 0.9])
KNOTS = np.array([1.0, 2.5, 5.0])
PAIR = np.array([[0.06, -0.04, 0.05], [0.03, 0.05, -0.02]])

# kind -> (null, active): the parameters that differ stand in `active`
VALUES = {
    "natural_curvature": ({"curvature": np.zeros(3)}, {"curvature": np.array([0.4, -0.5, 0.3])}),
    "kink": ({"position": 0.43, "angle": np.zeros(3), "width": 0.05}, {"angle": np.array([0.2, 0.1, -0.15])}),
    "anisotropic_bending": ({"ratio": 1.0, "angle": 0.4}, {"ratio": 1.7}),
    "bend_twist_coupling": ({"coupling": np.zeros(2)}, {"coupling": np.array([0.2, -0.1])}),
    "nonlinear_bending": ({"slip_curvature": 2.0, "ratio": 1.0}, {"ratio": 0.4}),
    "stiffness_profile": ({"position": 0.35, "width": 0.2, "factor": 1.0}, {"factor": 2.0}),
    "section_profile": (
        {"s": np.array([0.0, 0.4, 1.0]), "bending": np.ones(3), "torsion": np.ones(3), "density": np.ones(3)},
        {"bending": np.array([3.0, 1.5, 0.5]), "torsion": np.array([2.0, 1.0, 1.0]), "density": np.array([2.0, 1.0, 1.0])},
    ),
    "extensibility": ({"axial_stiffness": 1.0e4}, {"axial_stiffness": 60.0}),
    "point_mass": ({"position": 0.42, "mass": 0.0}, {"mass": 0.03}),
    "density_profile": ({"position": 0.65, "width": 0.25, "factor": 1.0}, {"factor": 1.8}),
    "uniform_load": ({"force": np.zeros(3)}, {"force": np.array([0.08, -0.05, 0.1])}),
    "point_load": ({"position": 0.58, "force": np.zeros(3)}, {"force": np.array([0.05, 0.1, -0.06])}),
    "tether": ({"position": 0.47, "anchor": ANCHOR, "stiffness": 0.0, "rest_length": 0.2}, {"stiffness": 2.0}),
    "support_plane": ({"normal": NORMAL, "offset": -9.0}, {"offset": -0.25}),
    "elastic_clamp": ({"stiffness": [np.inf, np.inf]}, {"stiffness": [0.7, 0.4]}),
    "clamp_rotation": ({"rotation": np.zeros((2, 3))}, {"rotation": PAIR}),
    "clamp_offset": ({"offset": np.zeros((2, 3))}, {"offset": 0.2 * PAIR}),
    "length_error": ({"length": 1.0}, {"length": 1.02}),
    "scan_scale": ({"factor": 1.0}, {"factor": 1.01}),
    "scan_offset": ({"offset": np.zeros(3)}, {"offset": np.array([0.01, -0.02, 0.015])}),
    "stiffness_taper": ({"taper": 0.0}, {"taper": 0.3}),
    "density_taper": ({"taper": 0.0}, {"taper": -0.3}),
    "stiffness_field": (
        {"s": PLACES, "log_factor": np.zeros(3), "density_power": 0.5},
        {"log_factor": np.array([0.5, -0.2, -0.6])},
    ),
    "tension_twist_coupling": ({"lever": 0.0}, {"lever": 2.0e-3}),
    "tension_stiffening": ({"gain": 0.0}, {"gain": 4.0e-4}),
    "elastic_support": ({"normal": NORMAL, "offset": -0.2, "stiffness": 0.0}, {"stiffness": 4.0}),
    "memory_set": ({"memory": 0.0, "previous": ROWS}, {"memory": 0.5}),
    "distributed_load": ({"s": PLACES, "force": 0.0 * ROWS}, {"force": 0.3 * ROWS}),
    "curvature_profile": ({"s": PLACES, "curvature": 0.0 * ROWS}, {"curvature": ROWS}),
    "bending_law": ({"curvature": KNOTS, "factor": np.ones(3)}, {"factor": np.array([0.8, 0.4, 0.5])}),
    "torsion_law": ({"twist": 0.5 * KNOTS, "factor": np.ones(3)}, {"factor": np.array([0.6, 0.7, 1.5])}),
    "friction": ({"share": 0.0, "slip_curvature": 1.0}, {"share": 0.5}),
    "dahl": ({"share": 0.0, "slip_curvature": 1.0}, {"share": 0.5}),
    "torsion_friction": ({"share": 0.0, "slip_twist": 0.5}, {"share": 0.4}),
    "moment": ({"position": 0.55, "axis": np.array([0.0, 0.8, 0.6]), "moment": 0.0}, {"moment": 0.02}),
    "relaxation": ({"share": 0.0, "time_constant": 60.0}, {"share": 0.3}),
}
KINDS = tuple(VALUES)
# without a null value: they hold the cable, or are not there
SUPPORTS = {
    "support": {"position": 0.4, "anchor": ANCHOR, "direction": np.array([0.6, 0.0, 0.8])},
    "knife_edge": {"anchor": ANCHOR, "along": np.array([0.8, 0.6, 0.0]), "direction": np.array([0.0, 0.0, 1.0])},
}
GIVEN = {kind: {**null, **active} for kind, (null, active) in VALUES.items()} | SUPPORTS
CONTEXT = Context(
    1.0, 0.02, 0.015, 0.1 * float(jnp.linalg.norm(DOWN)), np.asarray(DOWN), (1.0, 6.0), (-0.4, -0.2),
    axial_stiffness=1.0e4, centre=np.array([0.3, 0.0, -0.2]), previous=ROWS,
)  # fmt: skip
SITES = {entry.kind: entry.sites(CONTEXT)[0 if entry.effect.place == "clamps" else -5 :][0] for entry in catalogue()}
BUILT = [e for e in catalogue() if e.kind in ("anisotropic_bending", "extensibility", "tether", "length_error")]
NO_AMPLITUDES = {entry.kind: jnp.zeros(len(entry.amplitudes)) for entry in BUILT}


def effect(kind, **parameters):
    """An effect of the scene's values with some of them changed."""
    return fx.effect_class(kind)(**{**VALUES[kind][0], **parameters})


def active(kind):
    """An effect that does something."""
    return effect(kind, **VALUES[kind][1])


def with_effects(*changed):
    """All effects at their null values but those given."""
    given = {type(e).kind: e for e in changed}
    return tuple(given.get(kind, effect(kind)) for kind in KINDS)


def pose(turn=0.6):
    """A pose that lies in no plane."""
    q = jnp.array([np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)])
    along = jnp.array([0.5, 0.5, 0.5, 0.5])  # d3 along x
    x, y = 0.8, 0.1
    end = (jnp.array([0.6, 0.15, 0.05]), jnp.array([x * q[0], y, 0.59 * x, q[3]]))
    return Boundary.of((jnp.zeros(3), along), end)


def straight(direction=(1.0, 0.0, 0.0), held_end=(0.0,) * 6, length=1.0):
    """A cable that starts straight along ``direction`` from a clamp at the origin; ``held_end`` as in `Boundary`."""
    d3 = jnp.array(direction) / np.linalg.norm(direction)
    d1 = jnp.cross(d3, jnp.array([0.0, 1.0, 0.0]))
    d1 = d1 / jnp.linalg.norm(d1)
    R = jnp.stack([d1, jnp.cross(d3, d1), d3], axis=1)
    held = jnp.stack([jnp.ones(6), jnp.array(held_end)])
    return Boundary(jnp.stack([jnp.zeros(3), length * d3]), jnp.stack([R, R]), held)


@partial(jax.jit, static_argnames="sag")
def start_of(boundary, sag=0.3):
    """A curve from support to support, as a start that needs no search."""
    t = jnp.linspace(0.0, 1.0, 65)[:, None]
    p, d = boundary.position, boundary.rotation[:, :, 2]
    curve = (2 * t**3 - 3 * t**2 + 1) * p[0] + (3 * t**2 - 2 * t**3) * p[1]
    curve = curve + (t**3 - 2 * t**2 + t) * d[0] + (t**3 - t**2) * d[1]
    return curve_start(curve - 16 * sag * t**2 * (1 - t) ** 2 * jnp.array([0.0, 0.0, 1.0]), boundary, 0, ELEMENTS)


@cache
def level():
    """For `solved`: a cable that starts straight along x from its clamp."""
    boundary = straight()
    return {"boundary": boundary, "start": start_of(boundary, 0.0)}


def turned_end(axis, turn):
    """For `solved`: a cable whose end is free to move and turned by ``turn`` (rad), on its way there evenly."""
    boundary = straight(held_end=(0.0, 0.0, 0.0, 1.0, 1.0, 1.0))
    angle = jnp.linspace(0.0, turn, ELEMENTS + 1)
    R = jax.vmap(lambda a: boundary.rotation[0] @ lie.so3_exp(a * jnp.array(axis)))(angle)
    steps = (R[:-1, :, 2] + R[1:, :, 2]) / (2 * ELEMENTS)
    r = jnp.concatenate([jnp.zeros((1, 3)), jnp.cumsum(steps, 0)])
    boundary = replace(boundary, rotation=boundary.rotation.at[1].set(R[-1]))
    return {"boundary": boundary, "start": Configuration(r, R)}


@jax.jit
def _solve(changed, tangent, scene, boundary, start):
    cable, gravity = scene

    def run(effects, amplitudes):
        built = [e.build(amplitudes[e.kind], SITES[e.kind], CONTEXT) for e in BUILT]
        model = CableModel(cable, gravity, (*fx.ordered(effects), *(x for effects in built for x in effects)))
        found = equilibrium(model, boundary, start=start, elements=ELEMENTS)
        return found.observed, found

    return jax.jvp(run, changed, tangent, has_aux=True)


def solved(*changed, tangent=None, amplitudes=None, cable=CABLE, gravity=DOWN, boundary=None, start=None, loaded=True):
    """``(observed nodes, their derivative along tangent, equilibrium)`` with the given effects; must be solved.

    Without any load there is no force that the rounding left on the nodes could be compared with (``loaded`` false).
    """
    effects, amplitudes = with_effects(*changed), {**NO_AMPLITUDES, **(amplitudes or {})}
    boundary = pose() if boundary is None else boundary
    zero = jax.tree.map(jnp.zeros_like, (effects, amplitudes))
    tangent = zero if tangent is None else tangent(zero)
    start = start_of(boundary) if start is None else start
    observed, slope, found = _solve((effects, amplitudes), tangent, (cable, gravity), boundary, start)
    assert int(found.verdict.code) in ((SOLVED,) if loaded else (SOLVED, UNBALANCED)), jax.tree.leaves(found.verdict)
    return np.asarray(observed), np.asarray(slope), found


@jax.jit
def reactions(found):
    """Forces and moments of the supports on start and end."""
    return found.reactions()


@cache
def base_points():
    """The nodes of the cable without any effect."""
    run = jax.jit(lambda m, b, s: equilibrium(m, b, start=s, elements=ELEMENTS).points)
    return np.asarray(run(CableModel(CABLE, DOWN), pose(), start_of(pose())))


def direction_of(kind, name, along):
    """For `solved`: a tangent along one field of one effect."""

    def tangent(zero):
        effects, amplitudes = zero
        i = KINDS.index(kind)
        moved = eqx.tree_at(lambda e: getattr(e, name), effects[i], jnp.asarray(along, float))
        return (*effects[:i], moved, *effects[i + 1 :]), amplitudes

    return tangent


def amplitude_direction(kind, along):
    """For `solved`: a tangent along the amplitudes of one entry of the catalogue."""
    return lambda zero: (zero[0], {**zero[1], kind: jnp.asarray(along, float)})
