"""The number of elements: no longer than the bends of the cable, as its closed forms give them."""

import jax.numpy as jnp
import numpy as np
import pytest
from reference.cantilever import chain

from scan2flex_jax import Study, equilibrium, fit
from scan2flex_jax.effects.anisotropic_bending import AnisotropicBending
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.model import CableModel
from scan2flex_jax.statics.balance import DEFAULT_ELEMENTS
from scan2flex_jax.statics.mesh import MOST_ELEMENTS, Mesh, shortest_bend
from scan2flex_jax.statics.verdict import TOO_COARSE

from . import cases

WEIGHT = 0.2 * 9.81  # N/m
# of limp cables between ball joints
LENGTH, SPAN, RISE, NOISE = 20.0, 18.0, 1.0, 5e-3  # m
JOINTS = (([0.0, 0.0, 0.0], None), ([SPAN, 0.0, RISE], None))


def cable(EI, GJ=0.1, **more):
    return cases.model(Cable(1.0, 0.2, EI, GJ, **more))


def bend_of(model):
    return float(shortest_bend(model, cases.reference_case("P1")[1]))


def test_bends_under_the_weight():
    """sqrt(EI / (w L)), of the softer axis, wherever the axes of the section lie."""
    assert bend_of(cable(0.01)) == pytest.approx(np.sqrt(0.01 / WEIGHT))
    assert bend_of(cable([0.5, 0.01])) == pytest.approx(np.sqrt(0.01 / WEIGHT))
    turned = cable(0.01)
    turned = CableModel(turned.cable, turned.gravity, AnisotropicBending(jnp.array(50.0), jnp.array(0.7)))
    assert bend_of(turned) == pytest.approx(np.sqrt(0.01 / WEIGHT))


def test_bends_under_a_force_and_without_any():
    held = cases.model(Cable(1.0, 0.2, 0.01, 0.1), cases.WEIGHTLESS, (3.0, 0.0, 4.0))
    assert bend_of(held) == pytest.approx(np.sqrt(0.01 / 5.0))
    assert bend_of(cases.model(Cable(1.0, 0.2, 0.01, 0.1), cases.WEIGHTLESS)) > 1e3


def test_natural_curvature_bends_a_cable():
    assert bend_of(cable(1.0, natural_curvature=[30.0, 0.0, 40.0])) == pytest.approx(1 / 50.0)


@pytest.mark.parametrize(("bend", "enough"), [(1.0, 40), (0.025, 40), (0.0249, 80), (0.003, 640), (1e-6, MOST_ELEMENTS)])
def test_elements_are_doubled_until_none_is_longer_than_the_bends(bend, enough):
    assert Mesh(DEFAULT_ELEMENTS, 1.0, bend).enough == enough


def test_what_is_said_of_a_mesh():
    """Nothing of the usual one, nor of one that a user has chosen without need."""
    assert Mesh(40, 1.0, 0.03).sentences() == ()
    assert Mesh(160, 1.0, 0.03).sentences() == ()
    (finer,) = Mesh(80, 1.0, 0.015).sentences()
    assert finer == "80 elements in place of 40: bends of 15 mm are shorter than elements of 25 mm"
    (needed,) = Mesh(40, 1.0, 0.01).sentences()
    assert needed == "40 elements of 25 mm are longer than bends of 10 mm (160 are needed): shapes and values may be off"
    (most,) = Mesh(MOST_ELEMENTS, 1.0, 5e-4).sentences()
    assert "longer than bends of 0.5 mm (the most that are used)" in most


def test_elements_longer_than_the_bends_of_a_soft_cable_are_said():
    """EI/(w L^3) of 5e-7, between clamps; `tests/fitting/test_mesh.py` solves such a cable with enough elements."""
    _, boundary = cases.reference_case("P2")
    assert int(cases.solved(cable(1e-6, 1e-6), boundary).verdict.code) == TOO_COARSE


def test_bends_count_at_clamps_and_loads_only():
    """Between ball joints under its weight a cable is a catenary, whose ends no point shows."""
    joints = Boundary.of(([0.0, 0.0, 0.0], None), ([0.6, 0.0, 0.0], None))
    assert float(shortest_bend(cable(1e-4), joints)) == pytest.approx(1.0)
    loaded = cases.model(Cable(1.0, 0.2, 1e-4, 0.1), [0.0, 0.0, -9.81], (0.0, 0.0, -3.0))
    assert float(shortest_bend(loaded, joints)) < 0.01


@pytest.mark.parametrize("EI", [0.03, 0.001])
def test_a_limp_cable_hangs_as_a_catenary(EI):
    """Bends are 17 and 3 mm long and elements 0.5 m; the stiffness moves a point by EI/T times the curvature, 0.02 mm."""
    model = CableModel(Cable(LENGTH, 0.5, EI, EI), [0.0, 0.0, -9.81])
    joints = Boundary.of(*JOINTS)
    assert Mesh(DEFAULT_ELEMENTS, LENGTH, float(shortest_bend(model, joints))).enough == DEFAULT_ELEMENTS
    e = equilibrium(model, joints)
    assert e.verdict.solved, e.verdict.sentence()
    np.testing.assert_allclose(e.points, chain(LENGTH, SPAN, np.asarray(e.s), RISE), atol=2e-6 * LENGTH)


@pytest.mark.parametrize("EI", [0.03, 0.001])
def test_the_length_of_a_limp_cable_is_found_and_its_stiffness_is_not(EI):
    points = chain(LENGTH, SPAN, np.linspace(0.5, LENGTH - 0.5, 60), RISE)
    points = points + NOISE * np.random.default_rng(0).standard_normal(points.shape)
    pose = {"points": points, "start": JOINTS[0], "end": JOINTS[1], "noise": NOISE}
    f = fit(Study.from_arrays({"length_density": 0.5, "torsional_stiffness": EI}, [pose], ["length", "bending_stiffness"]))
    length = f.estimates["length"]
    assert f.problem.elements == DEFAULT_ELEMENTS
    assert length.value == pytest.approx(LENGTH, abs=4 * length.std) and length.std < 2e-3
    assert not f.estimates["bending_stiffness"].identifiable
