"""Supports between the ends: bending tests against closed forms and an independent boundary value problem.

The cable is a guidewire of E = 158.4 GPa and 0.79 mm, EI = 4.857e-3 N m^2, without weight unless a test gives it one.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_bvp

import scan2flex_jax.effects as fx
from scan2flex_jax.rod.assembly import derivatives, node_forces
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.energy import element_potential, elements, retract
from scan2flex_jax.rod.model import CableModel, discretise
from scan2flex_jax.statics.scaled import dense
from scan2flex_jax.statics.solve import equilibrium
from scan2flex_jax.statics.starts import default_start
from scan2flex_jax.statics.verdict import OFF_SUPPORT, SOLVED

EI, LENGTH, SPAN = 4.857e-3, 0.06, 0.05
OVER = 0.5 * (LENGTH - SPAN)
ELEMENTS = 24
UP, ALONG = [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]
FREE = Boundary.of(None, None)


@jax.jit
def solve(effects, tangent, cable, gravity, boundary):
    def run(effects, cable):
        return equilibrium(CableModel(cable, gravity, effects), boundary, elements=ELEMENTS)

    found, slope = jax.jvp(run, (effects, cable), tangent)
    return found, slope.points, found.support_reactions()


def guidewire(stiffness=EI, density=0.0):
    return Cable(LENGTH, density + 1e-9, stiffness, 0.8 * stiffness, axial_stiffness=1.0e8, shear_stiffness=1.0e8)


def solved(*effects, tangent=None, cable=None, gravity=(0.0, 0.0, 0.0), boundary=FREE, code=SOLVED):
    """``(equilibrium, derivative of its nodes, [(s, force) of each support])``; it has the given status."""
    model = CableModel(guidewire() if cable is None else cable, list(gravity), effects)
    zero = jax.tree.map(jnp.zeros_like, (model.effects, model.cable))
    tangent = zero if tangent is None else tangent(zero)
    found, slope, reactions = solve(model.effects, tangent, model.cable, model.gravity, boundary)
    assert int(found.verdict.code) == code, found.verdict.sentence()
    return found, np.asarray(slope), [(float(s), np.asarray(f)) for _, s, f in reactions]


def roller_and_pin(first=OVER, last=LENGTH - OVER):
    """A pin at the first place of the cable, and a roller at the other, ``SPAN`` apart or as far as the places are."""
    return fx.Support(first, [0.0, 0.0, 0.0]), fx.Support(last, [last - first, 0.0, 0.0], UP)


def forces(*pairs):
    """Two loads ``(place, size)`` downwards; one is enough."""
    pairs = (*pairs, (0.5 * LENGTH, 0.0))[:2]
    return tuple(fx.PointLoad(s, [0.0, 0.0, -f]) for s, f in pairs)


def grooves(span=SPAN):
    return fx.KnifeEdge([0.0, 0.0, 0.0], ALONG), fx.KnifeEdge([span, 0.0, 0.0], ALONG)


def deflection(found, s):
    """How far the cable lies below z = 0 at a place (m), which is a node."""
    k = round(s / LENGTH * ELEMENTS)
    assert abs(k * LENGTH / ELEMENTS - s) < 1e-12
    return -float(found.points[k, 2])


def test_three_point_bending():
    """F L^3/(48 EI) under the load; overhangs stay straight and rise with the slope F L^2/(16 EI); each support carries F/2."""
    force = 0.01
    found, _, reactions = solved(*roller_and_pin(), *forces((0.5 * LENGTH, force)))
    assert deflection(found, 0.5 * LENGTH) == pytest.approx(force * SPAN**3 / (48 * EI), rel=2e-5)
    assert deflection(found, 0.0) == pytest.approx(-OVER * force * SPAN**2 / (16 * EI), rel=1e-4)
    assert [s for s, _ in reactions] == pytest.approx([OVER, LENGTH - OVER])
    for _, f in reactions:
        np.testing.assert_allclose(f, [0.0, 0.0, 0.5 * force], atol=1e-5 * force)


@pytest.mark.parametrize("first", [0.0, 0.0007, 0.0043])
def test_supports_lie_between_nodes_or_at_the_ends(first):
    """The span is what is between them, wherever the nodes are."""
    force, span = 0.01, LENGTH - 2 * first
    found, _, _ = solved(*roller_and_pin(first, LENGTH - first), *forces((0.5 * LENGTH, force)))
    assert deflection(found, 0.5 * LENGTH) == pytest.approx(force * span**3 / (48 * EI), rel=5e-5)


def test_four_point_bending():
    """Two loads F at c from the supports: F c (3 L^2 - 4 c^2)/(24 EI) in the middle, and the constant moment F c between
    them."""
    force, c = 0.01, 0.0125
    found, _, reactions = solved(*roller_and_pin(), *forces((OVER + c, force), (LENGTH - OVER - c, force)))
    assert deflection(found, 0.5 * LENGTH) == pytest.approx(force * c * (3 * SPAN**2 - 4 * c**2) / (24 * EI), rel=2e-5)
    s, _, moment = found.section_forces()
    inner = (np.asarray(s) > OVER + c) & (np.asarray(s) < LENGTH - OVER - c)
    np.testing.assert_allclose(np.abs(np.asarray(moment)[inner, 1]), force * c, rtol=1e-3)
    assert sum(f[2] for _, f in reactions) == pytest.approx(2 * force, rel=1e-5)


def test_a_heavy_cable_on_a_pin_and_a_roller():
    """5 w L^4/(384 EI) without overhang."""
    density = 0.002
    found, _, _ = solved(*roller_and_pin(0.0, LENGTH), *forces(), cable=guidewire(density=density), gravity=(0.0, 0.0, -9.81))
    weight = 9.81 * density
    assert deflection(found, 0.5 * LENGTH) == pytest.approx(5 * weight * LENGTH**4 / (384 * EI), rel=2e-4)


def sliding_bend(force, span):
    """Deflection (m), cable between the edges (m), slope and force at an edge: the elastica whose edges push normal to it.

    From the middle (x, y, theta = 0) to the edge: EI kappa' = -N cos(theta - psi), with the slope psi and the force N at the
    edge, N cos psi = F/2; the arc length to the edge is unknown.
    """

    def slope(t, y, p):
        length, normal, psi = p
        return length * np.stack([np.cos(y[2]), np.sin(y[2]), y[3], -normal / EI * np.cos(y[2] - psi)])

    def ends(a, b, p):
        _, normal, psi = p
        return np.array([a[0], a[1], a[2], b[3], b[0] - 0.5 * span, b[2] - psi, normal * np.cos(psi) - 0.5 * force])

    t = np.linspace(0.0, 1.0, 41)
    bend = force * span / (4 * EI)
    guess = np.stack([0.5 * span * t, bend * span / 12 * t**2, 0.25 * bend * span * t, bend * (1 - t)])
    found = solve_bvp(slope, ends, t, guess, p=[0.5 * span, 0.5 * force, 0.2], tol=1e-9, max_nodes=20000)
    assert found.success
    return found.y[1, -1], 2 * found.p[0], found.p[2], found.p[1]


@pytest.mark.parametrize("force", [1.0, 8.0])
def test_large_deflection_over_edges(force):
    """The cable slides inwards, and the edges push normal to it, without friction."""
    depth, between, slope, normal = sliding_bend(force, SPAN)
    found, _, ((first, left), (last, right)) = solved(*grooves(), *forces((0.5 * LENGTH, force)))
    assert deflection(found, 0.5 * LENGTH) == pytest.approx(depth, rel=1e-4)
    assert last - first == pytest.approx(between, rel=1e-5)
    np.testing.assert_allclose(left, normal * np.array([np.sin(slope), 0.0, np.cos(slope)]), rtol=1e-3, atol=1e-4 * force)
    np.testing.assert_allclose(right, normal * np.array([-np.sin(slope), 0.0, np.cos(slope)]), rtol=1e-3, atol=1e-4 * force)


def test_a_cable_that_slides_off_an_edge_is_not_solved():
    """The overhang is shorter than what the bend draws in."""
    assert sliding_bend(9.0, LENGTH)[1] > LENGTH
    solved(*grooves(LENGTH - 1e-4), *forces((0.5 * LENGTH, 9.0)), code=OFF_SUPPORT)


def test_a_pin_alone_holds_no_cable_level():
    """It hangs down from the pin, as a pendulum: the support is a point."""
    pin = fx.Support(0.01, [0.0, 0.0, 0.0]), fx.Support(0.01, [0.0, 0.0, 0.0], UP)
    found, _, _ = solved(*pin, *forces((LENGTH, 0.5)))
    np.testing.assert_allclose(found.points[-1], [0.0, 0.0, -(LENGTH - 0.01)], atol=1e-5)


def slope_along(name, i, value=1.0):
    """A tangent along one field of one effect."""

    def tangent(zero):
        effects, cable = zero
        moved = eqx.tree_at(lambda e: getattr(e, name), effects[i], jnp.asarray(value, float))
        return (*effects[:i], moved, *effects[i + 1 :]), cable

    return tangent


def along_stiffness(zero):
    return zero[0], eqx.tree_at(lambda c: c.bending_stiffness, zero[1], jnp.ones_like(zero[1].bending_stiffness))


CASES = [
    (roller_and_pin, "position", 0, 1.0),
    (roller_and_pin, "anchor", 1, [0.3, 0.0, 0.8]),
    (grooves, "anchor", 0, [0.4, 0.2, 0.9]),
]


@pytest.mark.parametrize(("held", "name", "i", "along"), CASES)
def test_derivatives_by_the_place_of_a_support(held, name, i, along):
    effects = (*held(), *forces((0.5 * LENGTH, 2.0)))
    slope = solved(*effects, tangent=slope_along(name, i, along))[1]

    def at(h):
        moved = eqx.tree_at(lambda e: getattr(e, name), effects[i], getattr(effects[i], name) + h * jnp.asarray(along))
        return np.asarray(solved(*effects[:i], moved, *effects[i + 1 :])[0].points)

    h = 2e-6
    np.testing.assert_allclose(slope, (at(h) - at(-h)) / (2 * h), atol=3e-5 * np.abs(slope).max())


@pytest.mark.parametrize("held", [roller_and_pin, grooves])
def test_derivatives_by_the_stiffness(held):
    effects = (*held(), *forces((0.5 * LENGTH, 2.0)))
    slope = solved(*effects, tangent=along_stiffness)[1]
    up, down = (np.asarray(solved(*effects, cable=guidewire(EI * (1 + h)))[0].points) for h in (1e-3, -1e-3))
    by_differences = (up - down) / (2e-3 * EI)
    # the torsional stiffness goes along and has no part in a plane
    np.testing.assert_allclose(slope, by_differences, atol=1e-5 * np.abs(slope).max())


@pytest.mark.slow
def test_gradient_and_hessian_of_supports():
    """Of a crooked cable that no support fits: derivatives of the energy, block by block."""
    held = fx.Support(0.0083, [0.001, 0.002, 0.0], UP), fx.KnifeEdge([0.031, 0.001, -0.001], [0.98, 0.0, 0.2])
    bare, rod = (discretise(CableModel(guidewire(), [0.0, 0.0, 0.0], effects), FREE, 4) for effects in ((), held))
    crooked = 0.02 * jax.random.normal(jax.random.key(1), (5, 6)) * jnp.array([LENGTH, LENGTH, LENGTH, 1, 1, 1])
    at = retract(default_start(rod, jnp.array([0.0, 0.0, -1.0])), crooked)

    def energy(x):
        return jnp.sum(jax.vmap(element_potential(rod))(elements(rod, retract(at, x.reshape(-1, 6)))))

    def blocks(rod):
        d = derivatives(rod, at)
        return node_forces(rod, at).ravel(), d.gradient.ravel(), dense(d.diagonal, d.upper)

    @jax.jit
    def run(x):
        return jax.grad(energy)(x), jax.hessian(energy)(x), jax.tree.map(jnp.subtract, blocks(rod), blocks(bare))

    gradient, hessian, (forces_of, gradient_of, hessian_of) = run(jnp.zeros(30))
    np.testing.assert_allclose(forces_of, gradient, atol=1e-8 * np.abs(gradient).max())
    np.testing.assert_allclose(gradient_of, gradient, atol=1e-8 * np.abs(gradient).max())
    np.testing.assert_allclose(hessian_of, hessian, atol=1e-8 * np.abs(hessian).max())
