"""What notebooks hold by mistake ends in one sentence, the same as for a file, and never in a number."""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax import Clamp, EffectDeclaration, StudyError, StudyPose, Tolerance, Unknown, fit, load_study
from scan2flex_jax.study import check_study
from tests.study.samples import STUDY, write_sample

from .scenes import BOTH, CABLE, POINTS, made, pose

pytestmark = pytest.mark.usefixtures("as_a_user_runs_it")


def swapped(study):
    """The study whose quaternions have the scalar last."""

    def turned(clamp):
        return replace(clamp, quaternion=np.roll(clamp.quaternion, -1))

    return replace(study, poses=tuple(replace(p, start=turned(p.start), end=turned(p.end)) for p in study.poses))


def posed(**changes):
    """How a study is made of one pose with these changes."""
    return lambda: made(poses=[pose(**changes)])


def nan_at(i):
    points = POINTS.copy()
    points[i] = np.nan
    return points


MISTAKES = {
    # what a notebook holds by mistake: how the study is made, and the sentence
    "no density": (lambda: made({"length": 0.9}), "Study: cable.length_density: it is missing: give its value, or declare"),
    "cable text": (lambda: made({**CABLE, "length": "0.9"}), "Study: cable.length: got the text '0.9': write a number"),
    "cable NaN": (lambda: made({**CABLE, "length": np.nan}), "Study: cable.length: got nan: write a finite number"),
    "cable None": (lambda: made({**CABLE, "length": None}), "Study: cable.length: got None: write a number"),
    "cable list": (lambda: made([0.9, 0.3]), "Study: cable: got [0.9, 0.3]: give a dict"),
    "role": (posed(role="fitt"), 'Study: pose[p1].role: got \'fitt\': write "fit" or "validate"'),
    "pose key": (posed(rolle="fit"), "Study: pose[p1].rolle: unknown key 'rolle': did you mean role?"),
    "no start": (
        lambda: made(poses=[{"points": POINTS}]),
        "Study: pose[p1].start: it is missing, and nothing else holds the cable: write it, as in start =",
    ),
    "one pose": (lambda: made(poses=pose()), "Study: poses: got {"),
    "one StudyPose": (lambda: replace(made(), poses=made().poses[0]), "Study: poses: got StudyPose(name='p1'"),
    "pose of arrays": (lambda: made(poses=[POINTS]), "Study: poses[1]: got array("),
    "poses None": (lambda: replace(made(), poses=None), "Study: poses: got None: give a list, as in [StudyPose(...)]"),
    "transposed": (posed(points=POINTS.T), "Study: pose[p1].points: got an array of shape (3, 40): transpose"),
    "plane points": (posed(points=POINTS[:, :2]), "points: got an array of shape (40, 2): give one row"),
    "NaN": (posed(points=nan_at(7)), "Study: pose[p1].points: point 8 is [nan, nan, nan]: give finite"),
    "masked": (posed(points=np.ma.masked_greater(POINTS, 0.45)), "Study: pose[p1].points: point 31 is [nan, "),
    "texts": (posed(points=POINTS.astype(str)), "points: got an array of <U32: give points in metres"),
    "ragged": (posed(points=[[0, 0, 0], [1, 2]]), "points: got [[0, 0, 0], [1, 2]]: give points in"),
    "complex": (posed(points=POINTS + 0j), "points: got an array of complex128: give points in metres"),
    "millimetres": (posed(points=1000 * POINTS), "Study: pose[p1].curve: the curve is 899"),
    "arc length short": (
        posed(arc_length=[0.0, 0.9]),
        "arc_length: got an array of shape (2,): give one arc length in metres for each of the 40 points",
    ),
    "quaternion NaN": (lambda: Clamp([0, 0, 0], [np.nan, 0, 0, 1]), "Clamp: quaternion: got nan: write a finite number"),
    "scalar last": (lambda: swapped(made()), "Study: pose[p1].start.quaternion: every clamp points more than 60 degrees away"),
    "reflection": (posed(start=([0, 0, 0], -np.eye(3))), "start.rotation: the 3x3 matrix is no rotation: its columns"),
    "transposed frame": (
        lambda: Clamp.of(np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0.1, 0, 0, 1]])),
        "Clamp: the last row of",
    ),
    "position alone": (lambda: Clamp.of([0, 0, 0]), "Clamp: a frame has 4x4 (or 3x4) finite numbers, and this is [0, 0, 0]."),
    "not a clamp": (
        lambda: StudyPose("a", "fit", (0, 0, 0)),
        "StudyPose 'a': start: got (0, 0, 0): give a Clamp, as in Clamp.of(",
    ),
    "not a curve": (lambda: StudyPose("a", "fit", Clamp([0, 0, 0]), curve=POINTS), "StudyPose 'a': curve: got array("),
    "unknown": (
        lambda: made(unknowns=["bending_stifness"]),
        "nothing is called 'bending_stifness': did you mean bending_stiffness?",
    ),
    "one unknown": (lambda: made(unknowns="bending_stiffness"), "Study: unknowns: got 'bending_stiffness': give a list"),
    "unknown text": (
        lambda: replace(made(), unknowns=["bending_stiffness"]),
        "Study: unknowns[1]: got 'bending_stiffness': give Unknown(",
    ),
    "guess text": (lambda: Unknown(BOTH[0], "0.1"), "Unknown 'bending_stiffness': guess: got the text '0.1': write a number"),
    "tolerance dict": (
        lambda: replace(made(), tolerance={"length": 0.1}),
        "Study: tolerance: got {'length': 0.1}: give a Tolerance, as in",
    ),
    "kind": (
        lambda: EffectDeclaration("pointmass"),
        "EffectDeclaration: kind: unknown kind 'pointmass': did you mean point_mass?",
    ),
    "parameter": (
        lambda: EffectDeclaration("point_mass", {"mas": 1}),
        "EffectDeclaration 'point_mass': mas: unknown key 'mas': did you mean",
    ),
    "parameter missing": (
        lambda: made(effects=[EffectDeclaration("point_mass", {"mass": 0.1})]),
        "Study: effect[1].position: point_mass needs its",
    ),
    "scan of points": (posed(scan=POINTS), "Study: pose[p1].scan: got array("),
    "weightless": (lambda: made(gravity=[0, 0, 0]), "Study: gravity: gravity is zero and both stiffnesses are unknown"),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_mistake_is_one_sentence(name):
    make, words = MISTAKES[name]
    with pytest.raises(StudyError) as refusal:
        fit(make())
    said = str(refusal.value)
    assert words in said
    assert "\n" not in said and said.endswith((".", "?")) and len(said) < 500


