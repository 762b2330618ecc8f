"""Points at known arc lengths: read, checked, described and written back; and curves of two or three points."""

from dataclasses import replace
from time import process_time

import numpy as np
import pytest

from scan2flex_jax.errors import StudyError
from scan2flex_jax.study import (
    Markers,
    MeasuredCurve,
    Study,
    check_study,
    describe,
    load_study,
    pose_facts,
    save_study,
    study_warnings,
)
from scan2flex_jax.study.mistakes import exchanged_markers
from scan2flex_jax.study.outputs import Outputs, measured_files

from .samples import STUDY, csv, curve, write_sample

MARKED = STUDY.replace('centre_curve = "again.csv"', 'markers = "dots.csv"')
S = np.array([0.3, 0.6])
POINTS = curve()[[13, 26]]
GOOD = csv(np.column_stack([S, POINTS]), "s,x,y,z")


def test_markers_are_read_and_written_back(tmp_path):
    study = load_study(write_sample(tmp_path / "a", MARKED, dots=GOOD))
    markers = study.poses[1].markers
    np.testing.assert_array_equal(markers.arc_length, S)
    np.testing.assert_array_equal(markers.points, POINTS)
    save_study(study, tmp_path / "b")
    assert load_study(tmp_path / "b") == study
    assert (tmp_path / "b" / "dots.csv").read_text() == GOOD
    moved = replace(study.poses[1], markers=replace(markers, points=POINTS + 1e-3))
    save_study(replace(study, poses=(study.poses[0], moved)), tmp_path / "b")
    assert (tmp_path / "b" / "dots.csv.bak").read_text() == GOOD


def test_markers_may_stand_in_any_order(tmp_path):
    head, *rows = GOOD.splitlines()
    turned = "\n".join([head, *rows[::-1], ""])
    study = load_study(write_sample(tmp_path, MARKED, dots=turned))
    np.testing.assert_array_equal(study.poses[1].markers.arc_length, S)
    np.testing.assert_array_equal(study.poses[1].markers.points, POINTS)
    save_study(study, tmp_path)
    assert (tmp_path / "dots.csv").read_text() == turned  # the user's file stays as it is


def test_a_study_in_memory_gets_a_file_for_its_markers(tmp_path):
    study = load_study(write_sample(tmp_path / "a", MARKED, dots=GOOD))
    made = replace(study.poses[1], markers=Markers(POINTS.tolist(), S.tolist()))
    save_study(replace(study, poses=(study.poses[0], made)), tmp_path / "b")
    assert (tmp_path / "b" / "again-markers.csv").read_text() == GOOD


def test_no_result_replaces_them(tmp_path):
    study = load_study(write_sample(tmp_path, MARKED, dots=GOOD))
    assert tmp_path / "dots.csv" in measured_files(study)
    with pytest.raises(StudyError, match="no result replaces"):
        Outputs(study, force=True).claim(tmp_path / "dots.csv")


def test_they_are_described(tmp_path):
    assert "markers     2, at s = 0.3, 0.6 m" in describe(load_study(write_sample(tmp_path, MARKED, dots=GOOD)))


