"""The direct fit of the rod to the points of a scan. True shapes are those of the continuous equations, by collocation."""

from dataclasses import replace

import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from scipy.integrate import solve_bvp

from benchmarks import virtual_experiments as virtual
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting import cloud
from scan2flex_jax.fitting.problem import Problem
from scan2flex_jax.inference import fit
from scan2flex_jax.inference.direct import Direct, measured_by
from scan2flex_jax.scan import scanner
from scan2flex_jax.study import Clamp, MeasuredCurve, Study, StudyPose, Tolerance, Unknown
from tests.reference import rotations

TRUE = virtual.PTFE.bending
PLAIN = Study("free", np.array([0.0, 0.0, -virtual.GRAVITY]), {}, (), unknowns=(Unknown("bending_stiffness"),))


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    return virtual.study_of(virtual.PTFE, tmp_path_factory.mktemp("ptfe"), 1)


@pytest.fixture(scope="module")
def direct(study):
    return fit(study)


@pytest.fixture(scope="module")
def with_curve(study):
    """The scan with its true centre curve, so that none is extracted."""
    curve, _ = virtual.true_shape(virtual.PTFE, 0.0)
    return replace(study, poses=(replace(study.poses[0], curve=MeasuredCurve(curve[5:-5:10])),))


def start_of(study):
    """The direct stage of a study, weighed at the truth."""
    whole, scans, _ = measured_by(study, "cloud", "least-squares", "normal", lambda message: None)
    stage = Direct(Problem(whole), scans)
    stage.evaluator.weights = cloud.weigh(stage.evaluator.look(np.log([TRUE])).raw, stage.evaluator)
    return stage


@pytest.fixture(scope="module")
def stage(with_curve):
    return start_of(with_curve)


def test_the_stiffness_of_the_virtual_cable_is_found(direct):
    """A scan from two sides, with a table, clamp blocks and outliers: 1 %, inside the interval, 0.1 mm from the truth."""
    e = direct.estimates["bending_stiffness"]
    assert abs(e.value / TRUE - 1.0) < 0.01
    assert e.low < TRUE < e.high
    assert e.std < 0.01 * TRUE
    errors = virtual.errors_along(virtual.PTFE, direct, "sag", 0.0)
    assert errors["max_truth_mm"] < 0.2
    assert direct.converged


def test_the_answer_says_that_it_comes_from_the_points(direct, study):
    assert direct.data == "cloud" and direct.to_json()["data"] == "cloud"
    assert "fit to point clouds" in direct.summary()
    assert any("points of the scans themselves" in s for s in direct.sentences)
    assert direct.study == study


def test_where_the_direct_fit_starts_does_not_matter(with_curve, direct):
    """From the curve that was extracted and from the true one: 0.02 of a standard deviation is what the fit settles to.

    Unless it is told otherwise, a fit takes the curves where there are any.
    """
    by_curve, by_points = fit(with_curve), fit(with_curve, data="cloud")
    assert (by_curve.data, by_points.data) == ("curve", "cloud") and "fit to centre curves" in by_curve.summary()
    value, other = (x.estimates["bending_stiffness"] for x in (by_points, direct))
    assert abs(value.value - other.value) < 0.02 * other.std


def test_a_point_of_weight_is_on_the_cable(stage):
    """Outliers of the scanner and points of clamp blocks and table have no say; most points that a scanner faces have."""
    weights, evaluator = stage.evaluator.weights, stage.evaluator
    seen = virtual.scanned(virtual.PTFE, 0.0, 100)
    known = {tuple(p): on for p, on in zip(np.float32(seen.points).tolist(), seen.on_cable, strict=True)}
    points = np.float32(np.asarray(evaluator.poses.points[0])).tolist()
    on = np.array([known.get(tuple(p), False) for p in points])
    w, inside = weights.weight[0], evaluator.look(np.log([TRUE])).raw.inside[0]
    assert np.mean(w[on & inside] > 0.3) > 0.5
    assert w[~on].sum() < 0.01 * w.sum()
    assert np.all(w[~inside] == 0.0)
    assert abs(weights.sigma[0] / virtual.PTFE.sensor.noise - 1.0) < 0.1  # along the ray, as the sensor has it


