"""Every fault gives one sentence that names the file and the key.

Each case: a name, what to replace in the sample study (old, new), and the file, key and a word of the error.
"""

import numpy as np
import pytest

from scan2flex_jax.errors import StudyError
from scan2flex_jax.study import load_study

from .samples import STUDY, csv, curve, write_sample

Q = "quaternion = [0.7071068, 0.0, 0.7071068, 0.0]"
START = f"start = {{ position = [0.0, 0.0, 0.0], {Q} }}\nend = {{ position = [0.5, 0.0, 0.0], {Q}"
SHAPES = 'centre_curve = "shapes/sag.csv"\nscan = "sag.xyz"\nguide_points = "sag-guides.csv"\n'

GRIP = 'kind = "elastic_clamp"\nstiffness = [1.0, 2.0]'
FIELD = 'kind = "curvature_profile"\ncurvature = [[0, 1, 0], [0, 2, 0]]\n'

TOML = [
    ("prior a number", "guess = 0.1", "prior = 0.1", "unknown.bending_stiffness.prior", "dict"),
    ("prior without std", "guess = 0.1", "prior = { mean = 0.1 }", "unknown.bending_stiffness.prior.std", "missing"),
    ("prior key", "guess = 0.1", "prior = { mean = 1, sd = 1 }", "unknown.bending_stiffness.prior.sd", "unknown key"),
    ("prior of no width", "guess = 0.1", "prior = { mean = 1, std = 0 }", "unknown.bending_stiffness.prior.std", "above zero"),
    ("prior below zero", "guess = 0.1", "prior = { mean = -1, std = 1 }", "unknown.bending_stiffness.prior.mean", "above zero"),
    ("prior of three", "guess = 0.1", "prior = { mean = [1, 2, 3], std = 1 }", "unknown.bending_stiffness.prior.mean",
     "2 numbers"),
    ("prior outside", "guess = 0.1", "prior = { mean = 1e3, std = 1 }", "unknown.bending_stiffness.prior.mean", "outside"),
    ("roll below zero", "clamp_rotation = 0.01", "clamp_roll = -1", "tolerance.clamp_roll", "zero"),
    ("effect in no pose", "position = 0.42", "position = 0.42\nposes = []", "effect[1].poses", "name the poses"),
    ("effect in one text", "position = 0.42", 'position = 0.42\nposes = "sag"', "effect[1].poses", "give a list"),
    ("effect in a pose that is not", "position = 0.42", 'position = 0.42\nposes = ["sga"]', "effect[1].poses", "mean sag"),
    ("effect twice in a pose", "position = 0.42", 'position = 0.42\nposes = ["sag", "sag"]', "effect[1].poses", "twice"),
    ("gravity of a pose", "noise = 0.001", "gravity = -9.81", "pose[sag].gravity", "3 numbers"),
    ("time", "noise = 0.001", 'time = "noon"', "pose[sag].time", "without quotation"),
    ("reset", "noise = 0.001", "reset = 1", "pose[sag].reset", "true or false"),
    ("format", '"scan2flex-study/1"', '"scan2flex-study/2"', "format", "scan2flex-study/1"),
    ("no format", 'format = "scan2flex-study/1"', "", "format", "missing"),
    ("key above", 'title = "PTFE single-core cable"', 'titel = "a"', "titel", "title"),
    ("title", '"PTFE single-core cable"', "3", "title", "text"),
    ("no gravity", "gravity = [0.0, 0.0, -9.81]", "", "gravity", "missing"),
    ("gravity of two", "[0.0, 0.0, -9.81]", "[0.0, -9.81]", "gravity", "3 numbers"),
    ("gravity a number", "[0.0, 0.0, -9.81]", "-9.81", "gravity", "3 numbers"),
    ("gravity nested", "[0.0, 0.0, -9.81]", "[[0.0], 0.0, -9.81]", "gravity", "3 numbers"),
    ("gravity true", "[0.0, 0.0, -9.81]", "[0.0, 0.0, true]", "gravity", "true"),
    ("cable key", "length_density", "lenght_density", "cable.lenght_density", "length_density"),
    ("cable no table", "[cable]\n", "cable = 3\n[x]\n", "x", "unknown key"),
    ("negative length", "length = 0.90", "length = -0.90", "cable.length", "above zero"),
    ("text length", "length = 0.90", 'length = "0.90"', "cable.length", "quotation"),
    ("length true", "length = 0.90", "length = true", "cable.length", "true"),
    ("length a date", "length = 0.90", "length = 1979-05-27", "cable.length", "number"),
    ("nan", "length = 0.90", "length = nan", "cable.length", "finite"),
    ("inf", "length = 0.90", "length = inf", "cable.length", "finite"),
    ("vast integer", "length = 0.90", "length = 1" + 400 * "0", "cable.length", "below"),
    ("zero density", "length_density = 0.336", "length_density = 0", "cable.length_density", "above zero"),
    ("negative stiffness", "[1.0e5, 2.0e5]", "[1.0e5, -2.0e5]", "cable.shear_stiffness", "above zero"),
    ("stiffness of three", "[1.0e5, 2.0e5]", "[1, 2, 3]", "cable.shear_stiffness", "2 numbers"),
    ("stretch", "natural_stretch = [0.0, 0.0, 0.0]", "natural_stretch = [0, 0, -1]", "cable.natural_stretch", "-1"),
    ("no length", "length = 0.90\n", "", "cable.length", "missing"),
    ("no density", "length_density = 0.336\n", "", "cable.length_density", "unknown.length_density"),
    ("no torsion", "torsional_stiffness = 0.03\n", "", "cable.torsional_stiffness", "missing"),
    ("scan without radius", "radius = 0.004\n", "", "cable.radius", "scan"),
    ("tolerance key", "clamp_rotation", "clamp_rotatoin", "tolerance.clamp_rotatoin", "clamp_rotation"),
    ("tolerance below zero", "clamp_rotation = 0.01", "clamp_rotation = -0.01", "tolerance.clamp_rotation", "zero"),
    ("unknown name", "unknown.bending_stiffness", "unknown.bending_stifness", "unknown.bending_stifness", "stiffness?"),
    ("unknown radius", "[unknown.bending", "[unknown.radius]\n[unknown.bending", "unknown.radius", "[cable]"),
    ("unknown effect", "unknown.point_mass.mass", "unknown.tether.stiffness", "unknown.tether.stiffness", "declared"),
    ("unknown twice", "[unknown.point_mass.mass]", '[unknown.point_mass.mass]\n[unknown."point_mass.mass"]',
     "unknown.point_mass.mass", "twice"),
    ("unknown a number", "unknown.point_mass.mass]", "unknown.point_mass]\nmass = 1", "unknown.point_mass", "nothing"),
    ("unknown key", "guess = 0.1", "gues = 0.1", "unknown.bending_stiffness.gues", "guess"),
    ("guess outside", "guess = 0.1", "guess = 1e3", "unknown.bending_stiffness.guess", "outside"),
    ("guess below zero", "guess = 0.1", "guess = -1", "unknown.bending_stiffness.guess", "above zero"),
    ("guess of three", "guess = 0.1", "guess = [1, 2, 3]", "unknown.bending_stiffness.guess", "2 numbers"),
    ("range reversed", "[1.0e-3, 1.0e2]", "[1.0e2, 1.0e-3]", "unknown.bending_stiffness.range", "low below high"),
    ("range from zero", "[1.0e-3, 1.0e2]", "[0, 1.0e2]", "unknown.bending_stiffness.range", "above zero"),
    ("range of one", "[1.0e-3, 1.0e2]", "[1.0e2]", "unknown.bending_stiffness.range", "low"),
    ("range of two kinds", "[1.0e-3, 1.0e2]", "[[1, 2, 3], 4]", "unknown.bending_stiffness.range", "2 numbers"),
    ("start outside", "guess = [0, 0, 0]\nrange = [[-1, -1, -1], [1, 1, 1]]", "range = [-0.01, 0.01]",
     "cable.natural_curvature", "outside"),
    ("pose twice", 'name = "again"', 'name = "sag"', "pose[2].name", "two poses"),
    ("pose without name", 'name = "again"\n', "", "pose[2].name", "missing"),
    ("pose empty name", 'name = "again"', 'name = " "', "pose[2].name", "empty"),
    ("pose key", "noise = 0.001", "noize = 0.001", "pose[sag].noize", "noise"),
    ("no fit", 'role = "fit"', 'role = "validate"', "pose", "fit"),
    ("role", 'role = "fit"', 'role = "train"', "pose[sag].role", "validate"),
    ("no role", 'role = "fit"\n', "", "pose[sag].role", "missing"),
    ("turns 0.5", "turns = -1", "turns = 0.5", "pose[sag].turns", "whole"),
    ("turns true", "turns = -1", "turns = true", "pose[sag].turns", "whole"),
    ("turns vast", "turns = -1", "turns = 12345678", "pose[sag].turns", "between"),
    ("turns of a ball joint", 'repeat_of = "sag"', 'repeat_of = "sag"\nturns = 1', "pose[again].turns", "freely"),
    ("no shape", SHAPES, "", "pose[sag]", "centre curve"),
    ("no start", START, f"end = {{ position = [0.5, 0.0, 0.0], {Q}", "pose[sag].start", "missing"),
    ("start a list", START, f"start = [0, 0, 0]\nend = {{ position = [0.5, 0.0, 0.0], {Q}", "pose[sag].start", "table"),
    ("clamp key", START, START.replace("position", "pos", 1), "pose[sag].start.pos", "position"),
    ("quaternion", START, START.replace("0.7071068, 0.0]", "0.71, 0.1]", 1), "pose[sag].start.quaternion", "unit"),
    ("far clamps", "[0.5, 0.0, 0.0], quat", "[0.96, 0.0, 0.0], quat", "pose[sag].end.position", "apart"),
    ("clamps in mm", "[0.5, 0.0, 0.0], quat", "[500.0, 0.0, 0.0], quat", "pose[sag].end.position", "millimetres"),
    ("noise zero", "noise = 0.001", "noise = 0", "pose[sag].noise", "above zero"),
    ("no viewpoint", "[[0.5, -1.0, 0.3]]", "[]", "pose[sag].viewpoints", "each point"),
    ("viewpoint flat", "[[0.5, -1.0, 0.3]]", "[0.5, -1.0, 0.3]", "pose[sag].viewpoints", "one row [x, y, z]"),
    ("repeat of none", 'repeat_of = "sag"', 'repeat_of = "sags"', "pose[again].repeat_of", "sag"),
    ("repeat of itself", 'repeat_of = "sag"', 'repeat_of = "again"', "pose[again].repeat_of", "other"),
    ("absolute", '"shapes/sag.csv"', '"/etc/passwd"', "pose[sag].centre_curve", "inside"),
    ("upward", '"shapes/sag.csv"', '"../sag.csv"', "pose[sag].centre_curve", "inside"),
    ("drive", '"shapes/sag.csv"', '"C:/sag.csv"', "pose[sag].centre_curve", "inside"),
    ("backslash", '"shapes/sag.csv"', "'shapes\\sag.csv'", "pose[sag].centre_curve", "inside"),
    ("null byte", '"shapes/sag.csv"', '"a\\u0000b"', "pose[sag].centre_curve", "inside"),
    ("long name", '"shapes/sag.csv"', f'"{5000 * "a"}"', "pose[sag].centre_curve", "name"),
    ("no such file", '"shapes/sag.csv"', '"sag.csv"', "pose[sag].centre_curve", "not there"),
    ("a folder", '"shapes/sag.csv"', '"shapes"', "pose[sag].centre_curve", "regular"),
    ("no scan", '"sag.xyz"', '"sag.ply"', "pose[sag].scan", "not there"),
    ("kind", 'kind = "point_mass"', 'kind = "pointmass"', "effect[1].kind", "point_mass"),
    ("no kind", 'kind = "point_mass"\n', "", "effect[1].kind", "missing"),
    ("field without places", GRIP, FIELD, "effect[2].s", "give it."),
    ("field at one place", GRIP, FIELD + "s = [0.1]", "effect[2].s", "at least 2"),
    ("field of other places", GRIP, FIELD + "s = [0.1, 0.2, 0.3]", "effect[2].curvature", "3 lists of 3 numbers"),
    ("field backwards", GRIP, FIELD + "s = [0.3, 0.2]", "effect[2].s", "does not grow"),
    ("field off the cable", GRIP, FIELD + "s = [0.3, 1.2]", "effect[2].s", "on the cable"),
    ("unknown places", GRIP, FIELD + 's = [0.1, 0.2]\n[unknown."curvature_profile.s"]',
     "unknown.curvature_profile.s", "nothing"),
    ("effect key", "position = 0.42", "positoin = 0.42", "effect[1].positoin", "position"),
    ("effect lacks", "position = 0.42", "", "effect[1].position", "needs"),
    ("effect off the cable", "position = 0.42", "position = 0.95", "effect[1].position", "on the cable"),
    ("effect before the cable", "position = 0.42", "position = -0.1", "effect[1].position", "zero"),
    ("effect of one end", "stiffness = [1.0, 2.0]", "stiffness = [1.0]", "effect[2].stiffness", "2 numbers"),
    ("effect shape", "position = 0.42", "position = [0.42]", "effect[1].position", "one number"),
    ("normal", 'kind = "elastic_clamp"\nstiffness = [1.0, 2.0]',
     'kind = "support_plane"\nnormal = [0, 0, 2]\noffset = 0', "effect[2].normal", "unit"),
    ("coupling", 'kind = "elastic_clamp"\nstiffness = [1.0, 2.0]',
     'kind = "bend_twist_coupling"\ncoupling = [0.9, 0.5]', "effect[2].coupling", "below 1"),
    ("not TOML", "[cable]", "[cable", None, "TOML"),
    ("key twice", "noise = 0.001", "noise = 0.001\nnoise = 0.001", None, "TOML"),
    ("deep", "length = 0.90", "length = " + 50_000 * "[", None, "deep"),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "key", "word"), [case[1:] for case in TOML], ids=[case[0] for case in TOML])
