"""Frames of robots in the format: each convention against rotations multiplied out by hand, and one sentence for bad ones."""

import numpy as np
import pytest

from scan2flex_jax.convert import CONVENTIONS, clamp_of_angles, clamp_of_matrix, clamp_toml, read_frames
from scan2flex_jax.convert.frames import holds_frames
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.rod.boundary import rotation_of_quaternion

A, B, C = np.deg2rad([25.0, -40.0, 130.0])


def about(axis, angle):
    c, s = np.cos(angle), np.sin(angle)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    R = np.eye(3)
    R[i, i] = R[j, j] = c
    R[i, j], R[j, i] = -s, s
    return R


BY_HAND = {
    "kuka": about("z", A) @ about("y", B) @ about("x", C),
    "fanuc": about("z", C) @ about("y", B) @ about("x", A),
    "staubli": about("x", A) @ about("y", B) @ about("z", C),
    "kawasaki": about("z", A) @ about("y", B) @ about("z", C),
    "rpy": about("z", C) @ about("y", B) @ about("x", A),
    "XYX": about("x", A) @ about("y", B) @ about("x", C),
    "zyx": about("x", C) @ about("y", B) @ about("z", A),
}


@pytest.mark.parametrize("convention", BY_HAND)
def test_angles_mean_what_the_convention_says(convention):
    clamp = clamp_of_angles([1000.0, 0.0, -20.0], np.rad2deg([A, B, C]), convention, units="mm")
    np.testing.assert_allclose(rotation_of_quaternion(np.asarray(clamp.quaternion)), BY_HAND[convention], atol=1e-12)
    np.testing.assert_allclose(clamp.position, [1.0, 0.0, -0.02])
    again = clamp_of_angles([1.0, 0.0, -0.02], [A, B, C], convention, degrees=False)
    np.testing.assert_allclose(again.quaternion, clamp.quaternion, atol=1e-14)


def test_every_named_convention_is_checked_or_is_the_rotation_vector():
    assert set(CONVENTIONS) - set(BY_HAND) == {"rotvec"}
    clamp = clamp_of_angles([0, 0, 0], [0.0, 90.0, 0.0], "rotvec")
    np.testing.assert_allclose(rotation_of_quaternion(np.asarray(clamp.quaternion)), about("y", np.pi / 2), atol=1e-15)


@pytest.mark.parametrize("tangent", ["x", "y", "z", "-x", "-y", "-z"])
def test_the_named_axis_becomes_the_tangent(tangent):
    M = np.eye(4)
    M[:3, :3] = BY_HAND["kuka"]
    clamp = clamp_of_matrix(M, tangent=tangent)
    axis = (-1.0 if tangent[0] == "-" else 1.0) * BY_HAND["kuka"][:, "xyz".index(tangent[-1])]
    np.testing.assert_allclose(clamp.tangent, axis, atol=1e-12)
    assert np.linalg.det(rotation_of_quaternion(np.asarray(clamp.quaternion))) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda M: M.T, "transposed"),
        (lambda M: M @ np.diag([1, 1, -1, 1]), "right-handed"),
        (lambda M: 1.1 * M, "last row"),
        (lambda M: M @ np.diag([1.01, 1, 1, 1]), "no rotation"),
        (lambda M: M * np.nan, "finite"),
        (lambda M: M[:2], "4x4"),
    ],
)
def test_what_is_no_rigid_motion_is_refused(change, words):
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = BY_HAND["rpy"], [0.1, 0.2, 0.3]
    with pytest.raises(Scan2FlexError, match=words):
        clamp_of_matrix(change(M))


def test_bad_names_are_refused():
    with pytest.raises(Scan2FlexError, match="kuka"):
        clamp_of_angles([0, 0, 0], [0, 0, 0], "XXY")
    with pytest.raises(Scan2FlexError, match="unit 'yard'"):
        clamp_of_angles([0, 0, 0], [0, 0, 0], "rpy", units="yard")
    with pytest.raises(Scan2FlexError, match="axis 'w'"):
        clamp_of_matrix(np.eye(4), tangent="w")


def test_a_file_of_matrices_and_a_table_say_the_same(tmp_path):
    M = np.eye(4)
    M[:3, :3], M[:3, 3] = BY_HAND["kuka"], [500.0, -20.0, 300.0]
    rows = "\n".join(", ".join(f"{v:.12f}" for v in row) for row in M)
    (tmp_path / "flange.txt").write_text(
        f"# from the controller\nsag start:\n[[{rows.replace(chr(10), '],' + chr(10) + '[')}]]\n\nsag end\n{rows}\n"
    )
    angles = ",".join(f"{v:.12f}" for v in np.rad2deg([A, B, C]))
    table = f"pose,end,x,y,z,a,b,c\nsag,start,500,-20,300,{angles}\nsag,END,500,-20,300,{angles}\nfree,start,1,2,3,,,\n"
    (tmp_path / "clamps.csv").write_text(table)
    matrices = read_frames(tmp_path / "flange.txt", units="mm", tangent="x")
    rows = read_frames(tmp_path / "clamps.csv", units="mm", tangent="x", convention="kuka")
    assert list(matrices) == ["sag start", "sag end"]
    assert list(rows) == ["sag start", "sag end", "free start"]
    for name, clamp in matrices.items():
        np.testing.assert_allclose(rows[name].position, clamp.position)
        np.testing.assert_allclose(rows[name].quaternion, clamp.quaternion, atol=1e-9)
    assert rows["free start"].quaternion is None  # a ball joint
    assert "quaternion" not in clamp_toml(rows["free start"])


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no frame"),
        ("name,x,y,z,a,b,c\na,1,2,3,4,5,6\n", "convention"),
        ("name,x,y,z\na,1,2\n", "line 2.*columns"),
        ("name,x,y,z\na,1,2,nan\n", "line 2.*finite"),
        ("name,x,y,z\na,1,2,three\n", "line 2.*numbers"),
        ("name,x,y,z\na,1,2,3\na,1,2,3\n", "line 3.*own name"),
        ("x,y,z\n1,2,3\n", "header"),
        ("name,x,y,z,qw,qx,qy,qz\na,1,2,3,1,1,0,0\n", "line 2.*length"),
        ("sag start\n1 0 0 0\n0 1 0\n", "line 3.*four numbers"),
        ("sag start\n1 0 0 0\n0 1 0 0\n", "4x4"),
        ("nothing here\n", "no frame"),
    ],
)
def test_a_bad_file_is_one_sentence_that_names_the_line(tmp_path, text, words):
    file = tmp_path / "clamps.csv"
    file.write_text(text)
    with pytest.raises(Scan2FlexError, match=words) as found:
        read_frames(file)
    assert str(file) in str(found.value)
    assert "\n" not in str(found.value)