def test_a_wrong_model_makes_no_outliers(stage):
    """With half of the stiffness the cable lies far from the model, and its points keep their weights."""
    evaluator, right = stage.evaluator, stage.evaluator.weights
    wrong = evaluator.look(np.log([0.5 * TRUE])).raw
    other = cloud.weigh(wrong, evaluator)
    assert np.max(np.linalg.norm(wrong.off[:, cloud.MOST_POINTS :], axis=2)) > 8.0 * right.sigma[0]
    kept = np.sum((right.weight > 0.5) & (other.weight > 0.5)) / np.sum(right.weight > 0.5)
    assert kept > 0.95
    assert abs(other.sigma[0] / right.sigma[0] - 1.0) < 0.05


def test_slopes_are_those_of_finite_differences(stage):
    """Of the points beside the model, and of the weighted residuals from which the offset is eliminated."""
    evaluator, step = stage.evaluator, 1e-4
    at, ahead, behind = (evaluator(np.log([TRUE]) + way * step) for way in (0, 1, -1))
    use = evaluator.weights.weight[0] > 0
    expected = (ahead.raw.off - behind.raw.off)[0, use] / (2 * step)
    np.testing.assert_allclose(at.raw.slope[0, use, :, 0], expected, atol=2e-3 * np.abs(expected).max())
    rows = np.r_[np.flatnonzero(use), len(use)]
    expected = (ahead.residual - behind.residual)[0, rows, 0] / (2 * step)
    np.testing.assert_allclose(at.jacobian[0, rows, 0, 0], expected, atol=2e-3 * np.abs(expected).max())


def test_the_offset_that_is_eliminated_is_the_best_one(stage):
    evaluator, w = stage.evaluator, stage.evaluator.weights
    e = evaluator(np.log([TRUE]))
    n = np.einsum("mci,mi->mc", e.raw.normals[0], w.direction[0])
    distance = w.distance[0] + np.sum(n * e.raw.off[0], axis=1)
    spread = cloud.OFFSET * stage.radius / w.sigma[0]
    offsets = np.linspace(-2e-4, 2e-4, 4001)
    cost = [np.sum(w.weight[0] * (distance + w.swell[0] * x) ** 2) + (x / spread) ** 2 for x in offsets]
    np.testing.assert_allclose(np.sum(e.residual**2), min(cost), rtol=1e-6)


def test_points_beside_a_straight_rod():
    nodes = np.linspace(0.0, 1.0, 11)[:, None] * np.array([1.0, 0.0, 0.0])
    d3 = np.tile([1.0, 0.0, 0.0], (11, 1))
    points = np.array([[0.3, 0.0, 0.5], [0.7, -0.2, 0.0], [-0.1, 0.1, 0.0], [0.001, 0.1, 0.0]])
    expected = np.array([0.3, 0.7, 0.0, 0.0])
    arguments = [jnp.asarray(a) for a in (nodes, d3, 0.1, points, expected, 0.05)]
    off, (normals, s, inside) = cloud.offsets_from(*arguments, lambda x: x)
    np.testing.assert_allclose(np.einsum("mc,mci->mi", off, normals)[:2], [[0.0, 0.0, 0.5], [0.0, -0.2, 0.0]], atol=1e-12)
    np.testing.assert_allclose(s[:2], [0.3, 0.7], atol=1e-12)
    assert inside.tolist() == [True, True, False, False]  # beyond the end, and where a clamp's face may be


def test_a_radius_that_is_not_quite_right_shows_as_an_offset(with_curve):
    """3 % of 4 mm; the scanner's own range bias is in it as well."""
    wrong = start_of(replace(with_curve, cable={**with_curve.cable, "radius": 0.97 * virtual.PTFE.radius}))
    bias = virtual.PTFE.sensor.range_bias
    assert abs(wrong.evaluator.weights.offset[0] - 0.03 * virtual.PTFE.radius) < 1.5 * abs(bias)


@pytest.mark.slow
def test_a_radius_that_is_not_quite_right_moves_the_stiffness_little(study, direct):
    f = fit(replace(study, cable={**study.cable, "radius": 0.97 * virtual.PTFE.radius}))
    a, b = (x.estimates["bending_stiffness"] for x in (f, direct))
    assert abs(a.value - b.value) < 1.96 * b.std
    assert a.low < TRUE < a.high