def test_faults_of_study_toml(tmp_path, old, new, key, word):
    assert old in STUDY
    error = fails(write_sample(tmp_path, STUDY.replace(old, new, 1)))
    assert (error.file, error.key) == (str(tmp_path / "study.toml"), key)
    assert word in error.sentence


HEAD = 'format = "scan2flex-study/1"\ngravity = [0, 0, -9.81]\n'
KINDS = [("cable", "cable = 3\npose = []"), ("pose", "cable = {}\npose = 3"), ("pose", "cable = {}\npose = [3]")]
KINDS += [("pose", "cable = {}")]
KINDS += [(key, f"cable = {{}}\npose = []\n{key} = 3") for key in ("tolerance", "effect", "unknown")]


@pytest.mark.parametrize(("key", "text"), KINDS)
def test_a_number_for_a_table(tmp_path, key, text):
    assert fails(write_sample(tmp_path, HEAD + text)).key == key


def test_an_empty_file_is_named_where_it_is_named(tmp_path):
    error = fails(write_sample(tmp_path, again=""))
    assert error.key == "pose[again].centre_curve" and "empty" in error.sentence


def fails(folder):
    """The error of a study, which is one line that ends like a sentence."""
    with pytest.raises(StudyError) as caught:
        load_study(folder)
    assert "\n" not in str(caught.value) and str(caught.value)[-1] in ".?" and len(str(caught.value)) < 1200
    return caught.value


