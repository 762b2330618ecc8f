"""A curve of as few points as `check` accepts can be fitted, and explained."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.inference import explain, fit
from scan2flex_jax.study import MeasuredCurve

from . import scenes

NOISE = 5e-4  # m
TRUE = (scenes.EI, scenes.GJ)


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
