"""Centre curves as other tools write them: every dialect gives the same points, and doubt is one sentence."""

import json

import numpy as np
import pytest

from scan2flex_jax.convert import length_unit, quantity, read_foreign_curve
from scan2flex_jax.errors import Scan2FlexError

T = np.linspace(0, 1, 12)
POINTS = np.column_stack([0.6 * T, 0.1 * T**2, -0.3 * np.sin(np.pi * T)])  # m
ARC = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(POINTS, axis=0), axis=1))]


def lines(table, mark, decimal="."):
    return "\n".join(mark.join(f"{v:.6f}".replace(".", decimal) for v in row) for row in table) + "\n"


@pytest.mark.parametrize(
    ("text", "units", "columns"),
    [
        (lines(POINTS, ","), None, None),
        ("x,y,z\n" + lines(POINTS, ","), None, None),
        ("X [mm];Y [mm];Z [mm]\n" + lines(1e3 * POINTS, ";", ","), None, None),
        ('"Points:0","Points:1","Points:2"\n' + lines(POINTS, ","), None, None),
        ("//X Y Z\n" + lines(POINTS, " "), None, None),
        ("# a tool\n# of 2026\npos_x\tpos_y\tpos_z\n" + lines(POINTS, "\t"), None, None),
        ("index,z_mm,y_mm,x_mm,colour\n" + lines(np.column_stack([T, 1e3 * POINTS[:, ::-1], T]), ","), None, None),
        (lines(np.column_stack([np.arange(12.0), 1e3 * POINTS]), ","), "mm", None),
        (lines(np.column_stack([T, POINTS[:, [2, 0, 1]]]), ";"), None, "-,z,x,y"),
        (lines(POINTS, ";", ","), None, None),
        (lines(POINTS, "  ", ","), None, None),
        (lines(POINTS / 0.0254, ", "), "in", None),
        (lines(np.repeat(POINTS, 2, axis=0), ","), None, None),
        ("x,y,z,\n" + lines(POINTS, ",").replace("\n", ",\n"), None, None),
        ("N;Coord;Length;Size\n" + "".join(f"{i};{row};0,5;0\n" for i, row in enumerate(lines(POINTS, " ", ",").splitlines())),
         None, None),
        ("".join(f"X {x:.6f} Y {y:.6f} Z {z:.6f}\n" for x, y, z in POINTS), None, None),
        ("".join(f"{{{x:.6f}, {y:.6f}, {z:.6f}}}\n" for x, y, z in POINTS), None, None),
        ("".join(f"{x:.4f}mm {y:.4f}mm {z:.4f}mm\n" for x, y, z in 1e3 * POINTS), None, None),
        ("Point #;X;Y;Z\n" + "".join(f"P{i};{row}\n" for i, row in enumerate(lines(POINTS, ";").splitlines())), None, None),
        (f"{len(POINTS)}\n" + lines(POINTS, " "), None, None),
        (lines(np.hstack([POINTS, np.full((12, 3), 200)]), " "), None, None),
        ("x,y,z\n,,\n" + lines(POINTS, ",") + "nan,nan,nan\n", None, None),
        (json.dumps(POINTS.round(6).tolist()), None, None),
        (json.dumps({"name": "cable", "points": [{"x": x, "y": y, "z": z} for x, y, z in POINTS.round(6)]}), None, None),
        ("LINESTRING Z (" + lines(POINTS, " ").strip().replace("\n", ", ") + ")\n", None, None),
        ("# vtk DataFile Version 3.0\nc\nASCII\nDATASET POLYDATA\nPOINTS 12 float\n" + lines(POINTS, " ")
         + "LINES 1 13\n12 0 1 2 3 4 5 6 7 8 9 10 11\n", None, None),
        ("# polyline\n" + "".join(f"v {row}\n" for row in lines(POINTS, " ").splitlines())
         + "l 1 2 3 4 5 6\nl 12 11 10 9 8 7 6\n", None, None),
        ("0\nSECTION\n2\nENTITIES\n0\nPOLYLINE\n10\n0\n20\n0\n30\n0\n"
         + "".join(f"0\nVERTEX\n10\n{x:.6f}\n20\n{y:.6f}\n30\n{z:.6f}\n" for x, y, z in POINTS) + "0\nENDSEC\n0\nEOF\n",
         None, None),
    ],
    ids=[
        "plain", "format", "german", "paraview", "cloudcompare", "tabs", "order", "index", "given", "semicolon", "blanks",
        "inch", "repeated", "trailing", "artec", "gom", "rhino", "solidworks", "labels", "count", "colours", "holes", "json",
        "objects", "wkt", "vtk", "obj", "dxf",
    ],
)  # fmt: skip
def test_every_dialect_gives_the_same_points(tmp_path, text, units, columns):
    file = tmp_path / "curve.txt"
    file.write_text(text)
    found = read_foreign_curve(file, units=units, columns=columns)
    np.testing.assert_allclose(found.curve.points, POINTS, atol=2e-6)
    assert found.curve.arc_length is None


def test_points_out_of_order_are_said(tmp_path):
    (tmp_path / "a.csv").write_text(lines(POINTS[[3, 11, 0, 7, 5, 9, 1, 10, 2, 8, 4, 6]], ","))
    (tmp_path / "b.csv").write_text(lines(POINTS, ","))
    assert any("sort them along the cable" in note for note in read_foreign_curve(tmp_path / "a.csv").notes)
    assert not any("sort them" in note for note in read_foreign_curve(tmp_path / "b.csv").notes)