POINTS = curve()
S = np.linspace(0, 0.9, 40)[:, None]
LINES = csv(POINTS)
CSV = [
    ("no header", LINES.removeprefix("x,y,z\n"), "header", "x,y,z"),
    ("header with semicolons", LINES.replace(",", ";"), "header", "x,y,z"),
    ("header in another order", LINES.replace("x,y,z", "z,y,x"), "header", "x,y,z"),
    ("blank", " ", "header", "first line"),
    ("only the header", "x,y,z\n\n", None, "no point"),
    ("two columns", LINES.replace("\n", "\n0.1,0.2\n", 1), "line 2", "2 columns"),
    ("four columns", LINES + "1,2,3,4\n", "line 42", "4 columns"),
    ("a word", LINES + "1,abc,3\n", "line 42", "abc"),
    ("an empty cell", LINES + "1,,3\n", "line 42", "no number"),
    ("nan", LINES + "1,nan,3\n", None, "finite"),
    ("inf", LINES + "1,1e999,3\n", None, "finite"),
    ("an underscore", LINES + "1,1_0,3\n", "line 42", "no number"),
    ("one point", csv(POINTS[:1]), None, "at least 2"),
    ("repeated", csv(POINTS[[0, 1, 1, 2, 3]]), None, "2 and 3"),
    ("s stands", csv(np.hstack([0 * S, POINTS]), "s,x,y,z"), "s", "grow"),
    ("s falls", csv(np.hstack([S[::-1], POINTS]), "s,x,y,z"), "s", "grow"),
    ("s is nan", csv(np.hstack([S * np.nan, POINTS]), "s,x,y,z"), "s", "finite"),
    ("garbage", b"x,y,z\n\xff\xfe\x00\n", None, "UTF-8"),
    ("null bytes", b"x,y,z\n\x00,\x00,\x00\n", "line 2", "no number"),
]


