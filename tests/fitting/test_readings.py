"""Readings that are no points of the centre curve: closed forms, an independent solver, derivatives, and what is made of them.

Twisted: a straight weightless cable between clamps, its end turned by ``phi``: the section at ``s`` is turned by
``phi s / L``, a mark beside the axis with it, and the torque is ``GJ phi / L``. Bent: a level cantilever with a load at its
tip (`test_misread.elastica`).
"""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scan2flex_jax import (
    Angle,
    Clamp,
    EffectDeclaration,
    Markers,
    Study,
    StudyPose,
    Tolerance,
    Unknown,
    Wrench,
    expect,
    explain,
    fit,
    plan,
    predict,
    report,
    residual_function,
)
from scan2flex_jax.fitting.problem import Problem

from .test_misread import LEVEL, G, elastica

ELEMENTS = 20
CABLE = (0.55, 4.3, 0.58)  # length (m), EI (N m^2), mass per length (kg/m)
L, EI, DENSITY = CABLE
GJ, PHI, WEIGHT, SAG = 1.7, 0.6, 6.0, 1e-3  # N m^2, rad, N, m
X, Y, _ = np.eye(3)
NAMES = ("bending_stiffness", "torsional_stiffness")
NAN = np.nan
CLAMP = Clamp.of(([0, 0, 0], LEVEL))


def turned(phi):
    """The clamp at the end of the straight cable, rolled by ``phi`` about its tangent."""
    return Clamp.of(([L, 0, 0], Rotation.from_rotvec(phi * X) * Rotation.from_matrix(LEVEL)))


def twisted(s=0.217, offset=(0.02, -0.01)):
    """The straight cable with its end turned: a mark, the angle of d1, and the torque, all without error."""
    roll = Rotation.from_rotvec(PHI * s / L * X)
    mark = s * X + roll.apply(np.array(LEVEL) @ [*offset, 0.0])
    angle = Angle(s, PHI * s / L, 0.01, about=X, zero=np.array(LEVEL)[:, 0], of="d1")
    torque = Wrench("end", moment=[NAN, NAN, GJ * PHI / L], moment_noise=0.01, frame="clamp")
    return StudyPose(
        "twisted", "fit", CLAMP, turned(PHI), gravity=[0, 0, 0], noise=SAG,
        markers=Markers([mark], [s], offset=[offset]), angle=[angle], wrench=[torque],
    )  # fmt: skip


def bent(load, s=0.4, **given):
    """A cantilever with a load (N) at its tip: the slope at ``s`` and at the end, force and moment of the clamp."""
    found = elastica(CABLE, load)
    angles = [Angle(at, -found(at)[2], 0.01, about=Y, zero=X) for at in (s, L)]
    wrench = Wrench("start", [0, 0, load + DENSITY * G * L], 0.1, [NAN, EI * found(0)[3], NAN], 0.01)
    return StudyPose(f"{load:g} N", "fit", CLAMP, angle=angles, wrench=[wrench], **given)


def change(load, s=0.4):
    """The displacement of a marker, of the slope, and of the force at the clamp, against the cantilever without load."""
    a, b = (elastica(CABLE, f) for f in (0.0, load))
    moved = b(s)[:2] - a(s)[:2]
    pose = bent(load, s)
    angles = [replace(one, value=one.value + a(one.s)[2], zero=None) for one in pose.angle]
    wrench = Wrench("start", [0, 0, load], 0.1)
    marks = Markers([[moved[0], 0.0, moved[1]]], [s])
    return replace(pose, name=f"by {load:g} N", markers=marks, angle=angles, wrench=[wrench], change_from="free", noise=SAG)


@cache
def study(which=("twisted", "bent", "change"), unknowns=NAMES, density=DENSITY, **tolerance):
    """All kinds of readings in three poses; the unloaded cantilever is not measured."""
    poses = {"twisted": twisted(), "bent": bent(WEIGHT), "change": change(2 * WEIGHT), "free": StudyPose("free", "fit", CLAMP)}
    own = [poses["free"], *(poses[name] for name in which)]
    own = own if "change" in which else own[1:]
    known = {"length": L, "length_density": density, "bending_stiffness": EI, "torsional_stiffness": GJ}
    known = {name: value for name, value in known.items() if name not in unknowns}
    loads = [("point_load", {"position": L, "force": [0, 0, -f]}, (name,)) for f, name in (
        (WEIGHT, poses["bent"].name), (2 * WEIGHT, poses["change"].name)
    ) if name in {pose.name for pose in own}]  # fmt: skip
    return Study.from_arrays(
        known, own, [Unknown(name) for name in unknowns], effects=[EffectDeclaration(*load) for load in loads],
        tolerance=Tolerance(**tolerance),
    )  # fmt: skip


def test_closed_forms():
    """Residuals vanish at the true stiffness, to the accuracy of the mesh, in units of the noise of each reading."""
    problem = Problem(study(), ELEMENTS)
    found = problem.evaluator(np.log([EI, GJ]), derivative=False)
    assert found.solved
    rows = np.asarray(problem.poses.mask).sum(axis=1).astype(int)
    assert rows.tolist() == [3, 4, 4]
    assert np.max(np.abs(found.residual)) < 0.02 * SAG  # of the noise of every reading
    assert [problem.poses.coordinates(i)[:n].tolist() for i, n in enumerate(rows)] == [[3, 1, 1], [1, 1, 3, 1], [3, 1, 1, 3]]


