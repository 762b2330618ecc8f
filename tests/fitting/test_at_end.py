"""What is measured at the end stays at the end: a droop test whose marker and load are at s = L, against closed forms and
refits of a changed study."""

from dataclasses import replace

import numpy as np
import pytest
from reference import rotations

from scan2flex_jax import EffectDeclaration, Study, Tolerance, Unknown, fit
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.results.answer import rests_on
from scan2flex_jax.rod.boundary import rotation_of_quaternion
from scan2flex_jax.study import Clamp, Markers, load_study, save_study

L, EI, NOISE, W = 0.2, 0.005, 1e-5, 0.04  # m, N m^2, m, N/m
LOADS = {"one": 0.003, "two": 0.006}  # N, at the tip
ALONG_X = [0.5, 0.5, 0.5, 0.5]
ELEMENTS = 20


def sag(load):
    """Of the tip (m), for small displacements."""
    return load * L**3 / (3.0 * EI) + W * L**4 / (8.0 * EI)


def droop(tolerance=None, at=L):
    """The two poses, each with a marker at ``at`` that has the height of the tip, and a known weight at the tip."""

    def pose(name, load):
        return {
            "name": name, "start": ([0.0, 0.0, 0.0], ALONG_X), "noise": NOISE,
            "markers": Markers([[np.nan, np.nan, -sag(load)]], [at]),
        }  # fmt: skip

    loads = tuple(
        EffectDeclaration("point_mass", {"position": L, "mass": load / 9.81}, poses=[name]) for name, load in LOADS.items()
    )
    cable = {"length": L, "length_density": W / 9.81, "torsional_stiffness": 0.01}
    poses = [pose(name, load) for name, load in LOADS.items()]
    return Study.from_arrays(cable, poses, [Unknown("bending_stiffness", 0.01)], effects=loads, tolerance=tolerance)


def log_stiffness(study):
    e = fit(study, elements=ELEMENTS).estimates["bending_stiffness"]
    return np.log(e.value), e.std / e.value


@pytest.fixture(scope="module")
def exact():
    return fit(droop(), elements=ELEMENTS)


def longer(study, factor=1.01):
    return replace(study, cable={**study.cable, "length": factor * L})


def heavier(study):
    return replace(study, cable={**study.cable, "length_density": 1.01 * W / 9.81})


def turned(study, angle=1e-4):
    """With the clamp tipped up."""
    clamp = Clamp.of(([0.0, 0.0, 0.0], rotations.about([0.0, -1.0, 0.0], angle) @ rotation_of_quaternion(np.array(ALONG_X))))
    return replace(study, poses=tuple(replace(p, start=clamp) for p in study.poses))


def test_the_tip_gives_the_stiffness(exact):
    assert exact.estimates["bending_stiffness"].value == pytest.approx(EI, rel=0.01)


def test_a_longer_cable_moves_the_stiffness_as_a_refit(exact):
    """A sag goes with the third and fourth power of the length."""
    step = 1e-3
    moved, _ = log_stiffness(longer(exact.study, 1.0 + step))
    found = exact.influence.stated["length"][0]
    assert found == pytest.approx((moved - np.log(exact.estimates["bending_stiffness"].value)) / step, rel=0.03)
    assert 3.0 < found < 4.0
    assert "1 % of length" in rests_on(exact.study, exact.influence)


@pytest.mark.parametrize(
    ("tolerance", "changed"),
    [
        (Tolerance(length=0.002), longer),
        pytest.param(Tolerance(length_density=0.01 * W / 9.81), heavier, marks=pytest.mark.slow),
        pytest.param(Tolerance(clamp_rotation=1e-4), turned, marks=pytest.mark.slow),
    ],
    ids=["length", "mass", "clamps"],
)
def test_a_tolerance_widens_the_interval_by_what_a_refit_moves(exact, tolerance, changed):
    """The two poses share a length and a mass, and have clamps of their own."""
    before = exact.estimates["bending_stiffness"]
    moved, _ = log_stiffness(changed(exact.study))
    _, wide = log_stiffness(droop(tolerance))
    added = np.sqrt(max(wide**2 - (before.std / before.value) ** 2, 0.0))
    assert 0.6 * abs(moved - np.log(before.value)) < added < 1.1 * abs(moved - np.log(before.value))


def test_a_marker_before_the_end_stays_at_its_place():
    """And so does a load: 1 % of length of a cable without weight then moves nothing that is measured."""
    study = droop(at=0.15)
    study = replace(study, cable={**study.cable, "length_density": 1e-9})
    loads = tuple(replace(e, parameters={**e.parameters, "position": 0.15}) for e in study.effects)
    study = replace(study, effects=loads)
    other = longer(study)
    assert other.poses == study.poses and other.effects == study.effects
    x = np.array([np.log(EI)])
    residuals = [Problem(s, ELEMENTS).evaluator(x).residual for s in (study, other)]
    np.testing.assert_allclose(*residuals, atol=1e-7 * L)


def test_a_saved_study_of_another_length_has_its_end_there(exact, tmp_path):
    saved = load_study(save_study(longer(exact.study), tmp_path))
    assert [p.markers.arc_length[-1] for p in saved.poses] == pytest.approx([1.01 * L] * 2)
    assert [e.parameters["position"] for e in saved.effects] == pytest.approx([1.01 * L] * 2)
