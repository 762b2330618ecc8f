"""Stiffness that varies along the cable, against the differential equations of a plane elastica solved by scipy."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import scan2flex_jax.effects as fx
from scan2flex_jax.effects.spans import element_means
from scan2flex_jax.rod.boundary import Boundary
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.model import CableModel, discretise
from scan2flex_jax.statics.solve import equilibrium
from tests.reference import cantilever

EI, DENSITY, LENGTH, G = 0.05, 0.05, 1.0, 9.81
PLACES = np.linspace(0.0, LENGTH, 9)
VALUES = np.array([2.0, 1.7, 1.0, 0.6, 0.1, -0.8, -1.0, -1.6, -2.2])
LEVEL = Boundary.of(([0.0, 0.0, 0.0], [np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0]), None)  # its tangent is x
SPLINE = CubicSpline(PLACES, VALUES, bc_type="natural")
TAPER, TAPERED = fx.StiffnessTaper(-2.9), lambda s: -2.9 * (2.0 * s / LENGTH - 1.0)
FIELD, VARIED = fx.StiffnessField(s=PLACES, log_factor=VALUES, density_power=0.5), lambda s: SPLINE(s) - SPLINE(0.5 * LENGTH)
HALF = fx.StiffnessTaper(-1.0)


def tip_of_elastica(log_factor, power=0.0):
    """Tip (m) of a cantilever under its own weight."""
    at = np.linspace(0.0, LENGTH, 20001)
    mean = np.trapezoid(np.exp(power * log_factor(at)), at) / LENGTH
    weight = DENSITY * G / mean
    return cantilever.tip(LENGTH, lambda s: EI * np.exp(log_factor(s)), lambda s: weight * np.exp(power * log_factor(s)))


def tip(effects, elements):
    cable = Cable(LENGTH, DENSITY, EI, 0.7 * EI)
    return np.asarray(equilibrium(CableModel(cable, [0.0, 0.0, -G], effects), LEVEL, elements=elements).points[-1])[[0, 2]]


@pytest.mark.parametrize(
    ("effects", "log_factor", "power"),
    [
        ((TAPER,), TAPERED, 0.0),
        ((FIELD,), VARIED, 0.5),
        ((HALF, fx.StiffnessField(s=PLACES, log_factor=VALUES)), lambda s: VARIED(s) - (2.0 * s / LENGTH - 1.0), 0.0),
    ],
    ids=["taper", "field and its mass", "both"],
)
def test_shapes_are_of_fourth_order_in_the_mesh(effects, log_factor, power):
    """Halved elements leave a tenth of the error or less, over a range of stiffness of 70 to 330."""
    exact = tip_of_elastica(log_factor, power)
    coarse, fine = (np.linalg.norm(tip(effects, n) - exact) for n in (8, 16))
    assert coarse < 1e-3
    assert fine < coarse / 10.0


def test_the_cable_has_the_stiffness_of_the_middle_and_its_whole_mass():
    """Whatever constant is added to a field; mass goes with the stiffness to its power."""
    rods = [
        discretise(CableModel(Cable(LENGTH, DENSITY, EI, EI), [0.0, 0.0, -G], f), LEVEL, 41)
        for f in (FIELD, fx.StiffnessField(s=PLACES, log_factor=VALUES + 5.0, density_power=0.5))
    ]
    for rod in rods:
        stiffness, density = rod.section.within[:, 0, 0], rod.section.density
        np.testing.assert_allclose(stiffness[20], EI, rtol=2e-3)
        np.testing.assert_allclose(jnp.mean(density), DENSITY, rtol=1e-12)
        np.testing.assert_allclose(density / density[20], jnp.sqrt(stiffness / stiffness[20]), rtol=3e-3)
    means = element_means(rods[0].section, lambda s: jnp.asarray(np.exp(VARIED(np.asarray(s)))))
    np.testing.assert_allclose(rods[0].section.within[:, 0, 0], EI * means, rtol=1e-6)
    np.testing.assert_allclose(rods[0].section.within, rods[1].section.within, rtol=1e-9)
