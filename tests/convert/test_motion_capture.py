"""Exports of motion-capture systems: markers by name, means over frames, lost markers, rigid bodies as clamps."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from scan2flex_jax.cli.app import app
from scan2flex_jax.convert import frames_of_bodies, measured_files, read_arc_lengths, read_foreign_curve
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study import load_study

T = np.linspace(0.0, 1.0, 6)
MARKERS = 1e3 * np.column_stack([0.9 * T, 0.05 * np.sin(3 * T), -0.2 * np.sin(np.pi * T)])  # mm
NAMES = [f"m{k + 1}" for k in range(6)]
TURN = Rotation.from_euler("y", 90, degrees=True)  # z along the x axis
BODIES = {"start": (MARKERS[0], TURN), "end": (MARKERS[-1], TURN)}


def frames():
    """Three frames that scatter by 1 mm about the markers; m3 is lost in the second."""
    out = MARKERS + np.array([-1.0, 0.0, 1.0])[:, None, None]
    out[1, 2] = np.nan
    return out


def cells(row):
    return ",".join("" if isinstance(x, float) and np.isnan(x) else str(x) for x in row)


def motive(points, bodies=()):
    kinds, names, axes, places = ["", "Type"], ["", "Name"], ["Frame", "Time (Seconds)"], ["", ""]
    for name in bodies:
        kinds += ["Rigid Body"] * 7
        names += [name] * 7
        places += ["Rotation"] * 4 + ["Position"] * 3
        axes += list("XYZWXYZ")
    for name in NAMES:
        kinds += ["Marker"] * 3
        names += [f"cable:{name}"] * 3
        places += ["Position"] * 3
        axes += list("XYZ")
    rows = [",".join(["Format Version", "1.23", "Take Name", "t", "Length Units", "Millimeters"]), ""]
    rows += [cells(row) for row in (kinds, names, places, axes)]
    for k, frame in enumerate(points):
        held = [x for name in bodies for x in (*BODIES[name][1].as_quat(), *BODIES[name][0])]
        rows.append(cells([k, 0.01 * k, *held, *frame.ravel()]))
    return "\n".join(rows) + "\n"


def vicon(points):
    names = ",".join(["", "", *(f"Cable:{name},," for name in NAMES)])
    rows = ["Trajectories", "100", names, ",".join(["Frame", "Sub Frame", *["X,Y,Z"] * 6]), ",".join(["", "", *["mm"] * 18])]
    return "\n".join([*rows, *(cells([k + 1, 0, *frame.ravel()]) for k, frame in enumerate(points))]) + "\n"


def c3d(path, points):
    ezc3d = pytest.importorskip("ezc3d")
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [100.0]
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["parameters"]["POINT"]["LABELS"]["value"] = [f"Cable:{name}" for name in NAMES]
    file["data"]["points"] = np.ones((4, 6, len(points)))
    file["data"]["points"][:3] = np.moveaxis(points, 2, 0).swapaxes(1, 2)
    file.write(str(path))


def written(folder, kind):
    path = folder / ("pose.c3d" if kind == "c3d" else "pose.csv")
    if kind == "c3d":
        c3d(path, frames())
    else:
        path.write_text({"motive": motive, "vicon": vicon}[kind](frames()))
    return path


@pytest.mark.parametrize("kind", ["motive", "vicon", "c3d"])
def test_markers_are_means_over_the_frames_in_which_they_were_seen(tmp_path, kind):
    found = read_foreign_curve(written(tmp_path, kind))
    np.testing.assert_allclose(found.curve.points, 1e-3 * MARKERS, atol=1e-7)
    assert found.curve.arc_length is None
    assert any("means of 3 frames" in note and "0.8" in note for note in found.notes)  # sqrt(2/3) mm
    assert any("lost in some frames: m3" in note for note in found.notes)


@pytest.mark.parametrize("kind", ["motive", "vicon", "c3d"])
def test_one_frame_without_the_marker_that_was_lost_in_it(tmp_path, kind):
    found = read_foreign_curve(written(tmp_path, kind), frame=1)
    np.testing.assert_allclose(found.curve.points, 1e-3 * np.delete(MARKERS, 2, axis=0), atol=1e-7)
    assert any(note == "lost and left out: m3" for note in found.notes)


def test_arc_lengths_by_name(tmp_path):
    (tmp_path / "arc.csv").write_text("name,s\nm2,200\nm1,5\nm6,990\n")
    arcs = read_arc_lengths(tmp_path / "arc.csv", units="mm")
    found = read_foreign_curve(written(tmp_path, "motive"), arc_lengths=arcs)
    np.testing.assert_allclose(found.curve.arc_length, [0.005, 0.2, 0.99])
    np.testing.assert_allclose(found.curve.points, 1e-3 * MARKERS[[0, 1, 5]], atol=1e-7)
    assert any("left out: m3, m4, m5" in note for note in found.notes)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"frame": 3}, "frame 3 is not among its 3"),
        ({"units": "m"}, "it states mm, but the given unit is m"),
        ({"arc_lengths": {"a1": 0.1}}, r"none of its markers \(m1, m2.*has an arc length"),
    ],
)
def test_doubt_is_one_sentence(tmp_path, options, words):
    with pytest.raises(Scan2FlexError, match=words):
        read_foreign_curve(written(tmp_path, "motive"), **options)


@pytest.mark.parametrize("options", [{"frame": 0}, {"arc_lengths": {"m1": 0.1}}])
def test_frames_and_names_of_another_file_are_not_ignored(tmp_path, options):
    (tmp_path / "a.csv").write_text("x,y,z\n0,0,0\n1,0,0\n")
    with pytest.raises(Scan2FlexError, match="no motion capture"):
        read_foreign_curve(tmp_path / "a.csv", **options)


@pytest.mark.parametrize(("text", "words"), [("m1,0.1\n", "header"), ("name,s\nm1,half\n", "line 2.*a name and a number")])
def test_a_damaged_table_of_arc_lengths(tmp_path, text, words):
    (tmp_path / "arc.csv").write_text(text)
    with pytest.raises(Scan2FlexError, match=words):
        read_arc_lengths(tmp_path / "arc.csv")


def test_a_damaged_c3d_is_one_sentence(tmp_path):
    pytest.importorskip("ezc3d")
    (tmp_path / "a.c3d").write_bytes(b"no C3D")
    with pytest.raises(Scan2FlexError, match=r"a\.c3d: it cannot be read as a C3D file") as fault:
        read_foreign_curve(tmp_path / "a.c3d")
    assert "\n" not in str(fault.value)


def test_rigid_bodies_are_clamps(tmp_path):
    (tmp_path / "sag.csv").write_text(motive(frames(), ("start", "end")))
    found = frames_of_bodies(measured_files(tmp_path))
    assert set(found) == {"sag start", "sag end"}
    np.testing.assert_allclose(found["sag end"].position, 1e-3 * MARKERS[-1], atol=1e-9)
    np.testing.assert_allclose(found["sag start"].tangent, [1.0, 0.0, 0.0], atol=1e-9)


def test_a_folder_of_takes_becomes_a_study(tmp_path):
    """With the clamps of the takes, and markers at their arc lengths."""
    for name in ("sag", "side"):
        (tmp_path / f"{name}.csv").write_text(motive(frames(), ("start", "end")))
    (tmp_path / "arc.csv").write_text("name,s\n" + "".join(f"{n},{1000 * t}\n" for n, t in zip(NAMES, T, strict=True)))
    command = ["new", str(tmp_path), "--length", "1.0", "--density", "0.1", "--markers", "--units", "mm"]
    said = CliRunner().invoke(app, [*command, "--arc-lengths", str(tmp_path / "arc.csv")])
    assert said.exit_code == 0, said.output
    study = load_study(tmp_path)
    assert [pose.name for pose in study.poses] == ["sag", "side"]
    np.testing.assert_allclose(study.poses[0].markers.arc_length, T)
    np.testing.assert_allclose(study.poses[0].end.position, 1e-3 * MARKERS[-1], atol=1e-9)
