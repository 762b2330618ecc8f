"""Moments, loads on an arm, guided ends and hinges: closed forms, in space and through a study."""

import json
from dataclasses import replace
from functools import partial

import jax
import numpy as np
import pytest
from scipy.optimize import brentq
from typer.testing import CliRunner

import scan2flex_jax.effects as fx
from scan2flex_jax import predict
from scan2flex_jax.cli.app import app
from scan2flex_jax.errors import StudyError
from scan2flex_jax.inference.planning import Plan, variations
from scan2flex_jax.rod.cable import Cable
from scan2flex_jax.rod.model import CableModel
from scan2flex_jax.statics.solve import equilibrium
from scan2flex_jax.statics.verdict import SOLVED
from scan2flex_jax.study import Clamp, EffectDeclaration, Study, load_study, save_study

from .scene import straight

EI, GJ, LENGTH, ELEMENTS, SPAN = 0.02, 0.015, 1.0, 24, 0.05
solve = jax.jit(partial(equilibrium, elements=ELEMENTS))
ALONG_X = [0.5, 0.5, 0.5, 0.5]  # d3 along x, d1 along y, d2 along z
NONE, DOWN = [0.0, 0.0, 0.0], [0.0, 0.0, -9.81]


def cantilever(*effects, bending=EI, gravity=NONE, stable=True):
    """Positions and rotations of the nodes of a weightless cantilever along x, d1 across it and level."""
    cable = Cable(LENGTH, 1e-9, bending, GJ, axial_stiffness=1.0e7, shear_stiffness=1.0e7)
    found = solve(CableModel(cable, gravity, effects), straight())
    assert (int(found.verdict.code) == SOLVED) == stable, found.verdict.sentence()
    return np.asarray(found.points), np.asarray(found.configuration.R)


@pytest.mark.parametrize(("turn", "place"), [(0.7, 1.0), (5.0, 1.0), (1.2, 0.53)])
def test_a_moment_bends_a_cantilever_to_a_circle(turn, place):
    """Up to its place, wherever the nodes are; beyond it the cable is straight. A bed keeps it in its plane."""
    radius = place / turn
    bed = fx.ElasticSupport([0.0, 1.0, 0.0], 0.0, 300.0)
    points, R = cantilever(bed, fx.Moment(place, [0.0, -1.0, 0.0], turn * EI / place))
    s = np.minimum(np.linspace(0.0, 1.0, ELEMENTS + 1), place)
    beyond = np.linspace(0.0, 1.0, ELEMENTS + 1) - s
    arc = np.stack([radius * np.sin(s / radius), 0.0 * s, radius * (1.0 - np.cos(s / radius))], axis=1)
    arc += beyond[:, None] * [np.cos(turn), 0.0, np.sin(turn)]
    np.testing.assert_allclose(points, arc, atol=2e-4 if place == 1.0 else 5e-4)
    np.testing.assert_allclose(R[-1, :, 2], [np.cos(turn), 0.0, np.sin(turn)], atol=1e-4)


@pytest.mark.parametrize(("turn", "solved"), [(1.5, True), (1.65, False)])
def test_without_a_bed_a_moment_bends_the_cable_out_of_its_plane(turn, solved):
    """Beyond a quarter turn: with the angle b of the tangent to the plane, the energy 1/2 EI b'^2 - 1/2 (M^2/EI) b^2, b = 0 at
    the clamp and b' = 0 at the tip, has a negative direction above M L/EI = pi/2, whatever GJ."""
    bed = fx.ElasticSupport([0.0, 1.0, 0.0], 0.0, 0.0)
    cantilever(bed, fx.Moment(1.0, [0.0, -1.0, 0.0], turn * EI), stable=solved)


def test_a_moment_about_the_cable_twists_it():
    """By M L/GJ, here through more than half a turn; the cable is too stiff in bending to buckle."""
    angle = 3.6
    _, R = cantilever(fx.Moment(1.0, [1.0, 0.0, 0.0], angle * GJ, lever=[1.0, 0.0, 0.0]), bending=2.0)
    turned = R[0].T @ R[-1]
    np.testing.assert_allclose(turned[:2, 0], [np.cos(angle), np.sin(angle)], atol=1e-6)