def test_a_frame_along_the_axes_has_plain_zeros():
    """A study is read by people: 7.9e-17 is rounding."""
    quaternion = clamp_of_angles([0.0, 0.0, 0.0], [0.0, 0.0, 90.0], "kuka", tangent="x").quaternion
    assert sorted(np.round(np.abs(quaternion), 12)) == pytest.approx([0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)])
    assert np.sum(quaternion == 0.0) == 2


HALF = np.sqrt(0.5)
PRINTED = {
    "ur": "plane_start: p[0.6, 0.0, 0.5, 0.0, 1.5707963267948966, 0.0]\nplane_end = p[0.7, 0, 0.5, 0, 0, 0]\n",
    "kuka": "DECL E6POS plane_start={X 600.0,Y 0.0,Z 500.0,A 0.0,B 90.0,C 0.0,S 6,T 27,E1 0.0}\n"
    "DECL E6POS plane_end={X 700,Y 0,Z 500,A 0,B 0,C 0}\n",
    "fanuc": "plane start\nP[1]{\n   GP1:\n    UF : 0, UT : 1,\n    X =   600.000  mm,  Y =  0.000  mm,  Z =   500.000  mm,\n"
    "    W =     0.000 deg,  P =    90.000 deg,  R =     0.000 deg\n};\n",
    "abb": "CONST robtarget plane_start:=[[600,0,500],[0.7071068,0,0.7071068,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
    "CONST robtarget plane_end:=[[700,0,500],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n",
    "ros": "# plane start\nposition:\n  x: 0.6\n  y: 0.0\n  z: 0.5\n"
    "orientation:\n  x: 0.0\n  y: 0.7071068\n  z: 0.0\n  w: 0.7071068\n"
    "---\n# plane end\nposition:\n  x: 0.7\n  y: 0.0\n  z: 0.5\norientation:\n  x: 0\n  y: 0\n  z: 0\n  w: 1\n",
}


@pytest.mark.parametrize("robot", PRINTED)
def test_poses_as_robots_print_them(tmp_path, robot):
    """Of a flange 0.6 m ahead that is turned by 90 degrees about y."""
    (tmp_path / "a.txt").write_text(PRINTED[robot])
    assert holds_frames(tmp_path / "a.txt")
    found = read_frames(tmp_path / "a.txt")
    if robot == "fanuc":
        (found,) = found.values()  # P[1] is its name there
    else:
        assert list(found) == ["plane start", "plane end"]
        np.testing.assert_allclose(found["plane end"].position, [0.7, 0.0, 0.5], atol=1e-12)
        np.testing.assert_allclose(found["plane end"].quaternion, [1.0, 0.0, 0.0, 0.0], atol=1e-12)
        found = found["plane start"]
    np.testing.assert_allclose(found.position, [0.6, 0.0, 0.5], atol=1e-12)
    np.testing.assert_allclose(found.quaternion, [HALF, 0.0, HALF, 0.0], atol=1e-7)


@pytest.mark.parametrize(("convention", "row"), [("scalar-first", "1,2,3,0.6,0,0.8,0"), ("scalar-last", "1,2,3,0,0.8,0,0.6")])
def test_numbered_quaternions_need_their_convention(tmp_path, convention, row):
    (tmp_path / "a.csv").write_text(f"name,x,y,z,q1,q2,q3,q4\na start,{row}\n")
    with pytest.raises(Scan2FlexError, match="q1,q2,q3,q4 need a convention: name scalar-first"):
        read_frames(tmp_path / "a.csv")
    found = read_frames(tmp_path / "a.csv", convention=convention)["a start"]
    np.testing.assert_allclose(found.quaternion, [0.6, 0.0, 0.8, 0.0])


def test_a_matrix_in_nine_columns(tmp_path):
    head = "name,r11,r12,r13,r21,r22,r23,r31,r32,r33,x,y,z\n"
    (tmp_path / "a.csv").write_text(head + "a start,0,0,1,0,1,0,-1,0,0,600,0,500\n")
    np.testing.assert_allclose(read_frames(tmp_path / "a.csv", units="mm")["a start"].quaternion, [HALF, 0.0, HALF, 0.0])
    (tmp_path / "b.csv").write_text(head + "a start,0,0,2,0,2,0,-2,0,0,600,0,500\n")
    with pytest.raises(Scan2FlexError, match=r"b\.csv: line 2: .*no rotation"):
        read_frames(tmp_path / "b.csv")
