"""The catalogue: its first-order signatures are those of the effects that it builds, and its tables are complete."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import scan2flex_jax.effects as fx
from scan2flex_jax.effects.catalogue import catalogue, entry_of
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.rod.effect import Node
from scan2flex_jax.rod.element_law import element_forces
from scan2flex_jax.rod.model import CableModel, discretise

from . import scene

ENTRIES = {entry.kind: entry for entry in catalogue()}
LAWS = ("bending_law", "torsion_law")  # tried last, not scanned for
MEMORIES = ("friction", "dahl", "torsion_friction", "relaxation")  # declared only: they take the poses in their order
# kind -> amplitudes and a site whose parameters in the format the scene's table holds
KNOWN = tuple(kind for kind in ENTRIES if kind not in ("tether", "support_plane", "elastic_support", "memory_set"))


@pytest.mark.parametrize("kind", scene.NO_AMPLITUDES)
def test_signature_is_the_slope_of_the_built_effects(kind):
    """Sign and size of the one-step estimate: the derivative at zero against a central (or one-sided) difference."""
    entry = ENTRIES[kind]
    for i in range(len(entry.amplitudes)):
        unit = np.eye(len(entry.amplitudes))[i]
        step = 1e-3 * float(entry.size(scene.CONTEXT)[i])
        _, slope, _ = scene.solved(tangent=scene.amplitude_direction(kind, unit))

        def at(h, unit=unit):
            return scene.solved(amplitudes={kind: jnp.asarray(h * unit)})[0]

        if entry.one_sided[i]:
            difference = (4 * at(step) - at(2 * step) - 3 * at(0.0)) / (2 * step)
        else:
            difference = (at(step) - at(-step)) / (2 * step)
        assert np.abs(slope).max() > 0
        assert np.abs(slope - difference).max() < 1e-4 * np.abs(slope).max() + 3e-11 / step


@pytest.mark.parametrize("kind", KNOWN)
def test_what_is_reported_is_what_was_built(kind):
    """Declared with the parameters that are reported, the effect changes the rod as the amplitudes do."""
    entry, c, site = ENTRIES[kind], scene.CONTEXT, scene.SITES[kind]
    a = entry.size(c) * np.linspace(1.0, 0.4, len(entry.amplitudes))
    built = entry.build(jnp.asarray(a), site, c)
    declared = fx.effect_of(kind, entry.parameters(a, site, c))
    given, wanted = rod_leaves(built), rod_leaves((declared,), **entry.rescaled(a, site, c))
    for one, other in zip(given, wanted, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-12)


def forces(effects, points):
    """Forces (N) of external fields on a node at each of some points (m)."""
    node = Node(jnp.zeros(3), jnp.eye(3), jnp.array(0.4), jnp.array(0.02), jnp.array(0.02), scene.pose())

    @jax.jit
    def force(r):
        return jax.jacrev(lambda r: [e.node_potential(dataclasses.replace(node, r=r)) for e in effects])(r)

    return [force(jnp.asarray(r)) for r in points]


@pytest.mark.parametrize("reach", [0.0, 0.3])
def test_a_string_pulls_as_the_tether_that_it_is_reported_as(reach):
    """A spring, and a string, taut and slack."""
    entry, c = ENTRIES["tether"], scene.CONTEXT
    string = {"reach": reach, "place": c.centre + 0.05, "softest": 1.0 / 6.0} if reach else {}
    site, a = {"position": 0.4} | string, np.array([2.5, 0.1, -0.2, 0.3])
    built, told = entry.build(jnp.asarray(a), site, c)[0], entry.parameters(a, site, c)
    assert (told["rest_length"] > 0) == (reach > 0)
    points = np.random.default_rng(1).uniform(-0.4, 0.4, (40, 3)) + c.centre
    found = forces((built, fx.Tether(**told)), points)
    for given, wanted in found:
        np.testing.assert_allclose(given, wanted, rtol=1e-9, atol=1e-9)
    assert any(not np.any(wanted) for _, wanted in found) == (reach > 0)


def test_a_pull_without_stiffness_is_reported_as_a_soft_spring_from_afar():
    """As a tether of stiffness zero it would be lost: declared, it has to pull as it did."""
    entry, c, pull = ENTRIES["tether"], scene.CONTEXT, np.array([0.3, -0.1, 0.6])
    told = entry.parameters(np.r_[0.0, pull], {"position": 0.4}, c)
    for r in np.random.default_rng(2).uniform(-0.4, 0.4, (10, 3)) + c.centre:
        np.testing.assert_allclose(told["stiffness"] * (told["anchor"] - r), pull, atol=2e-3 * np.linalg.norm(pull))


def rod_leaves(effects, **factors):
    """What effects make of sections, loads, supports, section law and scan; ``factors`` on parameters of the cable."""
    cable = dataclasses.replace(scene.CABLE, **{name: getattr(scene.CABLE, name) * f for name, f in factors.items()})
    rod = discretise(CableModel(cable, scene.DOWN, effects), scene.pose(), 8)
    points = jnp.arange(6.0).reshape(2, 3)
    for effect in effects:
        points = effect.observe(points)
    strain = jnp.array([0.0, 0.0, 0.001, 2.0, -3.0, 1.0])
    law = element_forces(rod, jnp.tile(strain, (8, 1)))
    return jax.tree.leaves((rod.section, rod.load, rod.boundary, points, law))


def test_entries_are_complete():
    for entry in catalogue():
        k, sites = len(entry.amplitudes), entry.sites(scene.CONTEXT)
        low, high = entry.bounds(scene.CONTEXT)
        assert np.shape(entry.size(scene.CONTEXT)) == (k,) == np.shape(low) == np.shape(high)
        assert np.all(entry.size(scene.CONTEXT) > 0)
        assert np.all(low <= 0)
        assert np.all(high > 0)
        assert np.all((low == 0) == np.array(entry.one_sided))
        assert 1 <= len(sites) <= 60
        assert len(entry.one_sided) == k
        assert entry.signature
        assert entry.settle
        assert entry.kind in fx.kinds() or entry.kind == "memory_set"
    ours = {kind for kind in fx.kinds() if fx.effect_class(kind).__module__.startswith("scan2flex_jax.")}
    fields = {"section_profile", "distributed_load", "curvature_profile"}
    assert ours <= set(ENTRIES) | fields | {*LAWS, *MEMORIES, *scene.SUPPORTS, "moment"}


def test_only_clamped_ends_can_yield():
    context = dataclasses.replace(scene.CONTEXT, clamped_ends=("start",))
    entry = entry_of("clamp_rotation")
    (site,) = entry.sites(context)
    assert entry.parameters(np.arange(6.0), site, context)["rotation"].shape == (1, 3)
    with pytest.raises(Scan2FlexError, match="no kind"):
        entry_of("elastic_clmap")


@pytest.mark.parametrize("kind", LAWS)
def test_steps_of_a_law_are_reported_as_its_factors(kind):
    """The steps of its random walk: none for the linear law, and the built effect has the factors that are reported."""
    entry, (site,) = entry_of(kind), entry_of(kind).sites(scene.CONTEXT)
    steps = np.linspace(-0.4, 0.2, len(entry.amplitudes))
    told = entry.parameters(steps, site, scene.CONTEXT)
    np.testing.assert_allclose(np.log(told["factor"]), np.cumsum(steps))
    (built,) = entry.build(jnp.asarray(steps), site, scene.CONTEXT)
    np.testing.assert_allclose(built.factor, told["factor"])
    (linear,) = entry.build(jnp.zeros(len(steps)), site, scene.CONTEXT)
    np.testing.assert_array_equal(linear.factor, 1.0)


def resting_curves(normal, offset, rng):
    """Hanging curves of 1 m above a plane, the lowest of them lying on it over a third of its length (m)."""
    s = np.linspace(0.0, 1.0, 120)
    curves = []
    for height, turn in ((0.0, 0.3), (0.05, 1.4), (0.12, 2.6)):
        across = np.outer(s - 0.5, [np.cos(turn), np.sin(turn), 0.0])
        sag = np.maximum(0.8 * (np.abs(s - 0.5) - 0.17), 0.0)
        floor = (offset - across @ normal) / normal[2]
        curves.append(across + np.outer(floor + height + sag, [0, 0, 1.0]) + 2e-4 * rng.standard_normal((120, 3)))
    return np.concatenate(curves)


def test_a_leaning_table_is_among_the_planes_to_look_at():
    normal = np.array([0.06, -0.04, 1.0]) / np.linalg.norm([0.06, -0.04, 1.0])
    points = resting_curves(normal, -0.3, np.random.default_rng(1))
    c = dataclasses.replace(scene.CONTEXT, points=points, gravity=np.array([0.0, 0.0, -9.81]))
    entry, found = ENTRIES["support_plane"], []
    for site in entry.sites(c):
        p = entry.parameters(entry.null, site, c)
        found.append(np.degrees(np.arccos(np.clip(p["normal"] @ normal, -1, 1))))
        assert abs(np.min(points @ p["normal"]) - p["offset"]) < 0.02 * c.length or np.degrees(np.arccos(p["normal"][2])) > 1
    assert min(found) < 1.0 < np.degrees(np.arccos(normal[2]))


@pytest.mark.parametrize("gravity", [[0.0, 0.0, 0.0], [0.0, 0.0, -9.81]])
@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.outer(np.linspace(0, 1, 30), [0, 0, 1.0])], ids=["none", "in line"])
def test_planes_are_finite_without_gravity_and_for_points_that_span_nothing(gravity, points):
    c = dataclasses.replace(scene.CONTEXT, gravity=np.array(gravity), points=points)
    for site in ENTRIES["support_plane"].sites(c):
        p = ENTRIES["support_plane"].parameters(np.zeros(1), site, c)
        assert np.linalg.norm(p["normal"]) == pytest.approx(1.0) and np.isfinite(p["offset"])