def test_a_mass_beside_the_axis_twists_the_cable():
    """By m g a L/GJ, and less as the arm sinks; the cable is stiff in bending, and its d2 level."""
    mass, arm = 0.02, 0.05
    _, R = cantilever(fx.PointMass(1.0, mass, offset=[0.0, arm, 0.0]), bending=20.0, gravity=DOWN)
    assert abs(R[0, 2, 1]) < 1e-12
    turn = brentq(lambda t: GJ * t / LENGTH - mass * 9.81 * arm * np.cos(t), 0.0, np.pi / 2)
    assert np.arcsin(-R[-1, 2, 1]) == pytest.approx(turn, rel=2e-3)


def test_a_couple_of_dead_forces_fades_as_its_arm_turns():
    """Two opposite forces on an arm along the cable: EI theta/L = F a cos(theta), a quasi-tangential moment."""
    force, arm = 0.3, 0.2
    pair = [fx.PointLoad(1.0, [0.0, 0.0, f], offset=[0.0, 0.0, 0.5 * np.sign(f) * arm]) for f in (force, -force)]
    points, R = cantilever(*pair)
    turn = brentq(lambda t: EI * t / LENGTH - force * arm * np.cos(t), 0.0, np.pi / 2)
    np.testing.assert_allclose(R[-1, :, 2], [np.cos(turn), 0.0, np.sin(turn)], atol=1e-5)
    np.testing.assert_allclose(points[-1, [0, 2]], LENGTH / turn * np.array([np.sin(turn), 1 - np.cos(turn)]), atol=1e-4)


def bench(force, **ends):
    """A study with one pose for each end ``(key of Clamp, value, place of the load)``; weightless, clamped at its start."""
    cable = {"length": LENGTH, "length_density": 1e-9, "bending_stiffness": EI, "torsional_stiffness": GJ}
    cable["axial_stiffness"] = 100.0  # between ends that both hold its place, the cable stretches as it bends
    poses, loads = [], []
    for name, (key, value, place) in ends.items():
        end = replace(Clamp([LENGTH, 0.0, 0.0], ALONG_X), **{key: value})
        poses.append({"name": name, "start": ([0.0, 0.0, 0.0], ALONG_X), "end": end})
        loads.append(EffectDeclaration("point_load", {"position": place, "force": [0.0, 0.0, -force]}, [name]))
    return Study.from_arrays(cable, poses, gravity=NONE, effects=loads)


def test_guided_ends_and_hinges():
    """A guided end yields by F L^3/(12 EI) and both clamps carry F L/2; a hinge carries 5 F/16 of a load in the middle, the
    clamp 3 F L/16, and the hinge no moment about its axis."""
    force = 2e-4
    study = bench(
        force, guided=("free", [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], LENGTH), hinged=("hinge", [0.0, 1.0, 0.0], 0.5 * LENGTH)
    )
    found = predict(study, elements=ELEMENTS)
    guided, hinged = found["guided"], found["hinged"]
    assert guided.points[-1, 2] == pytest.approx(-force * LENGTH**3 / (12 * EI), rel=1e-4)
    np.testing.assert_allclose(np.abs(guided.reaction_moment[:, 1]), 0.5 * force * LENGTH, rtol=1e-3)
    np.testing.assert_allclose(guided.reaction_force[:, 2], [force, 0.0], atol=1e-6 * force)
    np.testing.assert_allclose(hinged.reaction_force[:, 2], [11 * force / 16, 5 * force / 16], rtol=1e-3)
    np.testing.assert_allclose(hinged.reaction_moment[:, 1], [-3 * force * LENGTH / 16, 0.0], atol=1e-3 * force)
    np.testing.assert_allclose(hinged.points[-1], [LENGTH, 0.0, 0.0], atol=1e-12)