FAULTS = {
    "no s": (csv(POINTS), "header", "write the header s,x,y,z"),
    "s repeats": (csv(np.column_stack([0 * S + 0.3, POINTS]), "s,x,y,z"), "s", "does not grow"),
    "s below zero": (csv(np.column_stack([-S[::-1], POINTS]), "s,x,y,z"), "s", "count s from 0"),
    "not finite": (csv(np.column_stack([S, POINTS * np.nan]), "s,x,y,z"), None, "give finite numbers"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_of_the_file_is_one_sentence(tmp_path, fault):
    text, key, words = FAULTS[fault]
    with pytest.raises(StudyError, match=words) as error:
        load_study(write_sample(tmp_path, MARKED, dots=text))
    assert error.value.key == key and error.value.file.endswith("dots.csv")


BEYOND = {
    "beyond the end": ([0.3, 0.95], POINTS, "markers.s", "at s = 0.95 m on a cable of at most 0.906 m"),
    "s in millimetres": (1e3 * S, POINTS, "markers.s", "millimetres"),
    "points in millimetres": (S, 1e3 * POINTS, "markers", "millimetres"),
    "too far along": ([0.1, 0.2], POINTS, "markers", "away from the start clamp"),
}


@pytest.mark.parametrize("fault", BEYOND)
def test_what_no_cable_reaches_is_refused(tmp_path, fault):
    s, points, key, words = BEYOND[fault]
    with pytest.raises(StudyError, match=words) as read:
        load_study(write_sample(tmp_path, MARKED, dots=csv(np.column_stack([s, points]), "s,x,y,z")))
    assert read.value.key == f"pose[again].{key}"
    study = load_study(write_sample(tmp_path, MARKED, dots=GOOD))
    with pytest.raises(StudyError, match=words) as made:
        check_study(replace(study, poses=(study.poses[0], replace(study.poses[1], markers=Markers(points, s)))))
    assert made.value.sentence == read.value.sentence


def test_a_marker_at_the_very_tip_is_on_the_cable(tmp_path):
    text = MARKED.replace("length = 0.002\n", "")  # the length is exact
    load_study(write_sample(tmp_path, text, dots=csv([[0.9, *curve()[-1]]], "s,x,y,z")))


@pytest.mark.parametrize("n", [2, 3])
def test_a_curve_of_two_or_three_points_is_read_and_not_doubted(n):
    points = curve(41)[[10, 30]] if n == 2 else curve(41)[[8, 20, 32]]
    held = {"start": (curve()[0], None), "end": (curve()[-1], [0.7071068, 0.0, 0.7071068, 0.0])}
    cable = {"length": 0.9, "length_density": 0.3, "torsional_stiffness": 0.1}
    study = Study.from_arrays(cable, [{"points": points, **held}], ["bending_stiffness"])
    check_study(study)
    facts = pose_facts(study.poses[0])
    assert facts.points == n and facts.end.angle is None
    for said in study_warnings(study):
        assert "straight" not in said and "plane" not in said and "tangent" not in said
    assert len(MeasuredCurve(points).points) == n


@pytest.mark.parametrize("points", [[[1], [1, 2]], [["a", "b", "c"]], [[1j, 2, 3]], [[np.inf, np.nan, 1.0]]], ids=str)
def test_points_in_memory_that_are_none_are_refused_in_one_sentence(points):
    with pytest.raises(StudyError, match=r"^Markers: points: .*: give "):
        Markers(points, [0.1, 0.2])


def test_a_shuffled_table_is_no_exchange_of_two_markers():
    # every exchange of two of these was tried, for minutes: two markers change four chords, and far more are too long
    s, order = np.linspace(0.01, 0.89, 300), np.random.default_rng(0).permutation(300)
    pose = {"start": (curve()[0], None), "markers": Markers(curve(300)[order], s)}
    cable = {"length": 0.9, "length_density": 0.3, "torsional_stiffness": 0.03}
    study = Study.from_arrays(cable, [pose], ["bending_stiffness"])
    began = process_time()
    assert any("along the cable: correct their s" in warning for warning in study_warnings(study))
    assert process_time() - began < 10.0


def test_a_row_that_stands_twice_is_a_doubt_and_no_fault_of_other_rows():
    # an exchange that was tried brought the two equal points together, which was refused as a fault of the table
    s, points = np.linspace(0.02, 0.88, 20), curve(20)
    points[12] = points[4]
    pose = {"start": (curve()[0], None), "markers": Markers(points, s)}
    cable = {"length": 0.9, "length_density": 0.3, "torsional_stiffness": 0.03}
    study = Study.from_arrays(cable, [pose], ["bending_stiffness"])
    assert any("markers 12 and 13" in warning for warning in study_warnings(study))
    assert exchanged_markers(study, study.poses[0], 5, 12) is None
