"""What is saved reads back equal, and nothing of the user's is lost."""

import json
from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax.errors import StudyError
from scan2flex_jax.examples import example_names, example_path
from scan2flex_jax.study import (
    EffectDeclaration,
    MeasuredCurve,
    Study,
    Unknown,
    describe,
    load_study,
    save_study,
    write_json_atomic,
)

from .samples import STUDY, write_sample


def names(folder):
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def test_round_trip_into_another_folder(tmp_path):
    study = load_study(write_sample(tmp_path / "a"))
    assert save_study(study, tmp_path / "b" / "c") == tmp_path / "b" / "c" / "study.toml"
    again = load_study(tmp_path / "b" / "c")
    assert again == study and again.folder != study.folder
    assert names(tmp_path / "b" / "c") == names(tmp_path / "a")
    assert (tmp_path / "b/c/sag.xyz").read_bytes() == (tmp_path / "a/sag.xyz").read_bytes()


@pytest.mark.parametrize("name", example_names())
def test_round_trip_of_the_examples(tmp_path, name):
    study = load_study(example_path(name))
    save_study(study, tmp_path)
    assert load_study(tmp_path) == study


@pytest.mark.parametrize(
    ("left_out", "words"),
    [
        (("axial_stiffness = 1.0e5\n",), "axial_stiffness left out: the cable is assumed inextensible"),
        (("shear_stiffness = [1.0e5, 2.0e5]\n",), "shear_stiffness left out: the cable is assumed unshearable"),
        (("axial_stiffness = 1.0e5\n", "shear_stiffness = [1.0e5, 2.0e5]\n"), "is assumed inextensible and unshearable"),
        ((), None),
    ],
    ids=["axial", "shear", "both", "none"],
)
def test_what_is_assumed_of_the_cable_is_said(tmp_path, left_out, words):
    text = STUDY
    for line in left_out:
        text = text.replace(line, "")
    study = load_study(write_sample(tmp_path / "a", text))
    written = save_study(study, tmp_path / "b").read_text("utf-8")
    assert load_study(tmp_path / "b") == study
    for said in (written, describe(study), *study.assumptions):
        assert (words in said) if words else ("is assumed" not in said)
    comment = next((line for line in written.splitlines() if "is assumed" in line), "#")
    assert comment.startswith("#")


def test_an_effect_may_say_how_far_the_cable_stretches(tmp_path):
    study = load_study(write_sample(tmp_path, STUDY.replace("axial_stiffness = 1.0e5\n", "")))
    study = replace(study, effects=(*study.effects, EffectDeclaration("extensibility", {"axial_stiffness": 300.0})))
    assert study.assumptions == ()


def test_saving_what_is_there_leaves_every_byte(tmp_path):
    folder = write_sample(tmp_path, STUDY + "\n# a comment\n")
    before = {name: (folder / name).read_bytes() for name in names(folder)}
    save_study(load_study(folder), folder)
    assert {name: (folder / name).read_bytes() for name in names(folder)} == before


def test_what_changes_is_kept_beside(tmp_path):
    folder = write_sample(tmp_path, STUDY + "\n# a comment\n")
    first, csv = (folder / "study.toml").read_bytes(), (folder / "shapes/sag.csv").read_bytes()
    study = load_study(folder)
    pose = study.poses[0]
    moved = replace(pose, curve=replace(pose.curve, points=pose.curve.points + 1e-4))
    for i, title in enumerate(["one", "two", "three"]):
        changed = replace(study, title=title, poses=(moved, study.poses[1]))
        save_study(changed, folder)
        assert load_study(folder) == changed
        assert (folder / ("study.toml.bak" + (f".{i}" if i else ""))).exists()
    assert (folder / "study.toml.bak").read_bytes() == first
    assert (folder / "shapes/sag.csv.bak").read_bytes() == csv
    assert [name for name in names(folder) if "tmp" in name] == []


def test_no_study_in_the_way_is_kept_too(tmp_path):
    study = load_study(write_sample(tmp_path / "a"))
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "study.toml").write_bytes(b"\xff\x00 not a study")
    save_study(study, tmp_path / "b")
    assert (tmp_path / "b" / "study.toml.bak").read_bytes() == b"\xff\x00 not a study"


