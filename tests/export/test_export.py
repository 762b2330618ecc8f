"""What is exported hangs as ours does: in plain JSON exactly, in simulators of rigid links to second order in the link."""

import json
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.examples import example_path
from scan2flex_jax.export import export, hung
from scan2flex_jax.rod.boundary import rotation_of_quaternion
from scan2flex_jax.study import EffectDeclaration, load_study

KNOWN = {"bending_stiffness": 0.1, "torsional_stiffness": 0.25}
ELEMENTS = 40  # those of the package's default, whose compilation other tests share
COARSE = 20


def cable(**changes):
    """The simulated cable of the paper with its true stiffness."""
    study = load_study(example_path("simulated-cable"))
    return replace(study, title='a "cable" <-- & more -->\n', cable={**study.cable, **KNOWN, **changes}, unknowns=())


@pytest.fixture(scope="module")
def twisted():
    return hung(cable(), "twist-90", ELEMENTS)


def test_json_holds_the_cable_and_its_balance(twisted):
    """Read back with numpy alone: links, stiffness and weight of the file balance in every section (paper, Eq. 5)."""
    found = json.loads(export(cable(), "json", pose="twist-90", elements=ELEMENTS))
    e, pose = found["elements"], found["pose"]
    ds = found["length"] / len(e["s"])
    r = np.array(pose["position"])
    R = np.array([rotation_of_quaternion(np.array(q)) for q in pose["quaternion"]])
    np.testing.assert_allclose(np.array(e["stiffness"])[0], np.diag([1e5, 1e5, 1e5, 0.1, 0.1, 0.25]))
    assert np.sum(e["density"]) * ds == pytest.approx(0.2)
    np.testing.assert_allclose(r, twisted.position)
    half = Rotation.from_matrix(np.swapaxes(R[:-1], 1, 2) @ R[1:]).as_rotvec() / 2
    strain = np.einsum("nij,nj->ni", np.array(e["stiffness"])[:, 3:, 3:], 2 * half / ds)
    moment = (Rotation.from_matrix(R[:-1]) * Rotation.from_rotvec(half)).apply(strain)  # in the middles of the elements
    tangent, weight = 0.5 * (r[2:] - r[:-2]), -0.2 * ds * np.array(found["gravity"])
    beyond = np.diff(moment, axis=0) + np.cross(tangent, np.arange(len(tangent))[:, None] * weight)  # = -tangent x f0
    columns = -np.cross(tangent[:, None], np.eye(3)).transpose(0, 2, 1)
    f0, *_ = np.linalg.lstsq(columns.reshape(-1, 3), beyond.ravel(), rcond=None)
    assert np.max(np.abs(columns @ f0 - beyond)) < 0.01 * np.max(np.abs(beyond))  # differences of second order
    assert set(found["meaning"]) >= {"units", "stiffness", "quaternion", "held", "beyond"}


def names_of_script(source):
    """What a script of PyElastica defines before its scene."""
    names = {}
    exec(compile(source.split("class Scene")[0].replace("import elastica as ea\n", ""), "cable.py", "exec"), names)
    return names


def test_stiffness_that_was_assumed_is_softer_where_time_steps_depend_on_it():
    def stiffness(study):
        names = names_of_script(export(study, "pyelastica", pose="twist-90", elements=ELEMENTS))
        return np.diag(names["CABLE"]["shear"][0])

    known = {k: v for k, v in cable().cable.items() if k not in ("shear_stiffness", "axial_stiffness")}
    soft = stiffness(replace(cable(), cable=known))
    np.testing.assert_allclose(soft, soft[0])
    force = hung(replace(cable(), cable=known), "twist-90", ELEMENTS).strain * 2e6 * (0.2 * 9.81 + 50 * 0.1)  # N
    np.testing.assert_allclose(force / soft, 1e-3, rtol=1e-6)  # of 0.2 kg and EI 0.1 N m^2
    np.testing.assert_allclose(stiffness(replace(cable(), cable={**known, "axial_stiffness": 2e5}))[2], 2e5)


def test_the_mujoco_model_has_the_masses_and_springs_of_the_cable(twisted):
    root = ET.fromstring(export(cable(), "mujoco", pose="twist-90", elements=ELEMENTS))
    masses = [float(g.get("mass")) for g in root.iter("geom")]
    assert len(masses) == ELEMENTS + 1
    assert sum(masses) == pytest.approx(0.2)
    joints = list(root.iter("joint"))
    assert len(joints) == 3 * ELEMENTS
    springs = {name: {float(j.get("stiffness")) for j in joints if j.get("name").endswith(name)} for name in "xyz"}
    ds = 1.0 / ELEMENTS
    for name, stiffness in zip("xyz", (0.1, 0.1, 0.25), strict=True):
        assert list(springs[name]) == [pytest.approx(stiffness / ds)]
    assert root.find("equality/weld") is not None
    free = replace(cable(), poses=(replace(cable().poses[0], end=None),))
    assert ET.fromstring(export(free, "mujoco", elements=ELEMENTS)).find("equality") is None