def test_a_guide_holds_what_it_does_not_leave_free():
    """Oblique free directions, twice the same one: the projection on the rest."""
    guide = Clamp([0.0, 0.0, 0.0], ALONG_X, free=[[1.0, 1.0, 0.0], [2.0, 2.0, 0.0]])
    np.testing.assert_allclose(guide.across, np.eye(3) - 0.5 * np.array([[1, 1, 0], [1, 1, 0], [0, 0, 0]]), atol=1e-12)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"free": [[1.0, 0.0, 0.0]]}, "the end turns freely: give its quaternion"),
        ({"quaternion": ALONG_X, "free": [[1.0, 0.0, 0.0]], "hinge": [0.0, 1.0, 0.0]}, "leave one of them out"),
        ({"quaternion": ALONG_X, "free": [[0.0, 0.0, 0.0]]}, "a direction is zero"),
        ({"quaternion": ALONG_X, "hinge": [0.0, 2.0, 0.0]}, "give a unit hinge"),
    ],
)
def test_ends_that_cannot_be(given, message):
    with pytest.raises(StudyError, match=message):
        Clamp([0.0, 0.0, 0.0], **given)


BENCH = """format = "scan2flex-study/1"
title = "bench"
gravity = [0.0, 0.0, -9.81]
[cable]
length = 0.06
length_density = 0.004873
torsional_stiffness = 0.004
LINE
[[pose]]
name = "bend"
role = "fit"
markers = "mid.csv"
noise = 0.000002
[[effect]]
kind = "support"
position = 0.005
anchor = [0.0, 0.0, 0.0]
[[effect]]
kind = "knife_edge"
anchor = [0.05, 0.0, 0.0]
along = [1.0, 0.0, 0.0]
[[effect]]
kind = "point_load"
position = "50 %"
force = [0.0, 0.0, -1.0]
[[effect]]
kind = "point_mass"
position = "100 %"
mass = 0.0
offset = [0.0, 0.001, 0.0]
"""


def write(folder, line="[unknown.bending_stiffness]", held=True):
    text = BENCH if held else BENCH[: BENCH.index("[[effect]]")]
    (folder / "study.toml").write_text(text.replace("LINE", line))
    (folder / "mid.csv").write_text("s,z\n0.03,-0.000536\n")
    return folder


def test_a_bench_is_read_and_written(tmp_path):
    study = load_study(write(tmp_path))
    assert study.poses[0].start is None
    assert [e.parameters.get("position") for e in study.effects] == [0.005, None, 0.03, 0.06]
    save_study(study, tmp_path / "again")
    assert load_study(tmp_path / "again") == study


def test_a_plan_has_no_pose_without_clamps(tmp_path):
    assert variations(load_study(write(tmp_path))) == []
    assert Plan((), ()).summary().startswith("no pose to rank")


def test_what_a_bench_cannot_be(tmp_path):
    with pytest.raises(StudyError, match="nothing else holds the cable"):
        load_study(write(tmp_path, held=False))
    with pytest.raises(StudyError, match="'50 %' of a length that is unknown"):
        load_study(write(tmp_path, "[unknown.bending_stiffness]\n[unknown.length]"))


@pytest.mark.slow
def test_three_point_bending_is_fitted_from_the_command_line(tmp_path):
    """One reading of the deflection gives EI: F L^3/(48 EI), and 0.12 % more as the elastica slides inwards."""
    folder, into = write(tmp_path), [tmp_path / name for name in ("fit.json", "known", "out", "fit.png")]
    files = ["--json", str(into[0]), "--save", str(into[1]), "--figure", str(into[3])]
    done = CliRunner().invoke(app, ["fit", str(folder), *files])
    assert done.exit_code == 0, done.output
    found = json.loads(into[0].read_text())["estimates"]["bending_stiffness"]
    assert found["low"] < 1.0012 * SPAN**3 / (48 * 0.000536) < found["high"] < 1.02 * found["low"]
    shown = CliRunner().invoke(app, ["simulate", str(into[1]), "--out", str(into[2])])
    assert "the knife edge at s = 0.05501 m exerts (-0.016, 0.000, 0.50" in shown.output
