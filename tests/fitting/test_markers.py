"""Fits to points at known arc lengths, on shapes of other solvers (`test_poses_of_their_own`)."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax import Markers, MeasuredCurve, Scan2FlexError, Unknown, fit, residual_function
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.posterior.program import Program
from scan2flex_jax.posterior.quantities import left_out
from scan2flex_jax.posterior.rows import BINS, Rows
from scan2flex_jax.sweep import noisy

from .test_poses_of_their_own import DENSITY, EI, GJ, MASS, STATIONS, WEIGHT, G, cantilever, study, twisted

NAMES = ("bending_stiffness", "torsional_stiffness")
NOISE = 1e-3


def at(points, *s):
    """Markers at some of the stations."""
    which = [int(np.argmin(np.abs(STATIONS - x))) for x in s]
    return Markers(points[which], STATIONS[which])


def marked(*s, keep=(), names=NAMES, **cable):
    """The poses with markers at ``s`` in place of their curves; those in ``keep`` have both."""
    cable = {} if "length_density" in names else {"length_density": DENSITY, **cable}
    whole = study(names, (WEIGHT,), **cable)
    shapes = {"twisted": twisted(), "free": cantilever(0.0), "hung": cantilever(MASS * G)}
    poses = [replace(p, markers=at(shapes[p.name], *s), curve=p.curve if p.name in keep else None) for p in whole.poses]
    return replace(whole, poses=tuple(poses))


def stated(whole, noise=NOISE):
    return replace(whole, poses=tuple(replace(p, noise=noise) for p in whole.poses))


@pytest.mark.parametrize("s", [(0.35, 0.7), (0.6,)])
def test_stiffnesses_from_markers_alone(s):
    found = fit(stated(marked(*s)))
    assert found.converged and found.believable
    np.testing.assert_allclose([found.estimates[n].value for n in NAMES], [EI, GJ], rtol=0.01)
    assert found.rms() < 2e-5
    assert [len(p.s) for p in found.poses.values()] == 3 * [len(s)]


def test_density_and_stiffnesses_from_markers_and_a_known_weight():
    found = fit(stated(marked(0.3, 0.6, 0.95, names=("length_density", *NAMES))))
    np.testing.assert_allclose([found.estimates[n].value for n in ("length_density", *NAMES)], [DENSITY, EI, GJ], rtol=0.02)


def test_what_is_along_the_cable_counts():
    """Markers that are slid along the cable tell its length between them and the clamp; closest points tell nothing."""
    slid = marked(0.35, 0.7)
    along = [replace(p, markers=Markers(p.markers.points, p.markers.arc_length + 0.02)) for p in slid.poses]
    problem = Problem(stated(replace(slid, poses=tuple(along))))
    residual = problem.evaluator(np.log([EI, GJ])).residual
    assert np.abs(residual[..., 2]).max() > 5e-3


def test_markers_beside_a_curve():
    both = stated(marked(0.3, 0.9, keep=("twisted", "hung")))
    found = fit(both)
    np.testing.assert_allclose([found.estimates[n].value for n in NAMES], [EI, GJ], rtol=0.01)
    assert {name: len(p.s) for name, p in found.poses.items()} == {"twisted": 62, "free": 2, "hung": 62}
    pose = found.poses["twisted"]
    np.testing.assert_allclose(pose.s[-2:], [0.3, 0.9], atol=0.01)
    assert np.all(pose.residual[:-2, 2] == 0.0)


def test_residual_functions_know_them():
    function, start = residual_function(stated(marked(0.35, 0.7)), noise=NOISE)
    assert len(function(start)) == 3 * 2 * 3
    np.testing.assert_allclose(function(jnp.log(jnp.array([EI, GJ]))), 0.0, atol=0.02)


@pytest.mark.parametrize("distance", ["integrated", "hausdorff"])
def test_a_distance_of_whole_curves_is_refused(distance):
    with pytest.raises(Scan2FlexError, match="markers, and the distance"):
        fit(marked(0.5), "bfgs", distance=distance)


def test_they_are_given_noise_in_a_sweep():
    whole = noisy(marked(0.3, 0.6, keep=("free",)), NOISE, 0)
    plain = marked(0.3, 0.6, keep=("free",))
    moved = np.concatenate([a.markers.points - b.markers.points for a, b in zip(whole.poses, plain.poses, strict=True)])
    assert 0.5 * NOISE < moved.std() < 2 * NOISE
    assert isinstance(whole.poses[1].curve, MeasuredCurve) and whole.poses[0].noise == NOISE


def test_markers_weigh_in_the_search_with_all_three_components():
    found = fit(stated(marked(0.3, 0.6, keep=("twisted",))))
    program = Program(found.problem, found.minimum)
    shapes = program.shapes((), np.r_[found.minimum.shared, found.minimum.local.ravel()])
    rows = Rows(shapes, program)
    assert rows.count_of == [2 * BINS, 2 * 2 + 2, 2 * 2 + 2]
    assert rows.tangent.sum(axis=1).tolist() == [0.0, 2.0, 2.0]
    residual = rows.of(shapes, [s.residual[:, :, None] for s in shapes])[..., 0]
    for i in (1, 2):
        np.testing.assert_allclose(np.sum(residual[i] ** 2), np.sum(shapes[i].residual[program.real[i]] ** 2), rtol=1e-9)


@pytest.mark.slow
def test_a_search_on_one_marker_a_pose_has_what_it_needs():
    found = fit(stated(marked(0.6))).posterior
    assert np.all(np.isfinite(found.elpd)) and np.isfinite(found.score)
    assert np.all(left_out(found) < 1e-2)


def test_a_pose_without_markers_stands_in_a_study_with_them():
    whole = marked(0.3, 0.6)
    bare = study(NAMES, (WEIGHT,), length_density=DENSITY).poses[0]
    mixed = replace(whole, poses=(bare, *whole.poses[1:]), unknowns=tuple(map(Unknown, NAMES)))
    poses = Problem(mixed).poses
    assert poses.marked.sum(axis=1).tolist()[0] == 0.0 and poses.marked[1, 0] == 1.0
    assert np.sum(poses.mask * poses.marked, axis=1).tolist() == [0.0, 2.0, 2.0]
