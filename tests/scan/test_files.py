"""Clouds in the formats that the study promises: points of XYZ, OBJ and PLY as they are, meshes of OBJ and STL sampled."""

import gzip
import os
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.scan import load_cloud, shapes, tube_mesh
from scan2flex_jax.scan.cloud import MESH_SAMPLES, normals_at
from scan2flex_jax.scan.coarse_curve import axis_votes
from scan2flex_jax.study.scans import scan_facts
from tests.outputs import scenes

LENGTH, RADIUS = 1.0, 0.012
DATA = Path(__file__).parents[1] / "data"


@pytest.fixture(scope="module")
def points():
    return np.random.default_rng(2).normal(size=(500, 3)).round(6)


def _rows(head, points):
    return "".join(f"{head}{x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in points)


WRITTEN = {
    "plain.xyz": lambda points: _rows("", points),
    "vertices.obj": lambda points: "# vertices only\n" + _rows("v ", points),
    "text.ply": lambda points: (
        f"ply\nformat ascii 1.0\nelement vertex {len(points)}\nproperty float x\nproperty float y\nproperty float z\n"
        "end_header\n" + _rows("", points)
    ),
}


@pytest.mark.parametrize("name", WRITTEN)
def test_points_are_read_as_they_are(tmp_path, points, name):
    (tmp_path / name).write_text(WRITTEN[name](points))
    cloud = load_cloud(tmp_path / name)
    np.testing.assert_allclose(cloud.points, points, atol=1e-6)
    assert cloud.notes == ()


@pytest.mark.parametrize("ending", ["obj", "stl", "ply"])
def test_a_mesh_is_sampled_the_same_every_time(tmp_path, ending):
    curve = shapes.FAMILIES["helix"](LENGTH, RADIUS)
    path = tmp_path / f"cable.{ending}"
    tube_mesh(curve, RADIUS).export(path)
    cloud = load_cloud(path)
    assert cloud.points.shape == (MESH_SAMPLES, 3)
    assert len(cloud.notes) == 1 and "is a mesh of" in cloud.notes[0]
    np.testing.assert_array_equal(cloud.points, load_cloud(path).points)
    away = np.linalg.norm(cloud.points[::97, None] - shapes.resample(curve, 4001), axis=2).min(axis=1)
    assert np.quantile(away, 0.99) < 1.01 * RADIUS  # the ends are closed by flat faces
    assert abs(np.median(away) / RADIUS - 1.0) < 0.01
    np.testing.assert_allclose(np.linalg.norm(cloud.normals, axis=1), 1.0, atol=1e-6)


def test_normals_of_a_file_are_used(tmp_path):
    """Points of a straight cable, too few to show where their surface faces; their normals, in a PLY, show its axis."""
    rng = np.random.default_rng(4)
    angle, x = rng.uniform(-1.2, 1.2, 150), rng.uniform(0.0, 0.6, 150)
    normals = np.column_stack([0.0 * angle, np.cos(angle), np.sin(angle)])
    points = RADIUS * normals + np.column_stack([x, 0.0 * x, 0.0 * x])
    head = "".join(f"property float {name}\n" for name in ("x", "y", "z", "nx", "ny", "nz"))
    rows = "".join(" ".join(f"{v:.7f}" for v in row) + "\n" for row in np.hstack([points, normals]))
    (tmp_path / "faced.ply").write_text(f"ply\nformat ascii 1.0\nelement vertex 150\n{head}end_header\n{rows}")
    cloud = load_cloud(tmp_path / "faced.ply")
    np.testing.assert_allclose(cloud.normals, normals, atol=1e-6)
    np.testing.assert_allclose(normals_at(cloud, cloud.points[40:60]), normals[40:60], atol=1e-6)
    assert normals_at(cloud.points, cloud.points) is None

    def off_axis(known):
        votes, _ = axis_votes(cloud.points, RADIUS, known)
        return np.median(np.linalg.norm(votes[:, 1:], axis=1))

    assert off_axis(cloud.normals) < 0.02 * RADIUS
    assert off_axis(None) > 0.1 * RADIUS


@pytest.mark.parametrize("name", ["empty.xyz", "words.xyz", "empty.obj", "cut.stl"])
def test_what_holds_no_points_is_refused(tmp_path, name):
    (tmp_path / name).write_text({"words.xyz": "this is no cloud\n", "cut.stl": "solid x\n facet normal"}.get(name, ""))
    with pytest.raises(Scan2FlexError, match=name.replace(".", r"\.")) as refusal:
        load_cloud(tmp_path / name)
    assert "\n" not in str(refusal.value)


def test_points_and_a_mesh_in_one_file(tmp_path):
    """A PLY with faces is a mesh; scattered vertices that belong to no face are no surface and are left out."""
    box = trimesh.creation.box((1.0, 1.0, 1.0))
    loose = trimesh.Trimesh(np.vstack([box.vertices, [[9.0, 9.0, 9.0]]]), box.faces, process=False)
    loose.export(tmp_path / "box.ply")
    assert np.abs(load_cloud(tmp_path / "box.ply").points).max() < 0.5 + 1e-9


def test_nothing_beside_the_scan_is_read(tmp_path):
    """An OBJ may name a file of materials; whatever that is, the points are the same and it is never opened."""
    (tmp_path / "study").mkdir()
    os.mkfifo(tmp_path / "outside.mtl")  # whoever opens it waits for ever
    scan = tmp_path / "study" / "scan.obj"
    scan.write_text("mtllib ../outside.mtl\nusemtl a\n" + "".join(f"v {x} 0 0\n" for x in range(6)))
    assert len(load_cloud(scan).points) == 6


def test_a_face_of_points_that_are_not_there_is_refused(tmp_path, capfd):
    scan = tmp_path / "scan.off"
    scan.write_text("OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n")
    with pytest.raises(Scan2FlexError, match=r"scan\.off"):
        load_cloud(scan)
    assert capfd.readouterr() == ("", "")


def _ply(declared, rows, form="ascii"):
    head = f"ply\nformat {form} 1.0\nelement vertex {declared}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    body = "0 0 0\n" * rows if form == "ascii" else "\0" * 12 * rows
    return (head + body).encode("ascii")


def _mesh(kind, **options):
    data = trimesh.creation.box((1.0, 1.0, 1.0)).export(file_type=kind, **options)
    return data if isinstance(data, bytes) else data.encode()


SHORT = {
    "text.ply": (_ply(100, 60), "header says 100 points, and there are 60"),
    "bytes.ply": (_ply(100, 60, "binary_little_endian"), "header says 100 points, and there are 60"),
    "cut.ply": (_ply(100, 100, "binary_big_endian")[:-1], "header says 100 points, and there are 99"),
    "faces.ply": (_mesh("ply")[:-150], "ends before its 12 faces"),
    "textfaces.ply": (_mesh("ply", encoding="ascii").rsplit(b"\n", 4)[0], "ends before its 12 faces"),
    "bytes.stl": (_mesh("stl")[:-120], "header says 12 triangles, and there are 9"),
    "cut.off": (b"OFF\n100 0 0\n" + b"0 0 0\n" * 60, "header says 100 points, and there are 60"),
    "cut.glb": (_mesh("glb")[:-60], "cut short"),
    "none.ply": (_ply(0, 0), "holds no points"),
    "none-bytes.ply": (_ply(0, 0, "binary_little_endian"), "holds no points"),
    "none.xyz": (b"# x y z\n\n", "holds no points"),
    "none.obj": (b"# empty\nvn 0 0 1\n", "holds no points"),
    "none.stl": (b"solid x\nendsolid x\n", "holds no points"),
    "none-bytes.stl": (b"\0" * 84, "holds no points"),
    "none.off": (b"OFF\n0 0 0\n", "holds no points"),
}


@pytest.mark.parametrize("name", SHORT)
def test_what_is_empty_or_cut_short_is_said_by_every_reader(tmp_path, name):
    """`check` asks for facts, `extract` and `fit` for points: the sentence is one."""
    data, words = SHORT[name]
    (tmp_path / name).write_bytes(data)
    said = set()
    for read in (load_cloud, scan_facts):
        with pytest.raises(Scan2FlexError, match=words) as refusal:
            read(tmp_path / name)
        said.add(str(refusal.value))
    assert len(said) == 1 and "\n" not in said.pop()


@pytest.mark.parametrize("command", ["check", "extract", "fit"])
def test_commands_say_so_in_one_sentence(tmp_path, command):
    study = scenes.write_study(tmp_path / "study", measured="scan")
    with (study / "study.toml").open("a") as toml:
        toml.write("\n[unknown.bending_stiffness]\n")
    text = (study / "study.toml").read_text()
    (study / "study.toml").write_text(text.replace("pose-0.xyz", "pose-0.ply"))
    (study / "pose-0.ply").write_bytes(_ply(100, 60))
    found = scenes.run(command, study)
    assert isinstance(found.exception, Scan2FlexError)
    assert "pose-0.ply" in str(found.exception)
    said = "its header says 100 points, and there are 60: it was cut short; export it again, as PLY or XYZ."
    assert str(found.exception).endswith(said)


TABLES = {
    "commas.xyz": "0, 1, 2\n3, 4, 5\n",
    "no-end.xyz": "0,1,2\n3,4,5",
    "colours.xyz": "# x y z\n0 1 2 255 0 0\n\n3 4 5 0 0 255\n",
    "windows.txt": "\ufeff0 1 2\r\n3 4 5\r\n",
    "intensity.pts": "2\n0 1 2 -120 10 10 10\n3 4 5 -80 20 20 20\n",
    "cloudcompare.asc": "//X Y Z Scalar field\n0 1 2 0.5\n3 4 5 0.25\n",
    "header.csv": "intensity,z,y,x\n7,2,1,0\n8,5,4,3\n",
    "german.csv": "X [mm];Y [mm];Z [mm]\n0,0;1000,0;2.000,00\n3000,0;4000,0;5000,0\n",
    "millimetres.csv": '"x (mm)";"y (mm)";"z (mm)"\n0;1000;2000\n3000;4000;5000\n',
    "tabs.txt": "0\t1\t2\n3\t4\t5\n",
    "holes.xyz": "nan nan nan\n0 1 2\nnan nan nan\n3 4 5\n",
    "gaps.csv": "x,y,z\n0,1,2\n,,\n3,4,5\n",
}


@pytest.mark.parametrize("name", TABLES)
def test_tables_of_points_as_others_write_them(tmp_path, name):
    (tmp_path / name).write_text(TABLES[name], "utf-8")
    found = load_cloud(tmp_path / name)
    np.testing.assert_allclose(found.points, np.arange(6.0).reshape(2, 3), atol=1e-12)
    said = {"german.csv": "in mm", "millimetres.csv": "in mm", "holes.xyz": "2 of 4", "gaps.csv": "1 of 3"}.get(name)
    assert [said in note for note in found.notes] == [True] if said else found.notes == ()


def _las(path, points):
    laspy = pytest.importorskip("laspy")
    data = laspy.LasData(laspy.LasHeader(point_format=6, version="1.4"))
    data.header.scales, data.header.offsets = [1e-6] * 3, points.min(0)
    data.x, data.y, data.z = points.T
    data.write(path)


def _e57(path, points):
    """Two scans, the second one from another place: its points are in the frame of the scanner there."""
    pye57 = pytest.importorskip("pye57")
    with pye57.E57(str(path), mode="w") as out:
        turn, shift = Rotation.from_rotvec([0.3, -0.2, 1.0]), np.array([1.0, 2.0, 3.0])
        quaternion = turn.as_quat(scalar_first=True)
        moved = turn.inv().apply(points[200:] - shift)
        for part, pose in ((points[:200], {}), (moved, {"rotation": quaternion, "translation": shift})):
            out.write_scan_raw({f"cartesian{c}": x for c, x in zip("XYZ", part.T, strict=True)}, **pose)


def _ptx(path, points):
    """One scan with a turned and moved scanner, and a point without a return; the matrix is written transposed."""
    turn, shift = Rotation.from_rotvec([0.3, -0.2, 1.0]).as_matrix(), np.array([1.0, 2.0, 3.0])
    rows = np.vstack([(points - shift) @ turn, np.zeros(3)])
    matrix = np.vstack([np.column_stack([turn.T, np.zeros(3)]), [*shift, 1.0]])
    head = [f"{len(rows)}\n1", *(" ".join(map(str, row)) for row in (shift, *turn.T, *matrix))]
    path.write_text("\n".join([*head, *(" ".join([*map(str, row), "0.5"]) for row in rows)]) + "\n")


BINARY = {
    "a.las": _las,
    "a.laz": _las,
    "a.e57": _e57,
    "a.ptx": _ptx,
    "a.npy": np.save,
    "wide.npy": lambda path, points: np.save(path, np.hstack([points, points])),
    "named.npy": lambda path, points: np.save(path, np.rec.fromarrays(points.T, names="x,y,z")),
    "a.npz": lambda path, points: np.savez(path, points=points, colours=np.zeros(len(points))),
}


@pytest.mark.parametrize("name", BINARY)
def test_formats_of_scanners(tmp_path, points, name):
    """Written by the libraries of the formats."""
    BINARY[name](tmp_path / name, points)
    np.testing.assert_allclose(load_cloud(tmp_path / name).points, points, atol=2e-6)
    assert scan_facts(tmp_path / name)[0] == len(points)
    (tmp_path / f"{name}.gz").write_bytes(gzip.compress((tmp_path / name).read_bytes()))
    np.testing.assert_allclose(load_cloud(tmp_path / f"{name}.gz").points, points, atol=2e-6)


@pytest.mark.parametrize("data", ["ascii", "binary", "binary_compressed"])
def test_pcd(tmp_path, data):
    """The packed one was written by pypcd4, with a field of intensities."""
    path = DATA / "pypcd4.pcd"
    expected = np.random.default_rng(3).normal(size=(200, 3)).astype(np.float32).round(2)
    if data != "binary_compressed":
        rows = np.column_stack([np.zeros(200), expected]).astype("<f4")
        head = f"VERSION .7\nFIELDS rgb x y z\nSIZE 4 4 4 4\nTYPE F F F F\nWIDTH 200\nHEIGHT 1\nPOINTS 200\nDATA {data}\n"
        body = rows.tobytes() if data == "binary" else "".join(" ".join(map(str, row)) + "\n" for row in rows).encode()
        path = tmp_path / "a.pcd"
        path.write_bytes(head.encode() + body)
    np.testing.assert_allclose(load_cloud(path).points, expected, atol=1e-6)


@pytest.mark.parametrize(("name", "library"), [("a.e57", "pye57"), ("a.las", "laspy"), ("a.laz", "lazrs")])
def test_a_format_without_its_library_names_the_extra(tmp_path, points, monkeypatch, name, library):
    BINARY[name](tmp_path / name, points)
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(Scan2FlexError, match=rf"{library}.*scan2flex_jax\[scans\]"):
        load_cloud(tmp_path / name)


@pytest.mark.parametrize("name", ["a.las", "a.laz", "a.e57", "a.npy", "a.npz", "a.ptx", "pypcd4.pcd"])
def test_a_damaged_file_is_one_sentence(tmp_path, points, name):
    """Cut anywhere, or with any byte changed: refused, or read as points."""
    path = DATA / name if name.endswith("pcd") else tmp_path / name
    if name in BINARY:
        BINARY[name](path, points)
    whole, rng = path.read_bytes(), np.random.default_rng(5)
    for k in range(24):
        data = bytearray(whole)
        if k % 2:
            data = data[: rng.integers(len(data))]
        else:
            data[rng.integers(400)] = rng.integers(256)
        bad = tmp_path / f"bad{path.suffix}"
        bad.write_bytes(data)
        try:
            assert load_cloud(bad).points.shape[1] == 3
        except Scan2FlexError as fault:
            assert bad.name in str(fault) and "\n" not in str(fault)


def test_a_packed_array_that_would_fill_the_memory_is_refused(tmp_path):
    with zipfile.ZipFile(tmp_path / "bomb.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("points.npy", bytes(200_000_000))
    with pytest.raises(Scan2FlexError, match="at most 5000000 points"):
        load_cloud(tmp_path / "bomb.npz")
