"""The JSON schema of study.toml: it takes whatever the reader takes, and refuses the mistakes that people make."""

import json
import tomllib

import pytest
from jsonschema import Draft7Validator
from typer.testing import CliRunner

from scan2flex_jax.cli.app import app
from scan2flex_jax.errors import StudyError
from scan2flex_jax.study import kind_names, load_study, study_schema
from scan2flex_jax.version import __version__
from tests.documents import ROOT

from .samples import STUDY, write_sample
from .test_bad_input import TOML

SCHEMA = study_schema()
EDITOR = Draft7Validator(SCHEMA)
STUDIES = sorted((ROOT / "scan2flex_jax" / "examples").glob("*/study.toml")) + sorted((ROOT / "tests").rglob("study.toml"))
ALL = """\
[[pose]]
name = "all"
role = "fit"
start = { position = [0, 0, 0] }
markers = "marks.csv"
gravity = [0, 0, -9.81]
time = 1
reset = true

[[effect]]
kind = "point_mass"
mass = 0.1
poses = ["sag"]

[[effect]]
kind = "curvature_profile"
s = [0.1, 0.2, 0.3]
curvature = [[0, 1, 0], [0, 2, 0], [0, 1, 0]]

[[effect]]
kind = "bending_law"
curvature = [1, 2]

[[effect]]
kind = "natural_curvature"

[[effect]]
kind = "support_plane"
normal = [0, 0, 1]
offset = -1

[unknown."point_mass[2].position"]
[unknown.bending_law.factor]
[unknown."natural_curvature.curvature"]
prior = { mean = [0, 0, 0], std = 1 }

[unknown."curvature_profile.curvature"]
range = [-3, 3]
"""
VALUES = (
    "true", '""', "0", "-1", "1.0", "{}", "[]", "[0, 1]", "[1, true, 2]", "[[0, 1, true]]", "[[0, 1, 0], [1, 0, 0]]", '["sag"]',
)  # fmt: skip
SAMPLE = STUDY.replace("[tolerance]", "[tolerance]\nclamp_position = 0.0\nclamp_roll = 1", 1) + ALL
LINES = SAMPLE.splitlines()
ASSIGNED = {line: i for i, line in enumerate(LINES) if " = " in line}


def marks(text):
    """What an editor says of a study."""
    return [error.message for error in EDITOR.iter_errors(tomllib.loads(text))]


def test_it_is_a_schema():
    Draft7Validator.check_schema(SCHEMA)


@pytest.mark.parametrize("file", STUDIES, ids=lambda file: file.parent.name)
def test_studies_are_taken(file):
    assert marks(file.read_text("utf-8")) == []


def test_the_sample_is_taken(tmp_path):
    load_study(sample(tmp_path), purpose="predict")
    assert marks(SAMPLE) == []


@pytest.mark.parametrize("name", ['"point_mass[2]".position', "point_mass.position", '"point_mass.position"'])
def test_unknowns_of_effects_are_written_in_several_ways(tmp_path, name):
    text = SAMPLE.replace('[unknown."point_mass[2].position"]', f"[unknown.{name}]").replace("[unknown.point_mass.mass]\n", "")
    text = text.replace("position = 0.42", "position = 0.42\nmass = 0.1")
    (sample(tmp_path) / "study.toml").write_text(text, "utf-8")
    load_study(tmp_path, purpose="predict")
    assert marks(text) == []


@pytest.mark.parametrize("at", ASSIGNED.values(), ids=lambda at: LINES[at])
def test_what_it_marks_the_reader_refuses(tmp_path, at):
    folder, key = sample(tmp_path), LINES[at].split(" = ")[0]
    for value in VALUES:
        text = "\n".join([*LINES[:at], f"{key} = {value}", *LINES[at + 1 :]])
        if marks(text):
            (folder / "study.toml").write_text(text, "utf-8")
            with pytest.raises(StudyError):
                load_study(folder, purpose="predict")


def sample(folder):
    """The folder of the sample, which uses every type of key."""
    return write_sample(folder, SAMPLE, marks="s,x,y,z\n0,0,0,0\n0.4,0.4,0,0\n")


UNSEEN = {  # faults that show in several parts of a study together, or in its files
    "effect in a pose that is not", "prior outside", "guess outside", "range reversed", "start outside", "no length",
    "no density", "no torsion", "no start", "scan without radius", "unknown effect", "unknown twice", "pose twice",
    "pose empty name", "no fit",
    "turns of a ball joint", "no shape", "quaternion", "far clamps", "clamps in mm", "repeat of none",
    "repeat of itself",
    "absolute", "upward", "drive", "backslash", "null byte", "long name", "no such file", "a folder", "no scan", "vast integer",
    "field of other places", "field backwards", "field off the cable", "effect lacks", "effect off the cable", "inf", "nan",
    "effect of one end", "normal", "coupling", "stretch",
}  # fmt: skip
PARSED = [case for case in TOML if case[0] not in ("not TOML", "key twice", "deep")]


@pytest.mark.parametrize(("name", "old", "new"), [case[:3] for case in PARSED], ids=[case[0] for case in PARSED])
def test_mistakes_are_marked(name, old, new):
    assert bool(marks(STUDY.replace(old, new, 1))) == (name not in UNSEEN)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("length = 0.90", "lenght = 0.90", "'lenght' was unexpected"),
        ("length = 0.90", 'length = "0.90"', "is not of type 'number'"),
        ("gravity = [0.0, 0.0, -9.81]", "gravity = -9.81", "is not of type 'array'"),
        ('kind = "point_mass"', 'kind = "pointmass"', "'pointmass' is not one of"),
        ("position = 0.42", "positoin = 0.42", "'positoin' was unexpected"),
        ("position = 0.42", "stiffness = 0.42", "'stiffness' was unexpected"),
        ("[unknown.bending_stiffness]", "[unknown.bending_stifness]", "'bending_stifness' does not match any"),
    ],
)
def test_marks_name_the_mistake(old, new, words):
    said = marks(STUDY.replace(old, new, 1))
    assert len(said) == 1 and words in said[0]


def test_descriptions_have_units_and_no_links():
    table = study_schema()["properties"]  # other tests add effect types
    assert table["gravity"]["description"] == "in the scan frame (m/s^2). Required."
    assert table["cable"]["description"].startswith("known properties of the cable. ")
    assert "N/m (of tether)" in table["effect"]["items"]["properties"]["stiffness"]["description"]
    assert table["effect"]["items"]["properties"]["kind"]["enum"] == list(kind_names())


def test_the_command_writes_it(tmp_path):
    done = CliRunner().invoke(app, ["schema", "-o", str(tmp_path / "study.schema.json")])
    assert done.exit_code == 0 and "#:schema ./study.schema.json" in done.output
    written = json.loads((tmp_path / "study.schema.json").read_text("utf-8"))
    assert written.pop("$comment") == f"scan2flex_jax {__version__}"
    assert written == study_schema()
