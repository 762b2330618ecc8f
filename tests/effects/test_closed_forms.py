"""What each effect does to a rod whose answer is known.

Sixteen elements; what they leave is said where it is not the least.
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.special import fresnel

from scan2flex_jax.effects.support_plane import CONTACT, ROUNDING
from scan2flex_jax.geometry import lie
from scan2flex_jax.rod.model import CableModel, discretise

from . import scene

L, EI, GJ, RHO, G = 1.0, 0.02, 0.015, 0.1, 9.81
DOWN = jnp.array([0.0, 0.0, -G])
NOWHERE = jnp.zeros(3)


def hanging():
    boundary = scene.straight((0.0, 0.0, -1.0))
    return {"boundary": boundary, "start": scene.start_of(boundary, 0.0)}


def tip(*effects, **scenery):
    return scene.solved(*effects, **{**scene.level(), **scenery})[0][-1]


def stiffened(**changes):
    return dataclasses.replace(scene.CABLE, **changes)


def test_point_mass_on_the_tip():
    mass = 1e-5
    end = tip(scene.effect("point_mass", position=L, mass=mass), gravity=DOWN, cable=stiffened(length_density=0.0))
    np.testing.assert_allclose(-end[2], mass * G * L**3 / (3 * EI), rtol=2e-3)


def test_a_load_on_the_tip_moves_smoothly_to_its_place():
    """Its place may be unknown: the tip's deflection F s^2 (3 L - s) / (6 EI) has the slope F L^2 / (2 EI) at the tip."""
    force, step = 1e-4, 1e-3

    def deflection(position):
        load = scene.effect("point_load", position=position, force=jnp.array([0.0, 0.0, -force]))
        return -tip(load, gravity=NOWHERE)[2]

    np.testing.assert_allclose(deflection(L), force * L**3 / (3 * EI), rtol=2e-3)
    slope = (deflection(L) - deflection(L - step)) / step
    np.testing.assert_allclose(slope, force * L**2 / (2 * EI), rtol=5e-3)


def test_point_mass_is_a_point_load_straight_down():
    mass = scene.active("point_mass")
    load = scene.effect("point_load", position=mass.position, force=mass.mass * scene.DOWN)
    np.testing.assert_allclose(scene.solved(mass)[0], scene.solved(load)[0], atol=1e-12)


def test_uniform_load_is_a_tilt_of_gravity():
    load = scene.active("uniform_load")
    tilted = scene.solved(gravity=scene.DOWN + load.force / RHO)[0]
    np.testing.assert_allclose(scene.solved(load)[0], tilted, atol=1e-12)


def test_distributed_load_of_one_value_is_a_uniform_load():
    load = scene.active("uniform_load")
    field = scene.effect("distributed_load", force=np.tile(load.force, (3, 1)))
    np.testing.assert_allclose(scene.solved(field)[0], scene.solved(load)[0], atol=1e-12)


@pytest.mark.parametrize(("angle", "factor"), [(0.0, 1.8), (np.pi / 2, 1.0)])
def test_anisotropy_bent_about_one_axis(angle, factor):
    """The level cantilever bends about d2, so its stiffness is that of the other axis for angle 0."""
    bent = tip(scene.effect("anisotropic_bending", ratio=1.8, angle=angle), gravity=DOWN)
    other = stiffened(bending_stiffness=jnp.full(2, factor * EI))
    np.testing.assert_allclose(bent, tip(gravity=DOWN, cable=other), atol=1e-11)


def test_extensible_cable_hangs_longer():
    EA = 60.0
    longer = tip(scene.effect("extensibility", axial_stiffness=EA), gravity=DOWN, **hanging())
    np.testing.assert_allclose(-longer[2] - L, RHO * G * L**2 / (2 * EA), rtol=1e-9)