Q = "quaternion = [0.7071068, 0.0, 0.7071068, 0.0]"
START = f"start = {{ position = [0.0, 0.0, 0.0], {Q} }}"


def with_pose(study, i, **changes):
    poses = list(study.poses)
    poses[i] = replace(poses[i], **changes)
    return replace(study, poses=tuple(poses))


def with_cable(study, **changes):
    cable = {**study.cable, **changes}
    return replace(study, cable={key: value for key, value in cable.items() if value is not None})


SAME = {
    # the same fault on disk and in memory
    "role": ('role = "fit"', 'role = "fitt"', lambda s: with_pose(s, 0, role="fitt")),
    "quaternion": (
        START,
        START.replace("0.7071068, 0.0]", "0.5, 0.0]"),
        lambda s: with_pose(s, 0, start=Clamp([0, 0, 0], [0.7071068, 0, 0.5, 0])),
    ),
    "length": ("length = 0.90", "length = -0.90", lambda s: with_cable(s, length=-0.9)),
    "no density": ("length_density = 0.336\n", "", lambda s: with_cable(s, length_density=None)),
    "unknown": (
        "unknown.bending_stiffness",
        "unknown.bending_stifness",
        lambda s: replace(s, unknowns=(Unknown("bending_stifness"), *s.unknowns[1:])),
    ),
    "tolerance": (
        "clamp_rotation = 0.01",
        "clamp_rotation = -0.01",
        lambda s: replace(s, tolerance=Tolerance(clamp_rotation=-0.01)),
    ),
    "two of a name": ('name = "again"', 'name = "sag"', lambda s: with_pose(s, 1, name="sag", repeat_of=None)),
    "kind": ('kind = "point_mass"', 'kind = "pointmass"', lambda _: EffectDeclaration("pointmass", {"position": 0.42})),
    "parameter": ("position = 0.42", "", lambda s: replace(s, effects=(EffectDeclaration("point_mass"), s.effects[1]))),
    "far clamps": (
        "[0.5, 0.0, 0.0], quat",
        "[0.96, 0.0, 0.0], quat",
        lambda s: with_pose(s, 0, end=replace(s.poses[0].end, position=[0.96, 0, 0])),
    ),
}


@pytest.mark.parametrize("name", SAME)
def test_the_sentence_is_that_of_a_file(tmp_path, name):
    old, new, change = SAME[name]
    assert old in STUDY
    study = load_study(write_sample(tmp_path))
    with pytest.raises(StudyError) as read:
        load_study(write_sample(tmp_path, STUDY.replace(old, new, 1)))
    with pytest.raises(StudyError) as made_here:
        check_study(change(study))
    assert made_here.value.sentence == read.value.sentence
    assert read.value.key.endswith(made_here.value.key) or made_here.value.key.endswith(read.value.key)
    assert made_here.value.file.startswith(("Study", "Clamp", "Tolerance", "EffectDeclaration", "Unknown"))