def test_the_mujoco_model_as_loaded_hangs_in_the_pose_and_is_straight_at_zero_angles(twisted):
    """Bodies are placed as our links; hinges turned back by the angles they begin at leave every link along the one before."""
    root = ET.fromstring(export(cable(), "mujoco", pose="twist-90", elements=ELEMENTS))
    whole = Rotation.identity()
    for k, body in enumerate(root.iter("body")):
        placed = Rotation.from_quat([float(x) for x in body.get("quat").split()], scalar_first=True)
        whole = whole * placed
        np.testing.assert_allclose(whole.as_matrix(), twisted.rotation[k], atol=1e-12)
        back = Rotation.identity()
        for joint in body.findall("joint"):
            axis = np.array([float(x) for x in joint.get("axis").split()])
            back = back * Rotation.from_rotvec(-float(joint.get("ref")) * axis)
        assert k == 0 or (placed * back).magnitude() < 1e-12


def test_the_script_is_python_whatever_the_title_says():
    source = export(cable(), "pyelastica", pose="twist-90", elements=ELEMENTS)
    names = names_of_script(source)
    assert names["TITLE"] == cable().title
    compile(source, "cable.py", "exec")
    position = np.array(names["CABLE"]["position"])
    assert position.shape == (ELEMENTS + 2, 3)
    np.testing.assert_allclose(0.5 * (position[0] + position[1]), [0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(0.5 * (position[-2] + position[-1]), [0.6, 0.2, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("change", "to", "words"),
    [
        (lambda s: s, "ansys", "mujoco, pyelastica, usd, abaqus, orcaflex, moordyn, cabledyn, moduli, json"),
        (lambda s: load_study(example_path("simulated-cable")), "json", "no value"),
    ],
)
def test_what_cannot_be_exported_is_one_sentence(change, to, words):
    with pytest.raises(Scan2FlexError, match=words) as found:
        export(change(cable()), to, elements=ELEMENTS)
    assert "\n" not in str(found.value)


def effect(kind, **parameters):
    return EffectDeclaration(kind, parameters)


def test_json_says_what_a_simulator_must_add():
    study = replace(cable(), effects=(effect("point_mass", position=0.5, mass=0.05), effect("scan_scale", factor=1.01)))
    assert json.loads(export(study, "json", elements=ELEMENTS))["beyond"] == ["point_mass"]


def links(data, count, ds):
    """Points of the centre line (m) that the links are centred on."""
    bodies = [data.body(f"link{k}") for k in range(count + 1)]
    return np.array([b.xpos + 0.5 * ds * b.xmat.reshape(3, 3)[:, 2] for b in bodies])


def off_in_mujoco(study, pose, elements, seconds=4.0):
    """Distance (m) of the model at rest from ours, never twice as far since it was loaded; and the fastest joint (rad/s)."""
    import mujoco

    ours = hung(study, pose, elements)
    model = mujoco.MjModel.from_xml_string(export(study, "mujoco", pose=pose, elements=elements))
    data = mujoco.MjData(model)
    away = []
    while data.time < seconds:
        mujoco.mj_step(model, data)
        away.append(np.max(np.linalg.norm(links(data, elements, ours.length / elements) - ours.position, axis=1)))
    assert max(away) < 2.0 * away[-1]
    return away[-1], np.abs(data.qvel).max()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pose", "changes"),
    [
        ("twist-90", {}),
        ("aside-45", {"bending_stiffness": np.array([0.1, 0.2])}),
        ("plane", {"natural_curvature": np.array([0.5, 1.0, 2.0])}),
    ],
    ids=["twisted", "two stiffnesses", "bent at rest"],
)
def test_mujoco_hangs_as_ours_does(pose, changes):
    """A chain of n links is of second order in L/n: 4e-3 L with 20 of them, a quarter of it with twice as many."""
    pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install 'scan2flex_jax[peers]'")
    coarse, fine = (off_in_mujoco(cable(**changes), pose, n) for n in (COARSE, 2 * COARSE))
    assert max(coarse[1], fine[1]) < 1e-5  # rad/s: settled
    assert coarse[0] < 6e-3
    assert 3.0 < coarse[0] / fine[0] < 5.0


@pytest.mark.slow
@pytest.mark.parametrize("changes", [{}, {"natural_curvature": np.array([0.5, 1.0, 2.0])}], ids=["plain", "bent at rest"])
def test_pyelastica_hangs_as_ours_does(tmp_path, changes):
    """The script, run as a user runs it: second order in L/n, like the chain above."""
    pytest.importorskip("elastica", reason="PyElastica is not installed: pip install 'scan2flex_jax[peers]'")
    (tmp_path / "cable.py").write_text(export(cable(**changes), "pyelastica", pose="twist-90", elements=COARSE))
    done = subprocess.run([sys.executable, "cable.py"], cwd=tmp_path, capture_output=True, text=True, timeout=900, check=False)
    assert done.returncode == 0, done.stderr
    settled = np.loadtxt(tmp_path / "settled.csv", delimiter=",", skiprows=1)
    ours = hung(cable(**changes), "twist-90", COARSE)
    assert np.max(np.linalg.norm(settled - ours.position, axis=1)) < 6e-3