def cantilever(x, count=401):
    """The heavy cantilever of a cable (count, 3) in m, clamped along +x: EI theta'' = -q (L - s) cos theta, by collocation."""
    q, s = virtual.GRAVITY * x.density, np.linspace(0.0, x.length, count)

    def slopes(s, y):
        return np.stack([y[1], -q * (x.length - s) * np.cos(y[0]) / x.bending, np.cos(y[0]), -np.sin(y[0])])

    def ends(a, b):
        return np.array([a[0], b[1], a[2], a[3]])

    y = solve_bvp(slopes, ends, s, np.zeros((4, count)), tol=1e-8, max_nodes=20_000).sol(s)
    return np.stack([y[2], 0.0 * s, y[3]], axis=1)


@pytest.mark.slow
def test_a_cable_with_a_free_end(tmp_path):
    """A heavy cantilever and a table under it, no guide points: found, fitted to its points, inside the interval."""
    x = replace(virtual.PTFE, length=0.5, eyes=virtual.PTFE.eyes[:1])
    curve = cantilever(x)
    clutter = [scanner.clamp_block(curve[0], -virtual.START[:, 2], x.radius), scanner.table(curve, x.radius)]
    seen = scanner.scan(curve, x.radius, np.array(x.eyes), x.sensor, 7, clutter=clutter)
    trimesh.PointCloud(seen.points).export(tmp_path / "hangs.ply")
    start = Clamp(np.zeros(3), rotations.quaternion(virtual.START))
    pose = StudyPose("hangs", "fit", start, None, scan=tmp_path / "hangs.ply", viewpoints=np.array(x.eyes))
    cable = {"length": x.length, "radius": x.radius, "length_density": x.density, "torsional_stiffness": x.torsion}
    cable |= {"shear_stiffness": virtual.RIGID, "axial_stiffness": virtual.RIGID}
    f = fit(replace(PLAIN, cable=cable, poses=(pose,), folder=tmp_path))
    e = f.estimates["bending_stiffness"]
    assert f.data == "cloud"
    assert e.low < TRUE < e.high
    assert e.std < 0.02 * TRUE
    assert np.linalg.norm(f.poses["hangs"].modelled[-1] - curve[-1]) < 1e-3


@pytest.mark.slow
def test_tolerances_of_the_clamps_are_priors_for_clouds_too(study, direct):
    f = fit(replace(study, tolerance=Tolerance(clamp_position=2e-4, clamp_rotation=0.01)), data="cloud")
    e = f.estimates["bending_stiffness"]
    assert e.low < TRUE < e.high
    assert e.std > direct.estimates["bending_stiffness"].std


def test_noise_as_large_as_the_cable_is_left_to_curves(study, tmp_path):
    """A time-of-flight camera and a cable of 4 mm: distances to the axis are biased, and the default fits the curve."""
    thin = replace(virtual.PTFE, sensor=scanner.TIME_OF_FLIGHT)
    f = fit(virtual.study_of(thin, tmp_path, 3))
    assert f.data == "curve"
    assert any("of the radius: centre curves were extracted" in s for s in f.sentences)


def with_a_curve_alone(pose):
    return replace(pose, scan=None, curve=MeasuredCurve(np.linspace(pose.start.position, pose.end.position, 5)))


REFUSED = {
    "unknown data": (lambda s: s, {"data": "mesh"}, "data 'mesh' is not known: use one of auto"),
    "no scan": (lambda s: replace(s, poses=(with_a_curve_alone(s.poses[0]),)), {"data": "cloud"}, "has no scan"),
    "no shape": (lambda s: replace(s, poses=(replace(s.poses[0], scan=None),)), {"data": "cloud"}, "has no shape"),
    "another method": (lambda s: s, {"data": "cloud", "method": "bfgs"}, "least-squares"),
    "no radius": (
        lambda s: replace(s, cable={k: v for k, v in s.cable.items() if k != "radius"}), {"data": "cloud"}, "radius"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_what_cannot_be_is_refused_in_one_sentence(study, name):
    change, options, word = REFUSED[name]
    with pytest.raises(Scan2FlexError, match=word) as refusal:
        fit(change(study), **options)
    assert "\n" not in str(refusal.value)