@pytest.mark.parametrize(("content", "key", "word"), [case[1:] for case in CSV], ids=[case[0] for case in CSV])
def test_faults_of_a_curve(tmp_path, content, key, word):
    error = fails(write_sample(tmp_path, again=content))
    assert (error.file, error.key) == (str(tmp_path / "again.csv"), key)
    assert word in error.sentence


SHAPE = [
    ("millimetres", POINTS * 1000, "x,y,z", "millimetres"),
    ("centimetres", POINTS * 100, "x,y,z", "centimetres"),
    ("too long", POINTS * 1.5, "x,y,z", "long"),
    ("s in millimetres", np.hstack([S * 1000, POINTS]), "s,x,y,z", "millimetres"),
    ("s before zero", np.hstack([S - 0.5, POINTS]), "s,x,y,z", "from 0"),
    ("kilometres", POINTS / 1000, "x,y,z", "metres"),
    ("another frame", POINTS + 5.0, "x,y,z", "frame"),
]


@pytest.mark.parametrize(("table", "header", "word"), [case[1:] for case in SHAPE], ids=[case[0] for case in SHAPE])
def test_curves_that_cannot_be_of_this_cable(tmp_path, table, header, word):
    error = fails(write_sample(tmp_path, again=csv(table, header)))
    assert (error.file, error.key) == (str(tmp_path / "study.toml"), "pose[again].centre_curve")
    assert word in error.sentence


