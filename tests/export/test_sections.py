"""Text exports of the sections: read back, in the units of the program, they have the stiffness and mass of the cable."""

import subprocess
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from scan2flex_jax.export import export
from tests.export.test_export import cable, effect
from tests.export.test_nothing_dropped import straight

ELEMENTS = 10
EI, GJ, EA, GA, MASS = 0.1, 0.25, 1e5, 1e5, 0.2


def sections(text):
    """Keywords of an Abaqus file with their parameters and rows of numbers."""
    out = []
    for line in text.splitlines():
        if line.startswith("*") and not line.startswith("**"):
            keyword, *given = (part.strip() for part in line[1:].split(","))
            out.append((keyword, dict(g.split("=") if "=" in g else (g, True) for g in given), []))
        elif not line.startswith("**"):
            out[-1][2].append([float(x) for x in line.split(",")])
    return out


def written(study, to):
    return export(study, to, elements=ELEMENTS)


def test_abaqus_has_the_stiffness_and_mass_of_every_element():
    found = sections(written(cable(radius=0.004), "abaqus"))
    ((given, rows),) = [(g, r) for k, g, r in found if k == "BEAM GENERAL SECTION"]
    (A, I11, I12, I22, J), axis, (E, G) = rows
    assert given["SECTION"] == "GENERAL"
    assert float(A) == pytest.approx(np.pi * 0.004**2)
    np.testing.assert_allclose([E * A, E * I11, E * I22, G * J, I12], [EA, EI, EI, GJ, 0.0])
    assert float(given["DENSITY"]) * A == pytest.approx(MASS)
    assert [r for k, _, r in found if k == "TRANSVERSE SHEAR STIFFNESS"] == [[[GA, GA]]]
    nodes = np.array([r for k, _, rows in found if k == "NODE" for r in rows])
    assert np.sum(np.linalg.norm(np.diff(nodes[:, 1:], axis=0), axis=1)) == pytest.approx(1.0)
    assert np.dot(axis, nodes[1, 1:] - nodes[0, 1:]) == pytest.approx(0.0)


def test_abaqus_has_an_element_set_for_each_run_of_equal_sections_and_masses_where_they_hang():
    sleeve = effect("stiffness_profile", position=0.55, width=0.2, factor=3.0)
    study = replace(cable(), effects=(sleeve, effect("point_mass", position=0.33, mass=0.05)))
    found = sections(written(study, "abaqus"))
    sets = {g["ELSET"]: r for k, g, r in found if k == "ELEMENT" and g["TYPE"] == "B31"}
    stiff = {g["ELSET"]: r[2][0] * r[0][1] for k, g, r in found if k == "BEAM GENERAL SECTION"}
    assert sorted(int(e) for rows in sets.values() for e, *_ in rows) == list(range(1, ELEMENTS + 1))
    EI_of = {int(e): stiff[name] for name, rows in sets.items() for e, *_ in rows}
    np.testing.assert_allclose([EI_of[k + 1] for k in range(ELEMENTS)], straight(sleeve).stiffness[:, 3, 3], rtol=1e-6)
    at = {int(r[0][1]): g["ELSET"] for k, g, r in found if k == "ELEMENT" and g["TYPE"] == "MASS"}
    kg = {g["ELSET"]: r[0][0] for k, g, r in found if k == "MASS"}
    first = sum((node - 1) / ELEMENTS * kg[name] for node, name in at.items())
    assert sum(kg.values()) == pytest.approx(0.05)
    assert first == pytest.approx(0.05 * 0.33)


def test_abaqus_bends_where_the_cable_is_bent_by_nature():
    """A cable of constant natural curvature 2/m lies on a circle of radius 0.5 m."""
    found = sections(written(cable(natural_curvature=np.array([0.0, 2.0, 0.0])), "abaqus"))
    nodes = np.array([r[1:] for k, _, rows in found if k == "NODE" for r in rows])
    chord = np.linalg.norm(nodes[-1] - nodes[0])
    assert chord == pytest.approx(2 * 0.5 * np.sin(0.5 / 0.5), rel=2e-3)


