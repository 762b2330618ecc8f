"""Poses that differ in what acts in them: a known weight hung in some, and a rig that was turned in others.

Shapes come from other solvers: the clamped pose from `cosserat_bvp`, the cantilevers from the plane elastica of
`tests.reference.cantilever`.
"""

from dataclasses import replace
from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scan2flex_jax import Clamp, EffectDeclaration, MeasuredCurve, Study, StudyPose, Unknown, fit, predict, residual_function
from scan2flex_jax.effects.catalogue import entry_of
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.inference.mesh import mesh_error
from scan2flex_jax.posterior.program import Component, Program
from tests.reference import clamped_cases
from tests.reference.cantilever import positions

EI, GJ, DENSITY, G = 0.1, 0.25, 0.2, 9.81  # those of the reference poses
MASS, PLACE = 0.05, 1.0  # kg, m: at the very tip
CABLE = {"length": 1.0, "shear_stiffness": 1e5, "axial_stiffness": 1e5}
NAMES = ("length_density", "bending_stiffness", "torsional_stiffness")
WEIGHT = EffectDeclaration("point_mass", {"position": PLACE, "mass": MASS}, ("hung",))
STATIONS = np.linspace(0.02, 0.98, 60)
TURN = Rotation.from_rotvec([0.7, -1.1, 0.4])


def clamp(position, frame):
    return Clamp.of((position, frame))


def cantilever(load):
    """Points (60, 3) of a level cantilever along x, with a load (N) at its tip."""
    return positions(1.0, EI, DENSITY * G, 0.0, STATIONS, load)


@cache
def twisted():
    """Points of the clamped reference pose P2."""
    return clamped_cases.solve_case("P2").positions(STATIONS)


def study(unknown=NAMES, effects=(WEIGHT,), **cable):
    """A clamped pose, and a cantilever with and without the weight."""
    start = clamp(np.zeros(3), clamped_cases.START_FRAME)
    p2 = clamped_cases.CASES["P2"]
    poses = (
        StudyPose("twisted", "fit", start, clamp(p2.end, p2.end_frame), curve=MeasuredCurve(twisted())),
        StudyPose("free", "fit", start, curve=MeasuredCurve(cantilever(0.0))),
        StudyPose("hung", "fit", start, curve=MeasuredCurve(cantilever(MASS * G))),
    )
    return Study("weight", [0, 0, -G], {**CABLE, **cable}, poses, unknowns=tuple(map(Unknown, unknown)), effects=effects)


def turned(pose):
    """The same pose seen from a frame that was turned with the rig."""
    ends = {}
    for end in ("start", "end"):
        held = getattr(pose, end)
        if held is not None:
            w, x, y, z = held.quaternion
            ends[end] = Clamp.of((TURN.apply(np.array(held.position)), TURN * Rotation.from_quat([x, y, z, w])))
    gravity = TURN.apply([0, 0, -G])
    return replace(pose, curve=MeasuredCurve(TURN.apply(np.array(pose.curve.points))), gravity=gravity, **ends)


@cache
def fitted():
    return fit(study())


def test_a_known_weight_replaces_the_scale():
    found = fitted().estimates
    for name, truth in zip(NAMES, (DENSITY, EI, GJ), strict=True):
        assert found[name].identifiable
        assert found[name].value == pytest.approx(truth, rel=0.02)
    assert not [said for said in fitted().sentences if "ratio" in said]


def test_without_the_weight_only_ratios_are_determined():
    bare = study(effects=())
    found = fit(replace(bare, poses=bare.poses[:2]))
    assert not found.estimates["bending_stiffness"].identifiable
    assert [said for said in found.sentences if "only the ratio" in said]


def test_the_mass_may_be_unknown_where_the_density_is_known():
    effect = EffectDeclaration("point_mass", {"position": PLACE}, ("hung",))
    found = fit(study(("bending_stiffness", "torsional_stiffness", "point_mass.mass"), (effect,), length_density=DENSITY))
    assert found.estimates["point_mass.mass"].value == pytest.approx(MASS, rel=0.01)
    assert found.calibrated.effects[0].poses == ("hung",)