def test_guide_points(tmp_path):
    assert fails(write_sample(tmp_path, **{"sag-guides": csv(POINTS[:1])})).file == str(tmp_path / "sag-guides.csv")
    error = fails(write_sample(tmp_path, **{"sag-guides": csv(1000 * POINTS)}))
    assert error.key == "pose[sag].guide_points" and "millimetres" in error.sentence
    assert fails(write_sample(tmp_path, **{"sag-guides": csv(np.hstack([S, POINTS]), "s,x,y,z")})).key == "header"


WEIGHTLESS = STUDY.replace("-9.81", "0.0").replace("[[pose]]", "[unknown.torsional_stiffness]\n\n[[pose]]", 1)


def test_without_gravity_shapes_determine_only_ratios(tmp_path):
    text = WEIGHTLESS.replace('kind = "elastic_clamp"\nstiffness = [1.0, 2.0]', 'kind = "scan_scale"\nfactor = 1')
    error = fails(write_sample(tmp_path, text))
    assert error.key == "gravity" and "only ratios" in error.sentence


@pytest.mark.parametrize(
    "text",
    [
        STUDY.replace("-9.81", "0.0"),
        WEIGHTLESS,  # a clamp of known stiffness sets the scale
        WEIGHTLESS.replace('kind = "elastic_clamp"\nstiffness = [1.0, 2.0]', 'kind = "point_load"\nposition = 0\n'
                           "force = [0, 0, 1]"),
        STUDY.replace("[[pose]]", "[unknown.torsional_stiffness]\n[unknown.length_density]\n[[pose]]", 1),
    ],
)  # fmt: skip
def test_a_scale_is_known_or_left_to_the_fit(tmp_path, text):
    load_study(write_sample(tmp_path, text))