def in_scan_frame(found, values):
    """Rows, the first of the first pose as a vector of the scan frame: normals of a mark are constant for its derivative."""
    values = values.copy()
    values[0, 0] = found.axes[0, 0].T @ values[0, 0]
    return values


def test_derivatives_are_those_of_differences():
    """Of every row, by the unknowns and by the nuisance parameters of length, gravity and clamps."""
    whole = study(length=1e-3, clamp_position=1e-3, clamp_rotation=0.02, gravity=0.02)
    slack = replace(twisted(), gravity=None, end=Clamp(0.9 * L * X, turned(PHI).quaternion))
    whole = replace(whole, poses=tuple(slack if pose.name == slack.name else pose for pose in whole.poses))
    problem = Problem(whole, ELEMENTS)
    layout, rng = problem.layout, np.random.default_rng(0)
    at = np.r_[np.log([1.2 * EI, 0.8 * GJ]), 0.3 * rng.standard_normal(layout.shared - 2)]
    local = 0.3 * rng.standard_normal((3, layout.local))
    found = problem.evaluator(at, local)
    J = in_scan_frame(found, found.jacobian)
    step, scale = 5e-3, np.max(np.abs(J))
    for k in range(layout.shared + layout.local):
        slope = 0.0
        for steps, weight in ((1, 8), (-1, -8), (2, -1), (-2, 1)):  # of fourth order: a small step would differ by the solver's
            x, z = at.copy(), local.copy()
            if k < layout.shared:
                x[k] += steps * step
            else:
                z[:, k - layout.shared] += steps * step
            moved = problem.evaluator(x, z, derivative=False)
            slope = slope + weight * in_scan_frame(moved, moved.residual) / (12 * step)
        np.testing.assert_allclose(J[..., k], slope, atol=1e-5 * scale)


@pytest.mark.slow
def test_traced_residuals_are_those_of_the_fit():
    own = study(("change",), ("bending_stiffness",))
    function, _ = residual_function(own, noise=2e-3, elements=ELEMENTS)
    x, problem = jnp.log(jnp.array([1.1 * EI])), Problem(own, ELEMENTS)
    found = problem.evaluator(np.asarray(x))
    keep = np.asarray(problem.poses.mask[0]) > 0
    weight = np.where(problem.poses.seen[0][keep], 0.5, 1.0)[:, None]  # the noise of points is given, that of readings stated
    np.testing.assert_allclose(function(x) * SAG, (weight * found.residual[0, keep]).ravel(), atol=1e-9)
    np.testing.assert_allclose(jax.jacfwd(function)(x)[:, 0] * SAG, (weight * found.jacobian[0, keep, :, 0]).ravel(), atol=1e-7)


@pytest.mark.parametrize("which", [("change",), ("twisted", "bent", "change")])
def test_stiffnesses_from_readings(which):
    names = NAMES if "twisted" in which else NAMES[:1]
    found = fit(study(which, names), elements=ELEMENTS)
    assert found.converged
    for name, true in zip(names, (EI, GJ), strict=False):
        e = found.estimates[name]
        assert e.value == pytest.approx(true, rel=2e-3)
        assert e.low < true < e.high


def test_a_clamp_weighs_the_cable():
    """Force and moment at the clamp in one pose give density and EI, without a weight."""
    own = study(("bent",), ("length_density", "bending_stiffness"))
    free = replace(own, poses=(replace(bent(0.0), name="alone"),), effects=())
    found = fit(free, elements=ELEMENTS)
    e = found.estimates
    assert e["length_density"].value == pytest.approx(DENSITY, rel=1e-3)
    assert e["bending_stiffness"].value == pytest.approx(EI, rel=1e-3)
    force, moment = 0.1 / (DENSITY * G * L), 0.01 / (0.5 * DENSITY * G * L**2)  # the noise of each over its value
    assert e["length_density"].std / DENSITY == pytest.approx(1 / np.hypot(1 / force, 1 / moment), rel=0.05)


def test_predictions_have_the_readings():
    found = predict(study(unknowns=()), elements=ELEMENTS)
    for name, p in found.items():
        assert len(p.readings) == {"free": 0, "twisted": 2, "6 N": 4}.get(name, 3)
        for one in p.readings:
            np.testing.assert_allclose(one.modelled, one.measured, atol=0.02 * one.noise)
    assert "angle of d3 at s = 0.4 m" in " ".join(found["6 N"].lines())


@pytest.mark.slow
def test_nothing_is_missing_where_all_readings_fit():
    e = explain(study(), elements=ELEMENTS)
    assert e.verdict == "no missing effect"
    poses = e.to_json()["poses"]
    assert [len(poses[name]["readings"]) for name in ("twisted", "6 N", "by 12 N")] == [2, 4, 3]
    assert "rms" not in poses["6 N"] and np.isfinite(poses["twisted"]["rms"])
    ranked = plan(e)
    assert any(c.parameters > 0 for c in ranked.candidates)
    assert "force at the start, axes of the scan" in report(e, elements=ELEMENTS)


@pytest.mark.slow
def test_what_a_wrench_will_tell():
    """Of a pose with angles and a wrench alone nothing else is measured in simulation."""
    guessed = replace(study(("bent",), ("bending_stiffness",)), unknowns=(Unknown("bending_stiffness", guess=EI),))
    found = expect(guessed, elements=ELEMENTS)
    std = found.estimates["bending_stiffness"].std
    slopes = [0.01 / abs(one.value) for one in guessed.pose("6 N").angle]  # of each angle, which is in proportion to 1 / EI
    assert std / EI == pytest.approx(1 / np.sqrt(sum(1 / s**2 for s in slopes)), rel=0.1)