def test_abaqus_has_the_moments_of_a_law_that_slips():
    """Beyond slip a moment grows by ``ratio`` of the stiffness: M = r EI k + (1 - r) EI k_slip where k >> k_slip."""
    study = replace(cable(radius=0.004), effects=(effect("nonlinear_bending", slip_curvature=1.0, ratio=0.4),))
    found = sections(written(study, "abaqus"))
    M, k = np.array(next(r for key, _, r in found if key == "M1")).T
    assert next(g for key, g, _ in found if key == "M1") == {"ELASTIC": True}
    np.testing.assert_allclose(M, -M[::-1])
    np.testing.assert_allclose(np.gradient(M, k)[len(k) // 2], EI, rtol=1e-3)
    far = k > 50.0
    np.testing.assert_allclose(M[far], EI * (0.4 * k[far] + 0.6), rtol=2e-3)
    assert k.max() == pytest.approx(0.5 / 0.004)
    assert next((g, r) for key, g, r in found if key == "TORQUE") == ({"LINEAR": True}, [[GJ]])


def test_orcaflex_reads_kilonewtons_tonnes_and_metres():
    sleeve = effect("stiffness_profile", position=0.5, width=0.3, factor=2.0)
    found = yaml.safe_load(written(replace(cable(radius=0.004), effects=(sleeve,)), "orcaflex"))
    assert found["UnitsSystem"] == "SI"
    types = {t["Name"]: t for t in found["LineTypes"]}
    (line,) = found["Lines"]
    rows = line["LineType, Length, TargetSegmentLength"]
    assert sum(length for _, length, _ in rows) == pytest.approx(1.0)
    along = straight(sleeve)
    each = [types[name] for name, length, step in rows for _ in range(round(length / step))]
    np.testing.assert_allclose([t["EIx"] for t in each], 1e-3 * along.stiffness[:, 3, 3], rtol=1e-6)
    assert (each[0]["GJ"], each[0]["EA"], each[0]["OD"]) == pytest.approx((1e-3 * GJ, 1e-3 * EA, 0.008))
    assert sum(t["MassPerUnitLength"] for t in each) / ELEMENTS == pytest.approx(1e-3 * MASS)


def test_moduli_of_a_solid_circle_give_the_stiffness_back():
    m = tomllib.loads(written(cable(radius=0.004), "moduli"))
    r = m["diameter"] / 2
    back = [m["E_bend"] * np.pi * r**4 / 4, m["G_twist"] * np.pi * r**4 / 2, m["E_stretch"] * np.pi * r**2]
    np.testing.assert_allclose([*back, m["density"] * np.pi * r**2], [EI, GJ, EA, MASS], rtol=1e-6)


def test_two_bending_stiffnesses_reach_both_axes():
    study = cable(bending_stiffness=np.array([0.1, 0.2]))
    (A, I11, _, I22, _), _, (E, _) = next(r for k, _, r in sections(written(study, "abaqus")) if k == "BEAM GENERAL SECTION")
    line = yaml.safe_load(written(study, "orcaflex"))["LineTypes"][0]
    np.testing.assert_allclose([E * I11, E * I22, 1e3 * line["EIx"], 1e3 * line["EIy"]], [0.1, 0.2, 0.1, 0.2], rtol=1e-6)
    assert A > 0


DECK = """--------------------- MoorDyn Input File ---------------------
{types}---------------------- POINTS ----------------------
ID Attachment X Y Z Mass Volume CdA Ca
(#) (word) (m) (m) (m) (kg) (m^3) (m^2) (-)
1 Fixed 0 0 0 0 0 0 0
2 Fixed 0 0 -{apart} 0 0 0 0
---------------------- LINES ----------------------
ID LineType AttachA AttachB UnstrLen NumSegs LineOutputs
(#) (name) (ID) (ID) (m) (-) (-)
1 {name} 1 2 1.0 20 -
---------------------- OPTIONS ----------------------
9.81 g
3 WtrDpth
1e-5 dtM
0.2 TmaxIC
---------------------- need this line ----------------------
"""


def test_moordyn_reads_the_row(tmp_path, monkeypatch):
    """By MoorDyn's own reader: a vertical line stretched by 1 % pulls with 1 % of EA, more by half its weight at the top."""
    moordyn = pytest.importorskip("moordyn", reason="pip install moordyn: reads the row with the program's own reader")
    monkeypatch.chdir(tmp_path)  # it writes its log beside the deck
    types = written(cable(), "moordyn")
    name = types.splitlines()[3].split()[0]
    (tmp_path / "deck.txt").write_text(DECK.format(types=types, name=name, apart=1.01))
    system = moordyn.Create(str(tmp_path / "deck.txt"))
    moordyn.Init(system, [], [])
    line = moordyn.GetLine(system, 1)
    assert moordyn.GetLineUnstretchedLength(line) == 1.0
    assert moordyn.GetLineFairTen(line) == pytest.approx(0.01 * EA, rel=5e-3)
    moordyn.Close(system)


TWISTED = """--------------------- CableDyn Input File ---------------------
a taut cable, its end turned by 90 degrees
{types}---------------------- POINTS ----------------------
ID Type X Y Z
(-) (-) (m) (m) (m)
1 Coupled 0.0 0.0 -1.0
2 Fixed 1.01 0.0 -1.0
---------------------- LINES ----------------------
ID NodeA NodeB Outputs
(-) (-) (-) (-)
1 1 2 -
---------------------- SECTIONS ----------------------
LineID LineType Length NumSegs
(-) (-) (m) (-)
1 {name} 1.0 40
---------------------- END CONNECTIONS ----------------------
LineID End Stiffness EzX EzY EzZ TorsStiffness NxX NxY NxZ Pretwist
(-) (-) (N-m/rad) (-) (-) (-) (N-m/rad) (-) (-) (-) (deg)
1 A Rigid 1.0 0.0 0.0 Rigid 0.0 1.0 0.0 0.0
1 B Rigid 1.0 0.0 0.0 Rigid 0.0 1.0 0.0 90.0
---------------------- OPTIONS ----------------------
9.81 g
0.1 rhoW
10.0 WtrDpth
0.01 dtM
0.02 TMax
---------------------- OUTPUTS ----------------------
"FairTen1"
"Torq1N1"
---------------------- need this line ----------------------
"""


def test_cabledyn_pulls_and_twists_as_the_row_says(tmp_path):
    """By CableDyn itself: a cable that is stretched by 1 % and turned by 90 degrees pulls with EA/100, and its torque is
    GJ pi/2 per metre."""
    cabledyn = pytest.importorskip("cabledyn", reason="pip install cabledyn: solves a deck with the row")
    types = written(cable(radius=0.004), "cabledyn")
    name = types.splitlines()[3].split()[0]
    (tmp_path / "deck.dat").write_text(TWISTED.format(types=types, name=name))
    driver = Path(cabledyn.__file__).parent / "bin" / "cabledyn"
    subprocess.run([driver, tmp_path / "deck.dat", tmp_path / "out"], check=True, capture_output=True)
    _, tension, torque = map(float, (tmp_path / "out.out").read_text().splitlines()[2].split())
    assert tension == pytest.approx(0.01 * EA, rel=1e-3)
    assert torque == pytest.approx(GJ * np.pi / 2, rel=1e-6)


def test_the_factors_of_ansys_motion_scale_a_beam_of_its_material_to_the_cable():
    """A round beam of E and G = E/(2 (1 + nu)), nu = 0.3, has E A, E pi r^4/4 and G pi r^4/2; each times its factor."""
    m = tomllib.loads(written(cable(radius=0.004), "moduli"))
    r, E = m["diameter"] / 2, m["E_stretch"]
    beam = [E * np.pi * r**2, E * np.pi * r**4 / 4, E / 2.6 * np.pi * r**4 / 2]
    factors = [m["motion_bar"], m["motion_bending"], m["motion_torsional"]]
    np.testing.assert_allclose(np.multiply(beam, factors), [EA, EI, GJ], rtol=1e-6)
