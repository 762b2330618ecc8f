"""Lines of other programs: rows in the order of edges, parents and segments, messages of ROS, frames, and points in a plane.

Every file holds the same curve, in the forms in which users brought it; what holds no single curve is refused.
"""

import json

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from scan2flex_jax.convert import measured_files, new_study, read_foreign_curve, read_frames
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.scan.cloud import load_cloud

T = np.linspace(0.0, 1.0, 9)
POINTS = np.column_stack([0.6 * T, np.zeros(9), -0.3 * np.sin(np.pi * T)]).round(6)  # m
LENGTH = float(np.sum(np.linalg.norm(np.diff(POINTS, axis=0), axis=1)))
MIXED = np.array([4, 8, 0, 6, 2, 7, 1, 5, 3])  # places of the points in a shuffled file
AT = np.argsort(MIXED)
ROWS = POINTS[MIXED]


def text(points, mark=" "):
    return "\n".join(mark.join(f"{v:.6f}" for v in p) for p in points)


def xyz(p, indent, axes="xyz"):
    return "\n".join(f"{' ' * indent}{c}: {v}" for c, v in zip(axes, p, strict=True))


def pose(p, indent):
    blank = " " * indent
    turn = xyz([0.0, 0.0, 0.0, 1.0], indent + 2, "xyzw")
    return f"{blank}position:\n{xyz(p, indent + 2)}\n{blank}orientation:\n{turn}"


def marker(points, turn=(0.0, 0.0, 0.0, 1.0), shift=(0.0, 0.0, 0.0), kind=4):
    place = f"pose:\n  position:\n{xyz(shift, 4)}\n  orientation:\n{xyz(turn, 4, 'xyzw')}\nscale:\n{xyz([0.01, 0, 0], 2)}"
    listed = "\n".join(f"  -\n{xyz(p, 4)}" for p in points)
    return f"header:\n  frame_id: camera\ntype: {kind}\n{place}\npoints:\n{listed}\ncolors: []\ntext: ''\n---\n"