def test_elastic_clamp_turns_by_moment_over_stiffness():
    """Small load: the cantilever's tip drops by (M/k) L more, M = rhoA g L^2 / 2."""
    light, k = stiffened(length_density=1e-5), 0.05
    base = tip(gravity=DOWN, cable=light)
    soft = tip(scene.effect("elastic_clamp", stiffness=[k, 1.0]), gravity=DOWN, cable=light)
    np.testing.assert_allclose((base - soft)[2], 1e-5 * G * L**3 / (2 * k), rtol=1e-3)


def test_elastic_clamp_turns_far():
    """A stiff bar on the spring: ``k theta = 1/2 rhoA g L^2 cos(theta)``, but for ``ds theta^2``."""
    k, bar = 0.5, stiffened(bending_stiffness=jnp.full(2, 200.0))
    x = tip(scene.effect("elastic_clamp", stiffness=[k, 1.0]), gravity=DOWN, cable=bar)
    theta = 0.0
    for _ in range(200):
        theta = 0.5 * theta + 0.5 * RHO * G * L**2 / 2 * np.cos(theta) / k
    np.testing.assert_allclose(np.arctan2(-x[2], x[0]), theta, atol=0.2 * theta**2 / scene.ELEMENTS)


def test_kink_turns_a_free_cable():
    angle, position = np.array([0.3, -0.2, 0.1]), 0.43
    kink = scene.effect("kink", angle=angle, position=position)
    _, _, found = scene.solved(kink, gravity=NOWHERE, loaded=False, **scene.level())
    R = found.configuration.R
    np.testing.assert_allclose(R[-1], R[0] @ lie.so3_exp(jnp.array(angle)), atol=1e-9)
    flat = np.array([0.0, 0.02, 0.0])
    end = tip(scene.effect("kink", angle=flat, position=position, width=0.0), gravity=NOWHERE, loaded=False)
    np.testing.assert_allclose(abs(end[2]), (L - position) * 0.02, rtol=1e-3)


def test_tether_pulls_towards_its_anchor():
    """All forces on the cable balance: clamp, weight and ``k (distance - rest_length)``."""
    k, rest, position, anchor = 3.0, 0.1, 0.47, np.array([0.3, 0.2, 0.3])
    tether = scene.effect("tether", position=position, anchor=anchor, stiffness=k, rest_length=rest)
    points, _, found = scene.solved(tether, gravity=DOWN, **scene.level())
    i, t = int(position * scene.ELEMENTS), position * scene.ELEMENTS % 1
    d, ds = found.configuration.R[:, :, 2], L / scene.ELEMENTS
    place = points[i] * (1 - 3 * t**2 + 2 * t**3) + points[i + 1] * (3 * t**2 - 2 * t**3)
    place = place + ds * (d[i] * (t - 2 * t**2 + t**3) + d[i + 1] * (t**3 - t**2))
    span = anchor - place
    pull = k * (1 - rest / np.linalg.norm(span)) * span
    reaction = scene.reactions(found)[0][0]
    np.testing.assert_allclose(reaction + pull + RHO * L * DOWN, 0.0, atol=2e-3 * np.linalg.norm(pull))


def test_slack_tether_does_nothing():
    tether = scene.effect("tether", stiffness=5.0, rest_length=2.0)
    np.testing.assert_allclose(scene.solved(tether)[0], scene.base_points(), atol=1e-12)


def test_plane_carries_what_the_clamps_do_not():
    """Clamps, weight and plane balance, and the cable hardly sinks."""
    points, _, found = scene.solved(scene.active("support_plane"))
    normal = np.array(scene.NORMAL) / np.linalg.norm(scene.NORMAL)
    d, depth = ROUNDING * L / scene.ELEMENTS, -0.25 - points @ normal
    p = np.clip(depth, 0, d)
    pressure = CONTACT * (p**2 / (2 * d) + np.maximum(depth - d, 0))
    carried = np.trapezoid(pressure, dx=L / scene.ELEMENTS) * normal
    assert np.any(depth > 0)
    assert np.max(depth) < 3e-4 * L
    total = np.sum(scene.reactions(found)[0], axis=0) + carried + RHO * L * scene.DOWN
    assert np.abs(total).max() < 1e-8