def test_thousands_and_decimal_commas(tmp_path):
    (tmp_path / "a.csv").write_text("x;y;z\n1.200,50;0,09;-0,08\n12.345.678,00;-0,28;-11,15\n")
    found = read_foreign_curve(tmp_path / "a.csv", units="mm").curve.points
    np.testing.assert_allclose(found, [[1.2005, 9e-5, -8e-5], [12345.678, -2.8e-4, -0.01115]])


def test_utf_16_latin_1_and_an_array(tmp_path):
    (tmp_path / "a.txt").write_text("x\ty\tz\n" + lines(POINTS, "\t"), "utf-16")
    (tmp_path / "b.txt").write_text("# Länge in m\n" + lines(POINTS, "\t"), "latin-1")
    np.save(tmp_path / "c.npy", POINTS)
    for name in ("a.txt", "b.txt", "c.npy"):
        np.testing.assert_allclose(read_foreign_curve(tmp_path / name).curve.points, POINTS, atol=2e-6)


@pytest.mark.parametrize("header", ["", "arc length (mm),x (mm),y (mm),z (mm)\n"])
def test_arc_length_is_seen_by_its_header_or_its_numbers(tmp_path, header):
    file = tmp_path / "curve.csv"
    file.write_text(header + lines(1e3 * np.column_stack([ARC, POINTS]), ","))
    found = read_foreign_curve(file, units="mm")
    np.testing.assert_allclose(found.curve.arc_length, ARC, atol=2e-6)
    np.testing.assert_allclose(found.curve.points, POINTS, atol=2e-6)


@pytest.mark.parametrize(
    ("text", "units", "columns", "words"),
    [
        ("", None, None, "no line"),
        ("a,b,c\n", None, None, "no line"),
        (lines(np.column_stack([T[::-1], POINTS]), ","), None, None, "say what they are"),
        ("a,b,c\n" + lines(POINTS, ","), None, None, "names no x, y, z"),
        ("x_mm,y_mm,z_m\n" + lines(POINTS, ","), None, None, "several units"),
        ("x_mm,y_mm,z_mm\n" + lines(POINTS, ","), "m", None, "it states mm"),
        (lines(POINTS, ",") + "1,2\n", None, None, "point 13.*3 numbers"),
        (lines(POINTS, ",") + "1,2,inf\n", None, None, "point 13.*finite"),
        (lines(POINTS[:1], ","), None, None, "at least 2"),
        (lines(POINTS, ","), None, "x,y", "got 2 names for 3 columns"),
        (lines(POINTS, ","), None, "x,x,z", "name x, y, z"),
        (lines(POINTS, ","), None, "s,x,y,z", "4 names for 3 columns"),
        (lines(POINTS, ","), "parsec", None, "unit 'parsec'"),
    ],
)
def test_doubt_is_one_sentence(tmp_path, text, units, columns, words):
    file = tmp_path / "curve.csv"
    file.write_text(text)
    with pytest.raises(Scan2FlexError, match=words) as found:
        read_foreign_curve(file, units=units, columns=columns)
    assert "\n" not in str(found.value)


def test_quantities_with_units():
    assert quantity("900 mm", "length") == pytest.approx(0.9)
    assert quantity("0,9", "length") == pytest.approx(0.9)
    assert quantity("336 g/m", "length density") == pytest.approx(0.336)
    assert quantity("1 lb/ft", "length density") == pytest.approx(0.45359237 / 0.3048)
    assert quantity("302 g", "mass") == pytest.approx(0.302)
    assert length_unit("in") == 0.0254
    for bad in ("", "-1", "0", "nan", "1 kg", "1e400", "1.2.3", "mm", "3 in 3 ft", "3 ft 3", "1 200 mm"):
        with pytest.raises(Scan2FlexError, match="positive number of m"):
            quantity(bad, "length")


@pytest.mark.parametrize(
    ("text", "what", "value"),
    [
        ("36 kg/km", "length density", 0.036), ("24 lb/1000ft", "length density", 24 * 0.45359237 / 304.8),
        ("24 lb/1000 ft", "length density", 24 * 0.45359237 / 304.8), ("150 tex", "length density", 1.5e-4),
        ("3.2 N/m", "length density", 3.2 / 9.80665), ("7 KG/KM", "length density", 0.007), ("90 den", "length density", 1e-5),
        ("302 gram", "mass", 0.302), ("302 gf", "mass", 0.302), ("5 lb 3 oz", "mass", 83 / 16 * 0.45359237),
        ("3 ft 3 in", "length", 39 * 0.0254), ("3' 3\"", "length", 39 * 0.0254),
    ],
)  # fmt: skip
def test_units_of_catalogues(text, what, value):
    assert quantity(text, what) == pytest.approx(value, rel=1e-12)


def test_a_number_that_two_countries_read_differently_is_asked_for():
    with pytest.raises(Scan2FlexError, match=r"may be 1200 or 1\.200"):
        quantity("1,200 mm", "length")


def test_a_unit_of_another_quantity_is_answered_with_units_that_are_used():
    with pytest.raises(Scan2FlexError, match=r"kg/m, or one with a unit \(g/m, kg/km, lb/ft, lb/1000ft, tex, N/m\)"):
        quantity("36 kg", "length density")