TURN = Rotation.from_euler("zyx", [30.0, -20.0, 70.0], degrees=True)
SHIFT = np.array([0.1, -0.2, 0.3])
SEGMENTS = np.stack([POINTS[:-1], POINTS[1:]], axis=1)[[3, 0, 7, 5, 1, 6, 2, 4]]
WIDE = ",".join(f"{c}{k}" for k in range(1, 10) for c in "xyz")
FRAMES = POINTS + 1e-4 * np.arange(-2, 3)[:, None, None]
MARKUPS = {
    "markups": [{
        "coordinateSystem": "LPS", "coordinateUnits": "mm",
        "controlPoints": [{"id": "a", "position": p, "orientation": [1, 0, 0, 0]} for p in (1e3 * POINTS).tolist()],
    }]
}  # fmt: skip
MOVING = (POINTS + 0.05 * np.arange(5)[:, None, None]).reshape(5, -1)
FILES = {
    "slicer.mrk.json": json.dumps(MARKUPS),
    "faces.json": json.dumps({"faces": [[0, 1, 2], [2, 3, 4]], "vertices": POINTS.tolist()}),
    "skeleton.swc": "# id type x y z radius parent\n" + "\n".join(
        f"{k + 1} 0 {text([p])} 0.004 {AT[MIXED[k] - 1] + 1 if MIXED[k] else -1}" for k, p in enumerate(ROWS)),
    "beam.inp": "*HEADING\n*NODE, NSET=ALL\n" + "\n".join(f"{k + 5}, {text([p], ', ')}" for k, p in enumerate(ROWS))
    + "\n*ELEMENT, TYPE=B31\n" + "\n".join(f"{k}, {AT[k] + 5}, {AT[k + 1] + 5}" for k in range(8)) + "\n*END STEP\n",
    "spline.csv": "StartCurve\n" + text(1e3 * POINTS, " ; ") + "\nEndCurve\nEnd\n",
    "skeleton.cgal": "\n".join(f"2 {text(pair.reshape(1, -1))}" for pair in SEGMENTS),
    "whole.cgal": f"9 {text(POINTS.reshape(1, -1))}\n",
    "lines.obj": "".join(f"v {row}\n" for row in text(ROWS).splitlines()) + "l " + " ".join(str(k + 1) for k in AT) + "\n",
    "lines.vtk": "# vtk DataFile Version 3.0\nc\nASCII\nDATASET POLYDATA\nPOINTS 9 double\n" + text(ROWS) + "\nLINES 8 24\n"
    + "\n".join(f"2 {AT[k]} {AT[k + 1]}" for k in (3, 0, 7, 5, 1, 6, 2, 4)) + "\n",
    "lines5.vtk": "# vtk DataFile Version 5.1\nc\nASCII\nDATASET POLYDATA\nPOINTS 9 double\n" + text(ROWS)
    + "\nLINES 2 9\nOFFSETS vtktypeint64\n0 9\nCONNECTIVITY vtktypeint64\n" + " ".join(map(str, AT)) + "\n",
    "lines.dxf": "0\nSECTION\n2\nENTITIES\n" + "".join(
        f"0\nLINE\n10\n{a[0]}\n20\n{a[1]}\n30\n{a[2]}\n11\n{b[0]}\n21\n{b[1]}\n31\n{b[2]}\n" for a, b in SEGMENTS)
    + "0\nENDSEC\n",
    "posearray.yaml": "header:\n  frame_id: base\nposes:\n" + "\n".join("-" + pose(p, 2)[1:] for p in POINTS) + "\n",
    "path.yaml": "header:\n  seq: 1\nposes: \n" + "\n".join(
        f"  - \n    header:\n      seq: {k}\n    pose: \n{pose(p, 6)}" for k, p in enumerate(POINTS)) + "\n---\n",
    "marker.yaml": marker(POINTS),
    "placed.yaml": marker(TURN.inv().apply(POINTS - SHIFT), TURN.as_quat(), SHIFT),
    "unset.yaml": marker(POINTS, (0.0, 0.0, 0.0, 0.0)),
    "segments.yaml": marker(SEGMENTS.reshape(-1, 3), kind=5),
    "flow.yaml": "points: [" + ", ".join("{x: %s, y: %s, z: %s}" % tuple(p) for p in POINTS) + "]\n",  # noqa: UP031
    "topic.csv": "%time,field.header.frame_id," + ",".join(f"field.poses{k}.position.{c}" for k in range(9) for c in "xyz")
    + "\n16,base," + text(POINTS.reshape(1, -1), ",") + "\n",
    "wide.csv": f"{WIDE}\n" + text(FRAMES.reshape(5, -1), ",") + "\n",
    "wide_mm.csv": ";".join(f"m{k}_{c} [mm]" for k in range(9) for c in "xyz") + "\n"
    + text(1e3 * FRAMES.reshape(5, -1), ";").replace(".", ",") + "\n",
    "mixed.csv": "s,x,y,z\n" + text(np.column_stack([LENGTH * T, POINTS])[MIXED], ",") + "\n",
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_every_line_is_read_in_its_order(tmp_path, name):
    (tmp_path / name).write_text(FILES[name])
    found = read_foreign_curve(tmp_path / name).curve
    turned = found.points if np.linalg.norm(found.points[0]) < 0.1 else found.points[::-1]
    np.testing.assert_allclose(turned, POINTS, atol=2e-6)
    (pose,) = measured_files(tmp_path)
    assert pose.curve == tmp_path / name and pose.scan is None


def edged_ply(form):
    """The shuffled points and their edges as a PLY, in text or binary."""
    head = f"ply\nformat {form} 1.0\nelement vertex 9\n" + "".join(f"property double {c}\n" for c in "xyz")
    head += "element edge 8\nproperty int vertex1\nproperty int vertex2\nend_header\n"
    edges = np.column_stack([AT[:-1], AT[1:]])[[3, 0, 7, 5, 1, 6, 2, 4]].astype("<i4")
    if form == "ascii":
        return (head + text(ROWS) + "\n" + "\n".join(f"{a} {b}" for a, b in edges) + "\n").encode()
    return head.encode() + ROWS.astype("<f8").tobytes() + edges.tobytes()


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_the_edges_of_a_ply(tmp_path, form):
    (tmp_path / "a.ply").write_bytes(edged_ply(form))
    trimesh.PointCloud(POINTS).export(tmp_path / "cloud.ply")
    found = read_foreign_curve(tmp_path / "a.ply").curve.points
    np.testing.assert_allclose(found if found[0, 0] < 0.3 else found[::-1], POINTS, atol=1e-9)
    line, cloud = measured_files(tmp_path)
    assert (line.curve, line.scan) == (tmp_path / "a.ply", None)
    assert (cloud.curve, cloud.scan) == (None, tmp_path / "cloud.ply")


REFUSED = {
    "branch.swc": ("1 0 0 0 0 1 -1\n2 0 1 0 0 1 1\n3 0 2 0 0 1 2\n4 0 1 1 0 1 2\n", "branches at"),
    "pieces.cgal": ("2 0 0 0 1 0 0\n2 2 0 0 3 0 0\n", "several lines"),
    "closed.obj": ("v 0 0 0\nv 1 0 0\nv 0 1 0\nl 1 2 3 1\n", "closed line"),
    "two.yaml": (marker(POINTS) + marker(POINTS), "several messages"),
    "lost.yaml": (marker(POINTS).replace("    z: 0.0\n  -", "  -", 1).replace("y: 0.0\n    z: -0.3", "y: 0.0"), "damaged"),
    "two.json": (json.dumps([{"points": POINTS.tolist()}, {"points": POINTS.tolist()}]), "several lines"),
    "none.json": ('{"a": [1, 2]}', "no list of points"),
    "twice.csv": ("StartCurve\n1;2;3\nEndCurve\nStartCurve\n1;2;3\nEndCurve\n", "several lines"),
    "open.csv": ("StartCurve\n1;2;3\n", "damaged"),
    "gone.inp": ("*NODE\n1, 0, 0, 0\n2, 1, 0, 0\n*ELEMENT\n1, 1, 3\n", "damaged"),
    "moving.csv": (f"{WIDE}\n" + text(MOVING, ","), "not at rest.*--frame"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_holds_no_single_line_is_refused(tmp_path, name):
    content, words = REFUSED[name]
    (tmp_path / name).write_text(content)
    with pytest.raises(Scan2FlexError, match=words):
        read_foreign_curve(tmp_path / name)


PLANE = {
    "wpd.csv": text(POINTS[:, [0, 2]], ", "),
    "tracker.txt": "mass A\t\t\nt\tx\ty\n" + text(np.column_stack([0.033 * np.arange(9), POINTS[:, [0, 2]]]), "\t"),
    "imagej.csv": " ,X,Y\n" + "\n".join(f"{k + 1},{x},{z}" for k, (x, z) in enumerate(POINTS[:, [0, 2]])),
    "numbers.csv": "\n".join(f"{k + 1},{x},{z}" for k, (x, z) in enumerate(POINTS[:, [0, 2]])),
    "german.csv": text(POINTS[:, [0, 2]], ";").replace(".", ","),
}


@pytest.mark.parametrize("name", PLANE)
def test_points_in_a_plane_are_asked_for_it(tmp_path, name):
    (tmp_path / name).write_text(PLANE[name] + "\n")
    with pytest.raises(Scan2FlexError, match=r"two coordinates.*--columns x,z"):
        read_foreign_curve(tmp_path / name)
    found = read_foreign_curve(tmp_path / name, columns="x,z")
    np.testing.assert_allclose(found.curve.points, POINTS, atol=2e-6)
    assert "in the plane y = 0" in found.notes
    down = read_foreign_curve(tmp_path / name, columns="x,-z").curve.points
    np.testing.assert_allclose(down, POINTS * [1, 1, -1], atol=2e-6)


def test_arrays_with_a_coordinate_a_row_and_of_frames(tmp_path):
    arrays = {"n": POINTS, "t": POINTS.T, "f": FRAMES, "ft": FRAMES.swapaxes(1, 2), "s": np.column_stack([LENGTH * T, POINTS])}
    for name, array in arrays.items():
        np.save(tmp_path / f"{name}.npy", array)
        np.testing.assert_allclose(read_foreign_curve(tmp_path / f"{name}.npy").curve.points, POINTS, atol=1e-9)
    np.testing.assert_allclose(load_cloud(tmp_path / "t.npy").points, POINTS)
    np.save(tmp_path / "plane.npy", POINTS[:, [0, 2]])
    np.testing.assert_allclose(read_foreign_curve(tmp_path / "plane.npy", columns="x,z").curve.points, POINTS)
    moving = POINTS + np.arange(5)[:, None, None]
    for name, array in {"square": POINTS[:3], "moving": moving, "deep": FRAMES[None], "words": np.array(["a"])}.items():
        np.save(tmp_path / f"{name}.npy", array)
        with pytest.raises(Scan2FlexError, match=r"shape|not at rest"):
            read_foreign_curve(tmp_path / f"{name}.npy")


def test_the_numbers_of_rows_are_no_coordinate_of_a_scan(tmp_path):
    cloud = np.random.default_rng(0).uniform(-1, 1, (400, 3)).round(6)
    numbered = np.column_stack([np.arange(400), cloud])
    (tmp_path / "a.csv").write_text("\n".join(f"{k:.0f},{x},{y},{z}" for k, x, y, z in numbered))
    np.testing.assert_allclose(load_cloud(tmp_path / "a.csv").points, cloud)
    (tmp_path / "b.csv").write_text("\n".join(f"{k:.0f},{x},{y}" for k, x, y, _ in numbered))
    with pytest.raises(Scan2FlexError, match="numbers of its rows"):
        load_cloud(tmp_path / "b.csv")


def test_clamps_state_their_own_unit(tmp_path):
    rows = "sag start,0,0,0,0,90,0\nsag end,600,0,0,0,90,0\n"
    (tmp_path / "a.csv").write_text(f"name,x [mm],y [mm],z [mm],a [deg],b [deg],c [deg]\n{rows}")
    (tmp_path / "b.csv").write_text("name,x (mm),y (mm),z (mm),a [rad],b [rad],c [rad]\n" + rows.replace("90", f"{np.pi / 2}"))
    for name in ("a.csv", "b.csv"):
        found = read_frames(tmp_path / name, units="cm", convention="rpy")
        np.testing.assert_allclose(found["sag end"].position, [0.6, 0, 0])
        np.testing.assert_allclose(found["sag end"].tangent, [1, 0, 0], atol=1e-12)
    (tmp_path / "c.csv").write_text(f"name,x [mm],y [cm],z [mm],a,b,c\n{rows}")
    with pytest.raises(Scan2FlexError, match="units that are unknown or differ"):
        read_frames(tmp_path / "c.csv", convention="rpy")


@pytest.mark.parametrize("factor", [0.5, 1.15])
def test_a_curve_that_gives_the_clamps_is_as_long_as_the_cable(tmp_path, factor):
    np.save(tmp_path / "sag.npy", POINTS.T)
    new_study(tmp_path, measured_files(tmp_path), length=LENGTH, length_density=0.2, clamps=None)
    with pytest.raises(Scan2FlexError, match=r"sag.npy: its curve is 0.875.* from end to end, .*give the clamps"):
        new_study(tmp_path, measured_files(tmp_path), length=LENGTH / factor, length_density=0.2, clamps=None)