def test_a_mass_is_found_at_the_very_tip():
    effect = EffectDeclaration("point_mass", {}, ("hung",))
    guesses = (Unknown("point_mass.mass", guess=0.02), Unknown("point_mass.position", guess=0.7))
    stiff = {"length_density": DENSITY, "bending_stiffness": EI, "torsional_stiffness": GJ}
    found = fit(replace(study((), (effect,), **stiff), unknowns=guesses)).estimates
    assert found["point_mass.mass"].value == pytest.approx(MASS, rel=0.01)
    assert found["point_mass.position"].value == pytest.approx(PLACE, abs=0.01)


def test_loads_are_looked_for_up_to_a_free_tip():
    context, entry = Program(fitted().problem, fitted().minimum).context, entry_of("point_mass")
    assert max(site["position"] for site in entry.sites(context)) == PLACE == entry.moving["position"](context)[1]
    held = replace(context, free_end=False)
    assert max(site["position"] for site in entry.sites(held)) == 0.95


def test_a_turned_rig_changes_nothing():
    straight = fitted()
    poses = straight.study.poses
    found = fit(replace(straight.study, poses=(turned(poses[0]), poses[1], turned(poses[2]))))
    for name in NAMES:
        assert found.estimates[name].value == pytest.approx(straight.estimates[name].value, rel=1e-5)
    assert found.problem.poses.group == (0, 1, 2)


def test_each_pose_is_predicted_with_what_acts_in_it():
    shapes = predict(fitted().calibrated)
    for name, load in (("free", 0.0), ("hung", MASS * G)):
        np.testing.assert_allclose(shapes[name].points[-1], 2 * cantilever(load)[-1] - cantilever(load)[-2], atol=0.03)
        carried = -(DENSITY * G + load) * np.array([0, 0, 1.0])
        np.testing.assert_allclose(shapes[name].reaction_force[0], -carried, atol=0.01)


def test_the_residual_function_solves_each_pose_with_its_own_model():
    both = study()
    function, _ = residual_function(both, noise=1e-3)
    x = jnp.log(jnp.array([DENSITY, EI, GJ]))
    one, _ = residual_function(replace(both, poses=both.poses[-1:]), noise=1e-3)  # that with the weight
    alone = np.asarray(one(x))
    np.testing.assert_allclose(function(x)[-len(alone) :], alone, atol=1e-6)
    assert np.max(np.abs(function(x))) < 0.2  # of a noise of 1 mm


@pytest.mark.slow
def test_the_search_for_effects_sees_each_pose_with_its_own_model():
    problem, minimum = fitted().problem, fitted().minimum
    program = Program(problem, minimum)
    vector = np.r_[minimum.shared, minimum.local.ravel()]
    shapes = program.shapes((), vector)
    for shape, residual in zip(shapes, minimum.evaluation.residual, strict=True):
        np.testing.assert_allclose(shape.residual, residual, atol=1e-8)
    mass = Component("point_mass", {"position": np.array(0.5)})
    columns, _ = program.columns((), vector, program.start, [mass])
    step = 1e-4  # kg: far above what the solver leaves
    heavier = program.shapes((mass,), np.r_[vector, step, 0.5])
    for column, before, after in zip(columns, shapes, heavier, strict=True):
        slope = (after.residual - before.residual) / step
        np.testing.assert_allclose(column[..., 0], slope, atol=0.01 * np.abs(column).max())
    assert np.all(mesh_error(problem, minimum) < 1e-4)


def test_many_poses_are_evaluated_as_each_alone():
    """More than one call of the map takes, of two models, in a rig turned in one of them."""
    whole = study()
    made = Problem(replace(whole, poses=(*whole.poses[:1], turned(whole.poses[1]), *whole.poses[2:])))
    x = made.starts()[0]
    together = made.evaluator_of(made.poses.only([0, 1, 2] * 4))(x)
    for i in range(3):
        alone = made.evaluator_of(made.poses.only([i]))(x)
        for k in range(i, 12, 3):
            np.testing.assert_allclose(together.residual[k], alone.residual[0], atol=1e-12)
            np.testing.assert_allclose(together.jacobian[k], alone.jacobian[0], atol=1e-9)
