"""The energy knows no place in space and no unit, its strain terms have their 1/2, and loads do the right work."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.geometry import lie
from scan2flex_jax.rod.boundary import Boundary, rotation_of_quaternion
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.energy import potential_energy, strains
from scan2flex_jax.rod.loads import DeadLoad, distributed_load, point_load
from scan2flex_jax.rod.model import CableModel, Configuration, discretise

from .scenes import random_rod

energy = eqx.filter_jit(potential_energy)
motion = jax.jit(lie.se3_exp)
TURN = jnp.array(Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix())
SHIFT = jnp.array([3.0, -1.0, 2.0])


def test_invariance_under_rigid_motion():
    """Rod, loads and supports moved together: the energy changes by the work of the total force on the shift alone."""
    rod, c = random_rod(0)
    moved = Configuration(c.r @ TURN.T + SHIFT, TURN @ c.R)
    load = DeadLoad(rod.load.force @ TURN.T, rod.load.lever @ TURN.T)
    turned = eqx.tree_at(lambda r: r.load, rod, load)
    work = jnp.sum(load.force, axis=0) @ SHIFT
    np.testing.assert_allclose(energy(moved, turned) + work, energy(c, rod), rtol=1e-12)
    np.testing.assert_allclose(strains(rod, moved), strains(rod, c), atol=1e-12)


def smaller(x):
    return 1e-6 * x


def test_scaling_of_stiffness_and_loads():
    rod, c = random_rod(1)
    parts = lambda r: (r.section.stiffness, r.section.within, r.load.force, r.load.lever)  # noqa: E731
    scaled = eqx.tree_at(parts, rod, replace_fn=lambda x: jax.tree.map(smaller, x))
    np.testing.assert_allclose(energy(c, scaled), 1e-6 * energy(c, rod), rtol=1e-12)


@pytest.mark.parametrize(("bend", "twist"), [(0.7, 0.0), (0.0, 0.3)])
def test_strain_energy_of_uniform_strains_has_its_half(bend, twist):
    """A rod bent to a circle or twisted, and stretched, holds (1/2 EI k^2 + 1/2 GJ t^2 + 1/2 EA e^2) L.

    Bent and twisted at once, with EI apart from GJ, it would not: between the same end frames it then relaxes inside its
    elements (`rod.element_law`).
    """
    n, L, e = 10, 2.0, 0.01
    model = CableModel(Cable(L, 0.0, 1.5, 0.8, 1e3, 2e3), jnp.zeros(3))
    rod = discretise(model, Boundary.of((jnp.zeros(3), jnp.eye(3))), n)
    steps = [motion(L * i / n * jnp.array([0.0, 0, 1 + e, bend, 0, twist])) for i in range(n + 1)]
    c = Configuration(jnp.stack([r for r, _ in steps]), jnp.stack([R for _, R in steps]))
    expected = 0.5 * L * (1.5 * bend**2 + 0.8 * twist**2 + 2e3 * e**2)
    np.testing.assert_allclose(energy(c, rod), expected, rtol=1e-12)


def test_loads_add_up_and_have_the_moment_of_their_place():
    """On a straight rod with unit tangents along z, virtual work of a turn about the origin gives the moment."""
    rod = random_rod()[0]
    s, force = rod.node_s, jnp.array([0.3, -0.2, 0.0])
    for load, total, place in (
        (point_load(rod.section, jnp.array(0.77), force), 1.0, 0.77),
        (point_load(rod.section, rod.length, force), 1.0, float(rod.length)),
        (distributed_load(rod.section, jnp.tile(force, (rod.elements, 1))), float(rod.length), 0.5 * float(rod.length)),
    ):
        np.testing.assert_allclose(load.force.sum(0), total * force, atol=1e-14)
        lever = (load.force * s[:, None] + load.lever).sum(0)  # r = s e3 tilts by a: dr = s a, d(d3) = a
        np.testing.assert_allclose(lever, total * place * force, atol=1e-14)


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_a_uniform_load_sees_cubic_shapes_exactly(degree):
    """The work of a distributed load on the displacement s^degree equals its integral."""
    rod = random_rod()[0]
    s, L = np.asarray(rod.node_s), float(rod.length)
    load = distributed_load(rod.section, jnp.tile(jnp.array([1.0, 0.0, 0.0]), (rod.elements, 1)))
    slope = degree * s ** max(degree - 1, 0)
    work = load.force[:, 0] @ s**degree + load.lever[:, 0] @ slope
    np.testing.assert_allclose(work, L ** (degree + 1) / (degree + 1), rtol=1e-13)


def test_quaternions_are_scalar_first():
    q = Rotation.from_rotvec([0.3, -0.5, 0.9]).as_quat(scalar_first=True)
    np.testing.assert_allclose(
        rotation_of_quaternion(jnp.array(2.0 * q)), Rotation.from_quat(q, scalar_first=True).as_matrix(), atol=1e-15
    )


def test_single_precision_is_refused_in_words():
    jax.config.update("jax_enable_x64", False)
    try:
        with pytest.raises(Scan2FlexError, match=r"float64 only.*jax_enable_x64"):
            Cable(1.0, 0.2, 0.1, 0.25)
    finally:
        jax.config.update("jax_enable_x64", True)


def test_a_cable_prints_its_values():
    cable = Cable(length=1.0, length_density=0.2, bending_stiffness=[0.1, 0.2], torsional_stiffness=0.25, natural_curvature=1.0)
    assert "length=1.0" in repr(cable) and "bending_stiffness=[0.1, 0.2]" in repr(cable)
    assert "natural_curvature=[1.0, 1.0, 1.0]" in repr(cable)
    seen = []
    jax.jit(lambda c: seen.append(repr(c)) or c.length)(cable)
    assert "f64[2]" in seen[0]
