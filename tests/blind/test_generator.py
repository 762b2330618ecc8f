"""The independent rod against collocation by scipy and its own invariants; the chain that remembers in closed form.

Symbols: L (m) length, EI and GJ (N m^2), rhoA (kg/m); a state is `(r, q, n, m)` in world axes.
"""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.blind import design, effects, rod
from benchmarks.blind import quaternions as qt
from benchmarks.blind.hysteresis import SEGMENTS, Chain, Dahl, Grip, hanging
from benchmarks.blind.scene import Cable, interpolate, mesh
from tests.reference import cantilever, cosserat_bvp, rotations

E1, E3 = np.array([1.0, 0, 0]), np.array([0, 0, 1.0])
GRIP = Grip(0.45, 0.05, 0.5)
CABLE = Cable(length=1.0, radius=0.004, density=0.1, bending=0.03, torsion=0.02)


def one_pose(cable, goal, frame, end_kind=rod.CLAMP, half=0.5):
    start = qt.between(E3, E1)
    up = np.array([0, -1.0, 0])
    return {"start": start, "at": np.zeros(3), "kind": end_kind, "half": half, "axis": up, "goal": goal, "frame": frame}


def solved(cable, candidates, intervals=128):
    """The baseline model in some poses: scene, fields and states."""
    y, alive = design.travel(cable, candidates)
    assert len(alive) == len(candidates)
    scene, sigma = design.assemble(cable, candidates), mesh(intervals, cable.length)
    F = effects.build(scene, [], sigma)[0]
    y, ok = rod.solve(F, interpolate(np.linspace(0, 1, design.COARSE + 1), y, sigma))
    assert ok.all()
    return scene, F, y


def twisted():
    """A clamped pose out of the plane, twisted by 90 degrees, and a free end."""
    start = qt.between(E3, E1)
    last = np.array([0.6, 0.7, 0.3]) / np.linalg.norm([0.6, 0.7, 0.3])
    frame = qt.product(qt.product(qt.between(E1, last), start), qt.roll(np.pi / 2))
    return [one_pose(CABLE, np.array([0.55, 0.35, 0.1]), frame), one_pose(CABLE, np.zeros(3), start, rod.FREE, 0.0)]


@pytest.fixture(scope="module")
def poses():
    return solved(CABLE, twisted())


def test_heavy_cantilever_agrees_with_collocation(poses):
    _, _, y = poses
    tip = cantilever.positions(1.0, CABLE.bending, 9.81 * CABLE.density, 0.0, np.array([1.0]))[0]
    assert np.allclose(y[1, -1, [0, 2]], tip[[0, 2]], atol=1e-5)  # the reference is neither stretched nor sheared
    assert np.allclose(y[1, -1, 1], 0, atol=1e-12)


def test_twisted_pose_agrees_with_collocation(poses):
    """All thirteen equations once more, written with rotation matrices and solved to 1e-9."""
    scene, F, y = poses
    start, end = (rotations.matrix(frame[1][0]) for frame in (scene.start, scene.end))
    K = np.array([CABLE.bending, CABLE.bending, CABLE.torsion])
    held = cosserat_bvp.Clamped(1.0, K, 9.81 * CABLE.density, scene.end[0][0], end, start, compliance=np.full(3, 1e-5))
    exact = cosserat_bvp.solve([held], y[0, :, :3])
    assert np.abs(exact.positions(F.sigma) - y[0, :, :3]).max() < 1e-6
    assert np.abs(exact.moments(F.sigma) - y[0, :, 10:]).max() < 1e-6


def test_identities_between_effects(poses):
    """A vertical point load is a point mass; a tilt of gravity is a uniform load; equal sections have no axes."""
    scene, F, y = poses

    def shape(tables, scene=scene):
        new, ok = rod.solve(effects.build(scene, tables, F.sigma)[0], y)
        assert ok.all()
        return new[..., :3]

    heavy = shape([{"kind": "point_mass", "position": 0.43, "mass": 0.01}])
    pulled = shape([{"kind": "point_load", "position": 0.43, "force": 0.01 * scene.gravity}])
    assert np.abs(heavy - pulled).max() < 1e-12 < np.abs(heavy - y[..., :3]).max()
    side = np.array([0.3, 0.2, 0.0])
    tilted = shape([], replace(scene, gravity=scene.gravity + side))
    assert np.abs(tilted - shape([{"kind": "uniform_load", "force": CABLE.density * side}])).max() < 1e-12
    turned = shape([{"kind": "clamp_rotation", "rotation": [[0, 0, 0.8], [0, 0, 0.8]]}])
    assert np.abs(turned - y[..., :3]).max() < 1e-10


@pytest.mark.parametrize("most", [0.5, 8.0])
def test_the_area_of_a_steady_loop_is_that_of_dahls_law(most):
    """Over a cycle z goes from -tanh(A/slip) to tanh(A/slip): the area is 4 share EI slip (A - slip tanh(A/slip))."""
    law = Dahl(0.05, 0.6, 1.5)
    expected = 4 * law.share * law.EI * law.slip * (most - law.slip * np.tanh(most / law.slip))
    assert law.loop_area(most) == pytest.approx(expected, rel=2e-3)


def test_a_chain_ends_at_its_clamp_in_balance():
    chain = hanging(1.0, 1.0, Dahl(0.05, 0.6, 1.5), GRIP)
    np.testing.assert_allclose(chain.points[-1], [0.45, 0.05], atol=1e-9)
    again = chain.moved(GRIP)
    np.testing.assert_allclose(again.points, chain.points, atol=1e-9)


@pytest.mark.parametrize(("bending", "torsion"), [(1.0, 1.0), (2.0, 0.5)])
def test_a_clamped_strut_leaves_its_plane_at_eulers_force(bending, torsion):
    """4 pi^2 EI/L^2, whatever the torsional stiffness, here to the second order of 120 segments."""
    strut = Chain(1.0, 0.0, Dahl(1.0, 0.0, 1.0), np.zeros(SEGMENTS), np.zeros(2))
    euler = 4 * np.pi**2 * bending
    for part, stays in ((-2.0, True), (0.9, True), (0.998, True), (1.002, False), (2.0, False)):
        assert replace(strut, force=np.array([-part * euler, 0.0])).stays_plane(bending, torsion) is stays