def test_a_stretchy_cable_may_span_more(tmp_path):
    far = STUDY.replace("[0.5, 0.0, 0.0], quat", "[0.96, 0.0, 0.0], quat")
    load_study(write_sample(tmp_path, far.replace("axial_stiffness = 1.0e5", "axial_stiffness = 10.0")))


def test_paths_that_are_no_study(tmp_path):
    (tmp_path / "empty").mkdir()
    (tmp_path / "folder" / "study.toml").mkdir(parents=True)
    for path, word in (("nowhere", "no such"), ("empty", "no study.toml"), ("folder", "folder"), ("a\0b", "")):
        assert word in fails(tmp_path / path).sentence
    assert fails(tmp_path / "empty").key is None


def test_links_out_of_the_folder(tmp_path):
    folder = write_sample(tmp_path / "study")
    (tmp_path / "secret.csv").write_text(LINES)
    for target in (tmp_path / "secret.csv", folder / "again.csv"):
        (folder / "again.csv").unlink()
        (folder / "again.csv").symlink_to(target)
        assert "inside the folder" in fails(folder).sentence


def test_bytes_that_are_no_text(tmp_path):
    error = fails(write_sample(tmp_path, b"\x00\xff" * 100))
    assert error.key is None and "UTF-8" in error.sentence


LONG_KEYS = {
    "dotted": lambda n: ".".join("a" * n) + " = 1\n",
    "spaced": lambda n: " . ".join("a" * n) + " = 1\n",
    "quoted": lambda n: ".".join(['"a\\"."'] * n) + " = 1\n",
    "literal": lambda n: ".".join(["'a.'"] * n) + " = 1\n",
    "table": lambda n: "[" + ".".join("a" * n) + "]\n",
    "array of tables": lambda n: "[[ " + ".".join("a" * n) + " ]]\n",
    "in a table": lambda n: "x = {b = 1, " + ".".join("a" * n) + " = 1}\n",
}


@pytest.mark.parametrize("name", LONG_KEYS)
def test_a_key_of_many_parts_is_refused_before_it_is_parsed(tmp_path, name):
    """tomllib takes hours over 200 kB of them: the text is looked at first."""
    error = fails(write_sample(tmp_path, STUDY + LONG_KEYS[name](50_000)))
    assert error.key is None
    assert error.sentence == f"line {STUDY.count(chr(10)) + 1} has a key of more than 32 parts: write the study by the format."


def test_a_study_of_many_poses_is_read(tmp_path):
    """900 poses, 200 kB: dots of numbers and of file names are no long keys."""
    pose = STUDY[STUDY.index('[[pose]]\nname = "again"') : STUDY.index("[[effect]]")]
    more = "".join(pose.replace('"again"', f'"v1.2.3.4.{i}"') for i in range(900))
    text = STUDY.replace("[[effect]]", more + "[[effect]]", 1).replace("title = ", "# " + 20 * "a.b. " + "\ntitle = ")
    assert len(text) > 150_000
    assert len(load_study(write_sample(tmp_path, text)).poses) == 902


def test_names_that_are_suggested_are_printable(tmp_path):
    folder = write_sample(tmp_path, STUDY.replace('name = "sag"', r'name = "\u0000\u001b[2J"'))
    error = fails(folder)
    assert error.key == "pose[again].repeat_of" and str(error).isprintable() and r"\x00\x1b[2J" in error.sentence


@pytest.mark.parametrize("name", ["study.toml", "Study.TOML", "./study.toml"])
def test_the_study_itself_is_no_measurement(tmp_path, name):
    folder = write_sample(tmp_path, STUDY.replace('scan = "sag.xyz"', f'scan = "{name}"'))
    error = fails(folder)
    assert error.key == "pose[sag].scan" and "which is the study itself" in error.sentence
