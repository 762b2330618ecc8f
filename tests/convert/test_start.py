"""A study from a folder: what is found, converted and asked for, and that it loads and says what was measured."""

import re

import numpy as np
import pytest

from scan2flex_jax.convert import clamp_of_angles, measured_files, new_study, read_frames
from scan2flex_jax.convert.ends import clamps_of_curve
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.examples import example_path
from scan2flex_jax.study import Clamp, load_study, save_study

KNOWN = {"length": 1.0, "length_density": 0.2}


@pytest.fixture
def folder(tmp_path):
    """The curves of the simulated cable, in mm, two of them with decimal commas, one from end to start."""
    study = load_study(example_path("simulated-cable"))
    for i, pose in enumerate(study.poses):
        points = 1e3 * pose.curve.points[:: -1 if pose.name == "unseen" else 1]
        mark, decimal = (";", ",") if i < 2 else (",", ".")
        rows = [mark.join(f"{v:.6f}".replace(".", decimal) for v in row) for row in points]
        (tmp_path / f"{pose.name}.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "notes.md").write_text("not a measurement\n")
    return tmp_path


def clamps():
    poses = load_study(example_path("simulated-cable")).poses
    return {f"{p.name} {end}": getattr(p, end) for p in poses for end in ("start", "end")}


def test_a_folder_becomes_the_study_that_was_measured(folder):
    poses = measured_files(folder)
    assert [p.name for p in poses] == ["aside-45", "plane", "twist-90", "unseen"]
    study, notes = new_study(folder, poses, clamps=clamps(), units="mm", validate=("unseen",), title="a <cable>", **KNOWN)
    assert any("turned round" in note for note in notes)
    save_study(study, folder)
    found, true = load_study(folder), load_study(example_path("simulated-cable"))
    assert found == study
    assert found.unknown_names == ("bending_stiffness", "torsional_stiffness")
    for pose in true.poses:
        again = found.pose(pose.name)
        assert again.role == pose.role
        assert again.curve.path == folder.resolve() / "curves" / f"{pose.name}.csv"  # the files of the other tool stay
        np.testing.assert_allclose(again.curve.points, pose.curve.points, atol=1e-8)
        np.testing.assert_allclose(again.end.quaternion, pose.end.quaternion, atol=1e-9)
    with pytest.raises(Scan2FlexError, match="a study already"):
        measured_files(folder)


def test_clamps_of_a_curve_are_those_of_an_untwisted_cable():
    """A plane curve: both frames lie in its plane, and the tangents are those of the clamps that held it."""
    pose = load_study(example_path("simulated-cable")).pose("plane")
    start, end, tolerance = clamps_of_curve(pose.curve.points)
    for found, true in ((start, pose.start), (end, pose.end)):
        np.testing.assert_allclose(found.position, true.position, atol=1e-4)
        np.testing.assert_allclose(found.tangent, true.tangent, atol=tolerance.clamp_rotation)
    turn = np.asarray(start.quaternion) * [1, -1, -1, -1]
    w = turn[0] * end.quaternion[0] - turn[1:] @ end.quaternion[1:]
    assert 2 * np.arccos(min(1.0, abs(w))) == pytest.approx(np.arccos(start.tangent @ end.tangent), abs=1e-6)


def test_clamps_are_not_taken_from_a_curve_that_turns_back():
    there = np.column_stack([np.linspace(0, 1, 9), np.zeros(9), np.zeros(9)])
    with pytest.raises(Scan2FlexError, match="turns back"):
        clamps_of_curve(np.concatenate([there, there[-2::-1]]))


def test_scans_in_millimetres_are_scaled(tmp_path):
    points = np.random.default_rng(0).uniform(-1, 1, (50, 3))
    np.savetxt(tmp_path / "sag.xyz", 1e3 * points)
    (tmp_path / "sag-guides.csv").write_text("x,y,z\n0,0,0\n500,0,100\n")
    both = {"sag start": Clamp(np.zeros(3)), "sag end": clamp_of_angles([0.5, 0, 0], [0, 90, 0], "rpy")}
    study, _ = new_study(tmp_path, measured_files(tmp_path), clamps=both, units="mm", radius=0.004, **KNOWN)
    import trimesh

    assert study.poses[0].scan.name == "sag.ply"
    np.testing.assert_allclose(trimesh.load(study.poses[0].scan).vertices, points, atol=1e-6)
    np.testing.assert_allclose(study.poses[0].guide_points, [[0, 0, 0], [0.5, 0, 0.1]])
    save_study(study, tmp_path)
    assert load_study(tmp_path) == study


def test_a_file_in_the_place_of_the_copy_in_metres_is_kept_beside(tmp_path):
    np.savetxt(tmp_path / "sag.xyz", np.random.default_rng(0).uniform(-1, 1, (50, 3)))
    (tmp_path / "scans").mkdir()
    (tmp_path / "scans" / "sag.ply").write_bytes(b"mine")
    held = {"sag start": Clamp(np.zeros(3))}
    for _ in range(2):
        new_study(tmp_path, measured_files(tmp_path), clamps=held, units="mm", radius=0.004, **KNOWN)
    assert (tmp_path / "scans" / "sag.ply.bak").read_bytes() == b"mine"
    assert {path.name for path in (tmp_path / "scans").iterdir()} == {"sag.ply", "sag.ply.bak"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"clamps": {}}, "'aside-45 start'.*there are none"),
        ({"clamps": {"plane start": Clamp(np.zeros(3))}}, "'aside-45 start'.*there are 'plane start'"),
        ({"clamps": {**clamps(), "sag start": Clamp(np.zeros(3))}}, "'sag start' belongs to no pose"),
        ({"clamps": {**clamps(), "Plane end": Clamp(np.zeros(3))}}, "'Plane end' belongs to no pose: did you mean plane end"),
        ({"clamps": clamps(), "validate": ("unsen",)}, "no pose is called 'unsen': did you mean unseen"),
        ({"clamps": clamps(), "markers": True}, "aside-45.csv: its markers have no arc length: add a column s"),
        ({"clamps": None, "markers": True}, "markers do not reach the clamps"),
        ({"clamps": clamps(), "validate": ("sag",)}, "no pose is called 'sag'"),
        ({"clamps": clamps(), "validate": ("aside-45", "plane", "twist-90", "unseen")}, "leave at least one"),
    ],
)
def test_what_does_not_fit_is_one_sentence(folder, options, words):
    with pytest.raises(Scan2FlexError, match=words):
        new_study(folder, measured_files(folder), units="mm", **KNOWN, **options)