def test_elastic_support_carries_the_weight():
    k = 60.0
    bed = scene.effect("elastic_support", normal=[0.0, 0.0, 1.0], offset=0.0, stiffness=k)
    points, _, found = scene.solved(bed, gravity=DOWN, **scene.level())
    np.testing.assert_allclose(points[-1, 2], -RHO * G / k, rtol=3e-2)
    carried = -k * np.trapezoid(points[:, 2], dx=L / scene.ELEMENTS)
    np.testing.assert_allclose(scene.reactions(found)[0][0][2] + carried, RHO * G * L, rtol=1e-8)


@pytest.mark.parametrize("turn", [0.4, 5.0])
def test_nonlinear_bending_rolled_up(turn):
    """Pure bending of a free-moving, turned end: uniform curvature, moment as the format says."""
    slip, ratio = 1.5, 0.3
    law = scene.effect("nonlinear_bending", slip_curvature=slip, ratio=ratio)
    _, _, found = scene.solved(law, gravity=NOWHERE, loaded=False, **scene.turned_end([0.0, 1.0, 0.0], turn))
    moment = EI * turn / L * (ratio + (1 - ratio) / np.sqrt(1 + (turn / L / slip) ** 2))
    np.testing.assert_allclose(np.linalg.norm(scene.reactions(found)[1], axis=1), moment, rtol=1e-7)


def test_tension_twists():
    """At the end of a hanging cable with a weight: ``tau = -lever N / GJ``."""
    lever, N = 1e-3, 2.0
    weight = scene.effect("point_load", position=L, force=[0.0, 0.0, -N])
    coupling, light = scene.effect("tension_twist_coupling", lever=lever), stiffened(length_density=0.0)
    _, _, found = scene.solved(coupling, weight, gravity=DOWN, cable=light, **hanging())
    twist = lie.so3_log(found.configuration.R[0].T @ found.configuration.R[-1])
    np.testing.assert_allclose(twist, [0.0, 0.0, -lever * N / GJ * L], rtol=1e-8, atol=1e-10)


def test_tension_stiffens():
    """The law's own derivatives: moment ``(EI + gain N) k``."""
    gain = 4e-4
    effects = (scene.effect("tension_stiffening", gain=gain),)
    rod = discretise(CableModel(scene.CABLE, DOWN, effects), scene.straight(), 2)
    strain, K = jnp.array([0.0, 0.0, 1e-3, 3.0, -2.0, 0.0]), rod.section.stiffness[0]
    n = K @ strain + jax.grad(rod.effects[0].strain_energy)(strain, K)
    np.testing.assert_allclose(n[3:5], (EI + gain * n[2]) * np.array([3.0, -2.0]), rtol=1e-12)


def test_couplings_stand_where_the_format_says():
    effects = (scene.effect("bend_twist_coupling", coupling=[0.2, -0.1]),)
    K = discretise(CableModel(scene.CABLE, DOWN, effects), scene.straight(), 2).section.stiffness[0]
    np.testing.assert_allclose(K[3:5, 5], np.array([0.2, -0.1]) * np.sqrt(EI * GJ), rtol=1e-14)
    np.testing.assert_array_equal(K, K.T)


def test_a_curvature_that_grows_along_the_cable_is_a_clothoid():
    """Curvature k s about d2: the tip is at the Fresnel integrals, R(L) turned by k L^2 / 2.

    An element has the curvature of its middle, which puts its end off by k h^3 / 12 across: k h^2 L / 12 for all of them.
    """
    k = 2.5
    profile = scene.effect("curvature_profile", s=[0.0, L / 2, L], curvature=np.outer([0, k * L / 2, k * L], [0.0, 1.0, 0.0]))
    points, _, found = scene.solved(profile, gravity=NOWHERE, loaded=False, **scene.level())
    R = found.configuration.R
    np.testing.assert_allclose(R[-1], R[0] @ lie.so3_exp(jnp.array([0.0, k * L**2 / 2, 0.0])), atol=1e-9)
    sine, cosine = fresnel(L * np.sqrt(k / np.pi))
    tip_at = np.sqrt(np.pi / k) * (cosine * R[0][:, 2] + sine * R[0][:, 0])
    assert np.linalg.norm(points[-1] - tip_at) < k * (L / scene.ELEMENTS) ** 2 * L / 12


