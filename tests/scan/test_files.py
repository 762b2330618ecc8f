"""Clouds in the formats that the study promises: points of XYZ, OBJ and PLY as they are, meshes of OBJ and STL sampled."""

import os

import numpy as np
import pytest
import trimesh

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.scan import extract, load_cloud, shapes, tube_mesh
from scan2flex_jax.scan.cloud import MESH_SAMPLES, normals_at
from scan2flex_jax.scan.coarse_curve import axis_votes
from scan2flex_jax.study.scans import scan_facts
from tests.outputs import scenes
from tests.scan.truth import ends, errors

LENGTH, RADIUS = 1.0, 0.012


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


@pytest.mark.slow
def test_a_curve_comes_out_of_an_stl(tmp_path):
    curve = shapes.FAMILIES["loop"](LENGTH, RADIUS)
    tube_mesh(curve, RADIUS).export(tmp_path / "cable.stl")
    start, end = ends(curve)
    found = extract(load_cloud(tmp_path / "cable.stl"), RADIUS, length=LENGTH, start=start, end=end)
    rms, _, length = errors(found, curve, RADIUS, 2)
    assert rms < 2e-4
    assert abs(length) < 0.005


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


def test_a_scan_without_finite_points_has_none(tmp_path):
    (tmp_path / "a.xyz").write_text("nan 0 0\n0 inf 0\n")
    with pytest.raises(Scan2FlexError, match="holds no points"):
        scan_facts(tmp_path / "a.xyz")


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


TABLES = ["0, 1, 2\n3, 4, 5\n", "0,1,2\n3,4,5", "# x y z\n0 1 2 255 0 0\n\n3 4 5 0 0 255\n", "\ufeff0 1 2\r\n3 4 5\r\n"]


@pytest.mark.parametrize("text", TABLES)
def test_tables_of_points_as_others_write_them(tmp_path, text):
    (tmp_path / "a.xyz").write_text(text, "utf-8")
    np.testing.assert_array_equal(load_cloud(tmp_path / "a.xyz").points, np.arange(6.0).reshape(2, 3))
