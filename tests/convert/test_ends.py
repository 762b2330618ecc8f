"""Ends of curves as clamps: honest errors of places and directions, and free ends by their shape, on independent solutions."""

import numpy as np
import pytest

from scan2flex_jax.convert import measured_files, new_study
from scan2flex_jax.convert.ends import curve_end, hanging
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study import Tolerance
from tests.reference import cantilever, clamped_cases, cosserat_bvp

DOWN = np.array([0.0, 0.0, -9.81])
FREE = {"droop": (0.4, 0.02, 1.5, 0.0), "raised": (0.5, 0.02, 1.2, 0.5), "stiff": (1.0, 0.5, 2.0, 0.0)}
EI = {"droop": 0.02, "raised": 0.02, "stiff": 0.5, "sag": 0.1, "taut": 0.5, "P3": 0.1}
LEVEL = np.array([[0.0, 0, 1], [0, -1, 0], [1, 0, 0]]).T  # a clamp along x, as are both of "sag" and "taut"


@pytest.fixture(scope="module")
def shapes():
    """Places (n, 3) of a cable by the number of points, and its length (m) and weight (N/m), by name."""
    held = {name: clamped_cases.CASES["P1"]._replace(compliance=np.zeros(3)) for name in ("sag", "taut")}
    held["taut"] = held["taut"]._replace(end=np.array([0.9, 0, 0]), K=np.array([0.5, 0.5, 0.5]))
    solved = {n: cosserat_bvp.solve([rod], cosserat_bvp.sag_curve(rod)) for n, rod in held.items()}
    solved["P3"] = clamped_cases.solve_case("P3")

    def free(case):
        return lambda n: cantilever.positions(*case, np.linspace(0, case[0], n)), case[0], case[2]

    def clamped(answer):
        return lambda n: answer.positions(np.linspace(0, 1, n)), 1.0, clamped_cases.POSE_WEIGHT

    return {n: free(case) for n, case in FREE.items()} | {n: clamped(answer) for n, answer in solved.items()}


def noisy(points, noise, rng, flat=False):
    """Points with white noise, in their plane alone if they are ``flat``."""
    return points + noise * rng.normal(size=points.shape) * ([1, 0, 1] if flat else [1, 1, 1])


@pytest.mark.parametrize("noise", [1e-4, 5e-4])
@pytest.mark.parametrize("count", [30, 60, 200])
def test_the_errors_of_an_end_are_those_that_it_has(shapes, noise, count):
    """Errors over their standard deviations, over clamps of known directions: one, root mean square, in each coordinate."""
    rng, turned, moved = np.random.default_rng(1), [], []
    for name in ("droop", "raised", "sag", "taut"):
        true, angle = shapes[name][0](count), FREE[name][3] if name in FREE else 0.0
        for trial in range(30):
            flat = trial % 2 == 0
            end, axes = curve_end(noisy(true, noise, rng, flat)), 1 if flat else 2
            off = np.linalg.norm(np.cross(end.direction, [np.cos(angle), 0, np.sin(angle)]))
            turned.append(off / end.direction_sd / np.sqrt(axes))
            moved.append(np.linalg.norm(end.position - true[0]) / end.position_sd / np.sqrt(axes + 1))
    assert 0.5 < np.sqrt(np.mean(np.square(turned))) < 1.4
    assert 0.5 < np.sqrt(np.mean(np.square(moved))) < 1.4


def test_stated_noise_counts_where_it_is_larger_than_the_scatter(shapes):
    smooth = shapes["sag"][0](60)
    assert 4 * curve_end(smooth).direction_sd < curve_end(smooth, noise=1e-3).direction_sd


def test_a_free_end_is_known_by_its_shape(shapes):
    rng, said = np.random.default_rng(2), {}
    for name, (places, _, _) in shapes.items():
        for count, noise in ((30, 1e-4), (30, 5e-4), (150, 1e-4), (150, 5e-4)):
            for flat in (True, False) if name != "P3" else (False,):
                points = noisy(places(count), noise, rng, flat)
                said.setdefault(name, []).append(hanging(points, DOWN))
                assert hanging(points[::-1], DOWN) == "held"  # the other end is a clamp in all of them
    assert all(set(answers) == {"held"} for name, answers in said.items() if name not in FREE)
    free = [answer for name in FREE for answer in said[name]]
    assert "held" not in free and free.count("free") > 0.9 * len(free)
    assert hanging(shapes["droop"][0](60), 0 * DOWN) == "held"  # without weight no shape tells


def study_of(tmp_path, points, **options):
    np.savetxt(tmp_path / "pose.csv", points, delimiter=",", header="x,y,z", comments="")
    return new_study(tmp_path, measured_files(tmp_path), clamps=None, length_density=0.15, **options)


def test_a_curve_from_its_free_end_is_turned_round(shapes, tmp_path):
    points = noisy(shapes["droop"][0](60), 3e-4, np.random.default_rng(3))
    study, notes = study_of(tmp_path, points[::-1], length=0.4, tolerance=Tolerance(length=1e-3), noise=3e-4)
    [pose] = study.poses
    assert pose.end is None and pose.noise == 3e-4
    np.testing.assert_allclose(pose.start.position, [0, 0, 0], atol=2e-3)
    np.testing.assert_allclose(pose.curve.points, points)
    assert study.tolerance.length == 1e-3 and 0.01 < study.tolerance.clamp_rotation < 0.2
    assert any("turned round: its first point hangs free" in note for note in notes)
    assert any("hangs free" in note and "--ends held" in note for note in notes)


def test_whether_ends_hang_free_may_be_said(shapes, tmp_path):
    held, _ = study_of(tmp_path, shapes["droop"][0](60), length=0.4, free=False)
    free, _ = study_of(tmp_path, shapes["sag"][0](60), length=1.0, free=True)
    assert held.poses[0].end is not None and free.poses[0].end is None


def test_an_end_of_a_few_points_is_not_known(tmp_path):
    line = np.column_stack([np.linspace(0, 1, 3), np.zeros(3), -0.1 * np.linspace(0, 1, 3) ** 2])
    study, _ = study_of(tmp_path, line, length=1.01)
    assert study.tolerance.clamp_rotation > 0.05 and study.poses[0].end is not None
    with pytest.raises(Scan2FlexError, match="turns back"):
        study_of(tmp_path, np.r_[line, line[::-1]], length=1.01)
