"""A limp cable between ball joints is a catenary: bends far shorter than an element show at no point of it."""

import numpy as np
import pytest
from reference.cantilever import chain

from scan2flex_jax import Boundary, Cable, CableModel, Study, equilibrium, fit
from scan2flex_jax.statics.balance import DEFAULT_ELEMENTS
from scan2flex_jax.statics.mesh import Mesh, shortest_bend

LENGTH, SPAN, RISE, NOISE = 20.0, 18.0, 1.0, 5e-3  # m
JOINTS = (([0.0, 0.0, 0.0], None), ([SPAN, 0.0, RISE], None))


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
