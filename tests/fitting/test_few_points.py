"""Curves of as few points as `check` accepts, and one to three readings: fitted, and other shapes that fit them are said."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.inference import explain, fit
from scan2flex_jax.results.answer import FAIR
from scan2flex_jax.study import Clamp, EffectDeclaration, Markers, MeasuredCurve, Study, StudyPose, Unknown

from . import scenes
from .test_bending_tests import DENSITY, EI, G, L, heart
from .test_misread import FINE, LIMP, STIFF, cantilever

NOISE = 5e-4  # m
TRUE = (scenes.EI, scenes.GJ)
GAP = 2e-4  # m: of a heart loop, a strip that hangs with both ends in one clamp
UP, DOWN = [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]


def few(n, power, noise=0.0):
    """The paper's cable with n of the points of each curve, evenly along it or as a power of it."""
    rng, poses = np.random.default_rng(n), []
    for pose in scenes.example().poses:
        points = pose.curve.points
        at = np.linspace(0.0, 1.0, n) ** power * (len(points) - 1)
        keep = np.maximum(np.round(at).astype(int), np.arange(n))
        noisy = points[keep] + noise * rng.standard_normal((n, 3))
        poses.append(replace(pose, curve=MeasuredCurve(noisy), noise=noise or None))
    return replace(scenes.example(), poses=tuple(poses))


@pytest.mark.parametrize(("n", "power"), [(3, 1.0), (4, 2.0), (7, 1.0), (12, 2.0)])
def test_few_points_are_fitted(n, power):
    f = fit(few(n, power))
    assert f.converged
    np.testing.assert_allclose(f.estimates["bending_stiffness"].value, scenes.EI, rtol=1e-4)
    np.testing.assert_allclose(f.estimates["torsional_stiffness"].value, scenes.GJ, rtol=1e-3)


def test_two_points_inside_each_curve_are_fitted():
    study = scenes.example()
    inner = [replace(p, curve=MeasuredCurve(p.curve.points[[len(p.curve.points) // 3, -len(p.curve.points) // 3]]), noise=NOISE)
             for p in study.poses]  # fmt: skip
    f = fit(replace(study, poses=tuple(inner)))
    np.testing.assert_allclose([f.estimates[f"{n}_stiffness"].value for n in ("bending", "torsional")], TRUE, rtol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("n", "power"), [(4, 2.0), (7, 1.0)])
def test_few_points_are_explained(n, power):
    """White noise and nothing missing: no alarm at the one per cent level, no effect named, the truth within 4 sigma."""
    e = explain(few(n, power, NOISE))
    assert e.p_value > 0.01
    assert e.verdict in ("no missing effect", "tied")
    for name, truth in (("bending_stiffness", scenes.EI), ("torsional_stiffness", scenes.GJ)):
        estimate = e.fit.estimates[name]
        assert abs(estimate.value - truth) < 4 * estimate.std


def test_a_curve_that_covers_little_of_the_cable_gives_a_start():
    """All points within five per cent of the length, where a spline's ends overlap: a start all the same."""
    study = few(12, 1.0)
    near = [replace(p, curve=MeasuredCurve(scenes.example().pose(p.name).curve.points[20:25])) for p in study.poses]
    problem = scenes.Problem(replace(study, poses=tuple(near)), scenes.ELEMENTS)
    assert all(np.all(np.isfinite(x)) for x in problem.starts())


def test_a_heart_loop_by_its_height_alone():
    """The strip hangs in a plane; at other stiffnesses shapes out of it reach the same depth."""
    strip = EffectDeclaration("anisotropic_bending", {"ratio": 1000.0, "angle": np.pi / 2})
    pose = StudyPose(
        "loop", "fit", Clamp.of(([0, 0, 0], UP)), Clamp.of(([-GAP, 0, 0], DOWN)), noise=5e-4,
        markers=Markers([[np.nan, np.nan, float(heart(GAP)(0.5 * L)[1])]], [0.5 * L]),
    )  # fmt: skip
    known = {"length": L, "length_density": DENSITY, "torsional_stiffness": 1.6e-5}
    f = fit(Study("Heart", [0, 0, -G], known, (pose,), unknowns=[Unknown("bending_stiffness")], effects=[strip]))
    e = f.estimates["bending_stiffness"]
    assert f.answer.tone == FAIR and not e.identifiable and e.low is None
    said = f.answer.belief
    assert "1 reading fits" in said and "stable shapes: bending_stiffness = " in said and "measure the curve" in said
    values = [float(x) for x in said.split(" = ")[1].split(" N m^2")[0].split(" or ")]
    assert min(abs(v / EI - 1) for v in values) < 0.01 and max(values) > 1.15 * min(values)


@pytest.mark.parametrize(("cable", "load", "measured"), [(STIFF, 30.0, "z"), (LIMP, 0.0, "z"), (LIMP, 0.0, "xyz")])
def test_a_droop_test_has_one_shape(cable, load, measured):
    f = fit(cantilever(cable, (load,), [1.0], measured, FINE))
    e = f.estimates["bending_stiffness"]
    assert f.in_doubt == () and e.identifiable
    assert e.value == pytest.approx(cable[1], rel=0.02)