@pytest.mark.parametrize(("units", "hint"), [(None, "looks like millimetres"), ("cm", "or correct the length")])
def test_a_forgotten_unit_is_named(folder, units, hint):
    with pytest.raises(Scan2FlexError, match=f"aside-45.csv: in this unit the curve is .* name the unit of the files.*{hint}"):
        new_study(folder, measured_files(folder), clamps=None, units=units, **KNOWN)


def test_a_folder_without_measurements_is_refused(tmp_path):
    for folder in (tmp_path, tmp_path / "nowhere"):
        with pytest.raises(Scan2FlexError, match=r"folder|put them there"):
            measured_files(folder)
    for name in ("a.csv", "a.txt"):
        (tmp_path / name).write_text("0,0,0\n")
    with pytest.raises(Scan2FlexError, match="two of a kind"):
        measured_files(tmp_path)


def test_the_file_of_the_clamps_is_no_pose(folder):
    rows = [
        f"{name},{','.join(f'{1e3 * v:.9f}' for v in c.position)},{','.join(map(repr, c.quaternion.tolist()))}"
        for name, c in clamps().items()
    ]
    (folder / "clamps.csv").write_text("name,x,y,z,qw,qx,qy,qz\n" + "\n".join(rows) + "\n")
    frames = read_frames(folder / "clamps.csv", units="mm")
    poses = measured_files(folder, (folder / "clamps.csv",))
    assert len(poses) == 4
    study, _ = new_study(folder, poses, clamps=frames, units="mm", **KNOWN)
    np.testing.assert_allclose(study.pose("plane").end.position, [0.6, 0, 0])


def test_a_length_without_its_unit_is_named(folder):
    with pytest.raises(Scan2FlexError, match=r"aside-45.csv: .* the cable is 900 m: .*name that of the length \('900 mm'\)"):
        new_study(folder, measured_files(folder), clamps=clamps(), units="mm", length=900.0, length_density=0.2)


@pytest.mark.parametrize("header", ["name,x,y,z,a,b,c", "pose;end;x;y;z", '"name","x","y","z"'])
def test_a_file_of_frames_is_no_curve(folder, header):
    (folder / "clamps.csv").write_text(f"{header}\n")
    with pytest.raises(Scan2FlexError, match=r"clamps.csv holds frames, not a curve: name it with --clamps"):
        measured_files(folder)
    assert len(measured_files(folder, leave_out=(folder / "clamps.csv",))) == 4


def test_an_end_without_a_frame_is_said_to_be_free(folder):
    held = {name: clamp for name, clamp in clamps().items() if name != "plane end"}
    study, notes = new_study(folder, measured_files(folder), clamps=held, units="mm", **KNOWN)
    assert study.pose("plane").end is None
    assert [note for note in notes if "free" in note] == ["plane: its end is free, as there is no frame 'plane end'"]


@pytest.fixture
def dots(tmp_path):
    """Nine markers on each curve of the simulated cable, in mm, s first."""
    for pose in load_study(example_path("simulated-cable")).poses:
        points = pose.curve.points
        s = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))]
        rows = 1e3 * np.column_stack([s, points])[8:-8:8]
        np.savetxt(tmp_path / f"{pose.name}.csv", rows, delimiter=",", header="s,x,y,z", comments="", fmt="%.6f")
    return tmp_path


def test_markers_become_markers(dots):
    study, notes = new_study(dots, measured_files(dots), clamps=clamps(), units="mm", markers=True, **KNOWN)
    save_study(study, dots)
    found = load_study(dots)
    assert not any("--markers" in note for note in notes)
    for pose in found.poses:
        assert pose.curve is None and pose.markers.path.parent == dots.resolve() / "markers"
        rows = 1e-3 * np.loadtxt(dots / f"{pose.name}.csv", delimiter=",", skiprows=1)
        np.testing.assert_allclose(np.column_stack([pose.markers.arc_length, pose.markers.points]), rows, atol=1e-12)
    with pytest.raises(Scan2FlexError, match="name the unit of the files"):
        (dots / "study.toml").unlink()
        new_study(dots, measured_files(dots), clamps=clamps(), markers=True, **KNOWN)


def test_sparse_points_with_arc_lengths_may_be_markers(dots):
    _, notes = new_study(dots, measured_files(dots), clamps=clamps(), units="mm", **KNOWN)
    [said] = [note for note in notes if "--markers" in note]
    assert re.search(r"up to \d+(\.\d+)? mm apart", said)
