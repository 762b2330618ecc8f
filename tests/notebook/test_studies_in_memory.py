"""A study that is made in a notebook is checked as one that is read: the same sentences, from everything that takes a study."""

import copy
import pickle
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scan2flex_jax import (
    Clamp,
    EffectDeclaration,
    MeasuredCurve,
    Scan2FlexError,
    Study,
    StudyError,
    Tolerance,
    Unknown,
    explain,
    fit,
    load_study,
    predict,
    save_study,
)
from scan2flex_jax.examples import example_path
from scan2flex_jax.export import export
from scan2flex_jax.scan import extract_study
from scan2flex_jax.study import check_study, study_warnings
from scan2flex_jax.sweep import fits

from .scenes import BOTH, CABLE, HALF, POINTS, about_y, made, pose

pytestmark = pytest.mark.usefixtures("as_a_user_runs_it")


def test_the_study_of_these_tests_is_in_order():
    check_study(made())
    assert not [said for said in study_warnings(made()) if "tangent" in said or "than the cable" in said]


def test_the_page_on_arrays_runs_as_it_stands():
    text = (Path(__file__).parents[2] / "docs" / "python.md").read_text()
    code = next(block for block in re.findall(r"```python\n(.*?)```", text, re.DOTALL) if "from_arrays" in block)
    space = {}
    exec(code, space)
    assert [p.name for p in space["study"].poses] == ["p1", "p2"]
    found = space["fit"](space["study"]).estimates
    np.testing.assert_allclose([found[name].value for name in BOTH], [0.1, 0.25], rtol=1e-4)


def test_a_study_of_arrays_equals_the_one_on_disk():
    read = load_study(example_path("simulated-cable"))
    poses = [
        {"name": p.name, "role": p.role, "points": p.curve.points.tolist(), "start": (p.start.position, p.start.quaternion),
         "end": (list(p.end.position), tuple(p.end.quaternion))} for p in read.poses
    ]  # fmt: skip
    unknowns = [Unknown(name, low=1e-3, high=1e3) for name in BOTH]
    assert Study.from_arrays(dict(read.cable), poses, unknowns, title=read.title) == read


KINDS = {
    "lists": np.ndarray.tolist, "jax": jnp.asarray, "fortran": np.asfortranarray,
    "pandas": lambda x: pytest.importorskip("pandas").DataFrame(x), "views": lambda x: np.repeat(x, 2, axis=0)[::2],
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_arrays_of_any_kind_say_the_same(kind):
    assert made(poses=[pose(points=KINDS[kind](POINTS))]) == made()


def test_scalars_of_any_kind_say_the_same():
    for number in (np.float64(2), np.int64(2), 2, np.array(2), jnp.array(2.0)):
        assert made({**CABLE, "axial_stiffness": number}) == made({**CABLE, "axial_stiffness": 2.0})
        assert made(poses=[pose(turns=int(number), noise=number)]) == made(poses=[pose(turns=2, noise=2.0)])
        assert Tolerance(length=number) == Tolerance(length=2.0)
    assert made(gravity=[0, 0, -9.81]) == made() == made(gravity=np.array([0, 0, -9.81], object).astype(float))


def test_clamps_of_every_form_are_the_same():
    R, position = Rotation.from_rotvec([0.3, -0.5, 0.9]), np.array([0.1, 0.2, 0.3])
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = R.as_matrix(), position
    clamps = [Clamp.of((position, R.as_quat(canonical=True, scalar_first=True))), Clamp.of((position, R)), Clamp.of(M),
              Clamp.of([position, R.as_matrix().tolist()]), Clamp.from_matrix(M[:3]), Clamp.of(jnp.asarray(M))]  # fmt: skip
    for clamp in clamps:
        np.testing.assert_allclose(clamp.position, position)
        np.testing.assert_allclose(clamp.quaternion, clamps[0].quaternion, atol=1e-15)
        np.testing.assert_allclose(clamp.tangent, R.as_matrix()[:, 2], atol=1e-15)
    assert Clamp.of((position, None)) == Clamp(position)
    assert Clamp.of(clamps[0]) is clamps[0]


TAKERS = {
    "fit": fit, "explain": explain, "predict": predict, "export": lambda s: export(s, "json"), "fits": fits,
    "check_study": check_study, "save_study": lambda s: save_study(s, Path("nowhere")), "extract_study": extract_study,
}  # fmt: skip


@pytest.mark.parametrize("name", TAKERS)
def test_whatever_takes_a_study_checks_it(name):
    study = replace(made(), poses=(made().poses[0],) * 2)
    with pytest.raises(StudyError, match=r"pose\[2\].name: two poses are called 'p1': give each its own name"):
        TAKERS[name](study)
    assert not Path("nowhere").exists()


@pytest.mark.parametrize("name", [name for name in TAKERS if name != "extract_study"])
def test_no_filler_stands_for_the_weight(name):
    study = replace(made(unknowns=[Unknown(n, 0.1) for n in BOTH]), cable={"length": 0.9})
    with pytest.raises(StudyError, match=r"cable.length_density: it is missing"):
        TAKERS[name](study)


def test_a_pose_without_a_shape_can_be_predicted():
    known = made({**CABLE, "bending_stiffness": 0.1, "torsional_stiffness": 0.1}, (), [pose(points=None, role="validate")])
    assert bool(predict(known)["p1"].verdict.solved)


def test_a_folder_is_no_study():
    code = "from scan2flex_jax import fit, explain, predict\nfor f in (fit, explain, predict):\n try: f('my-cable')\n"
    code += " except Exception as e: print(type(e).__name__, e)"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.splitlines()
    assert (
        said
        == ["StudyError Study: got 'my-cable': give a Study, as load_study(folder) or Study.from_arrays(...) makes it."] * 3
    )


def test_a_study_is_changed_by_a_copy():
    study = made()
    with pytest.raises(Scan2FlexError, match="make a copy, as in replace"):
        study.cable["length"] = 1.0
    with pytest.raises(Scan2FlexError, match="make a copy"):
        study.cable |= {"length": 1.0}
    with pytest.raises(ValueError, match="read-only"):
        study.poses[0].curve.points[0] = 0.0
    POINTS_TOO = np.array(POINTS)
    own = MeasuredCurve(POINTS_TOO)
    POINTS_TOO[0] = np.nan
    assert np.all(np.isfinite(own.points))
    assert replace(study, cable={**study.cable, "length": 0.91}).cable["length"] == 0.91


@pytest.mark.parametrize("again", [copy.deepcopy, copy.copy, lambda s: pickle.loads(pickle.dumps(s)), replace])
def test_a_study_is_copied_whole(again):
    study = made(effects=[EffectDeclaration("point_mass", {"position": 0.4, "mass": 0.01})], tolerance=Tolerance(0.001))
    assert again(study) == study
    check_study(again(study))


def test_everything_in_millimetres_is_doubted():
    cable = {"length": 900.0, "length_density": 0.3}
    big = pose(points=1000 * POINTS, start=([0, 0, 0], about_y(HALF)), end=([500, 0, 0], about_y(-HALF)))
    assert "the cable is 900 m long: write lengths in metres." in study_warnings(made(cable, poses=[big]))