def test_a_load_that_grows_along_the_cable():
    """A line load q s / L bends the tip of a cantilever by 11 q L^4 / (120 EI)."""
    q = 1e-4
    load = scene.effect("distributed_load", s=[0.0, L / 2, L], force=np.outer([0, -q / 2, -q], [0.0, 0.0, 1.0]))
    end = tip(load, gravity=NOWHERE)
    np.testing.assert_allclose(-end[2], 11 * q * L**4 / (120 * EI), rtol=4e-3)


def test_natural_curvature_of_a_free_cable():
    curvature = np.array([0.5, -1.0, 0.8])
    for effect in (
        scene.effect("natural_curvature", curvature=curvature),
        scene.effect("memory_set", memory=0.5, previous=np.tile(2 * curvature, (4, 1))[:3]),
        scene.effect("curvature_profile", curvature=np.tile(curvature, (3, 1))),
    ):
        _, _, found = scene.solved(effect, gravity=NOWHERE, loaded=False, **scene.level())
        R = found.configuration.R
        np.testing.assert_allclose(R[-1], R[0] @ lie.so3_exp(jnp.array(curvature * L)), atol=1e-9)


def test_clamp_effects_move_the_clamps():
    offset, rotation = scene.active("clamp_offset"), scene.active("clamp_rotation")
    _, _, found = scene.solved(offset, rotation)
    b, c = scene.pose(), found.configuration
    for end, node in ((0, 0), (1, -1)):
        np.testing.assert_allclose(c.r[node], b.position[end] + b.rotation[end] @ offset.offset[end], atol=1e-14)
        np.testing.assert_allclose(c.R[node], b.rotation[end] @ lie.so3_exp(rotation.rotation[end]), atol=1e-14)


def test_length_error_is_another_length():
    longer = scene.effect("length_error", length=1.05)
    same = scene.solved(scene.effect("length_error", length=1.0), cable=stiffened(length=jnp.array(1.3)))[0]
    np.testing.assert_allclose(same, scene.base_points(), atol=1e-12)
    assert scene.solved(longer)[0][8, 2] < scene.base_points()[8, 2]


def test_scan_effects_act_on_what_is_seen():
    offset, scale = scene.effect("scan_offset", offset=[0.1, 0, 0]), scene.effect("scan_scale", factor=1.1)
    seen, _, found = scene.solved(offset, scale)
    np.testing.assert_allclose(seen, 1.1 * scene.base_points() + [0.1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(found.points, scene.base_points(), atol=1e-12)


def test_profiles_carry_their_weight_and_stiffness():
    """Clamp reaction of a heavier span and of a taper; the tip of a lightly loaded cantilever with a stiff span."""
    heavy, taper = scene.active("density_profile"), scene.active("density_taper")
    for effect, mass in ((heavy, RHO * (1 + 0.25 * 0.8)), (taper, RHO * np.sinh(0.3) / 0.3)):
        force = scene.reactions(scene.solved(effect, gravity=DOWN, **scene.level())[2])[0][0]
        np.testing.assert_allclose(force, [0, 0, mass * G * L], atol=1e-3 * mass * G)
    light, s = stiffened(length_density=1e-6), np.linspace(0, L, 200001)
    for kind, stiffness in (
        ("stiffness_profile", np.where(abs(s - 0.35) < 0.1, 2.0, 1.0)), ("stiffness_taper", np.exp(0.3 * (2 * s - 1)))
    ):  # fmt: skip
        drop = np.trapezoid(0.5e-6 * G * (L - s) ** 3 / (EI * stiffness), s)
        np.testing.assert_allclose(-tip(scene.active(kind), gravity=DOWN, cable=light)[2], drop, rtol=5e-3)