def test_curves_from_memory_get_names_of_their_own(tmp_path):
    study = load_study(write_sample(tmp_path / "a"))
    poses = tuple(
        replace(p, name=name, repeat_of=None, scan=None, guide_points_path=None,
                curve=MeasuredCurve(p.curve.points + i * 1e-3))
        for i, (p, name) in enumerate(zip(study.poses, ["a/b ü", "a b"], strict=True))
    )  # fmt: skip
    new = replace(study, poses=poses, folder=None, unknowns=(*study.unknowns, Unknown("length", 0.9, 0.5, 1.0)))
    save_study(new, tmp_path / "b")
    assert load_study(tmp_path / "b") == new
    assert names(tmp_path / "b") == ["a-b-2.csv", "a-b-guides.csv", "a-b.csv", "study.toml"]


def test_clamps_stand_on_one_line(tmp_path):
    save_study(load_study(write_sample(tmp_path / "a")), tmp_path / "b")
    lines = (tmp_path / "b" / "study.toml").read_text().splitlines()
    assert sum(line.startswith("start = {position = [0.0, 0.0, 0.0], quaternion = [") for line in lines) == 2
    assert '[unknown."point_mass.mass"]' in lines


@pytest.mark.parametrize(
    "change",
    [{"gravity": np.array([0.0, 0.0, np.nan])}, {"cable": {"length": 0.9}}, {"unknowns": (Unknown("nothing"),)}, {"poses": ()}],
)
def test_a_study_that_would_not_load_is_not_written(tmp_path, change):
    study = load_study(write_sample(tmp_path))
    before = (tmp_path / "study.toml").read_bytes()
    with pytest.raises(StudyError):
        save_study(replace(study, **change), tmp_path)
    assert (tmp_path / "study.toml").read_bytes() == before and "study.toml.bak" not in names(tmp_path)


def test_a_folder_that_is_a_file(tmp_path):
    study = load_study(write_sample(tmp_path))
    with pytest.raises(StudyError, match="cannot be written"):
        save_study(study, tmp_path / "sag.xyz")


def test_json_is_strict(tmp_path):
    path = tmp_path / "result.json"
    write_json_atomic(path, {"a": np.float32(0.5), "b": np.arange(3), "c": [True, None, "ü"], "d": np.int64(2)})
    assert json.loads(path.read_text(encoding="utf-8")) == {"a": 0.5, "b": [0, 1, 2], "c": [True, None, "ü"], "d": 2}
    before = path.read_bytes()
    for bad in (np.nan, float("inf"), np.array([1.0, -np.inf])):
        with pytest.raises(StudyError, match=r"poses\.sag"):
            write_json_atomic(path, {"poses": {"sag": bad}})
    with pytest.raises(StudyError, match="object"):
        write_json_atomic(path, {"a": object()})
    assert path.read_bytes() == before


def test_a_new_curve_takes_the_name_of_no_other_file(tmp_path):
    """A scan is a table of the pose's own name, and a note of the user has the next one."""
    texts = {"one.csv": "x,y,z\n0,0,0\n1,1,1\n", "one-2.csv": "x,y,z\n3,3,3\n4,4,4\n"}
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
    held = ([0, 0, 0], [0, 0.7071067811865476, 0, 0.7071067811865476])
    pose = {"name": "one", "points": [[0, 0, 0], [0.5, 0, -0.1], [0.9, 0, -0.3]], "scan": tmp_path / "one.csv", "start": held}
    cable = {"length": 1.0, "length_density": 0.1, "radius": 0.004}
    study = replace(Study.from_arrays(cable, [pose], ["bending_stiffness", "torsional_stiffness"]), folder=tmp_path)
    for _ in range(2):
        save_study(study, tmp_path)
        assert {name: (tmp_path / name).read_text() for name in texts} == texts
        (made,) = load_study(tmp_path).poses
        assert (made.scan.name, made.curve.path.name) == ("one.csv", "one-3.csv")
