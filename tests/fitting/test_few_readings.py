"""One to three readings: other stable shapes that explain them are said, and where there are none nothing is."""

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from scan2flex_jax import Clamp, EffectDeclaration, Markers, Study, StudyPose, Unknown, fit
from scan2flex_jax.inference.answer import FAIR

from .test_misread import FINE, LIMP, STIFF, cantilever

LENGTH, DENSITY, EI, GAP = 0.3, 0.02, 2e-5, 2e-4  # m, kg/m, N m^2, m: of a heart loop
UP, DOWN = [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0]


def lowest():
    """Height (m) of the middle of a strip that hangs as a heart, both ends in one clamp: EI theta'' = F sin(theta) -
    (V + w s) cos(theta), which turns by one and a half turns from upward to downward."""
    w = DENSITY * 9.81

    def slope(s, y, p):
        force = (p[0] * np.sin(y[0]) - (p[1] + w * s) * np.cos(y[0])) / EI
        return np.array([y[1], force, np.cos(y[0]), np.sin(y[0])])

    def ends(a, b, p):
        return np.array([a[0] - np.pi / 2, b[0] + 5 * np.pi / 2, a[2], a[3], b[2] + GAP, b[3]])

    s = np.linspace(0, LENGTH, 201)
    theta = np.pi / 2 - 3 * np.pi * s / LENGTH - 1.2 * np.sin(4 * np.pi * s / LENGTH)
    x, z = (np.cumsum(f(theta)) * (s[1] - s[0]) for f in (np.cos, np.sin))
    start = np.array([theta, np.gradient(theta, s), x, z])
    found = solve_bvp(slope, ends, s, start, p=[0.0, -0.5 * w * LENGTH], tol=1e-8, max_nodes=50000)
    assert found.success
    return float(found.sol(0.5 * LENGTH)[3])


def test_a_heart_loop_by_its_height_alone():
    """The strip hangs in a plane; at other stiffnesses shapes out of it reach the same depth."""
    strip = EffectDeclaration("anisotropic_bending", {"ratio": 1000.0, "angle": np.pi / 2})
    pose = StudyPose(
        "loop", "fit", Clamp.of(([0, 0, 0], UP)), Clamp.of(([-GAP, 0, 0], DOWN)), noise=5e-4,
        markers=Markers([[np.nan, np.nan, lowest()]], [0.5 * LENGTH]),
    )  # fmt: skip
    known = {"length": LENGTH, "length_density": DENSITY, "torsional_stiffness": 1.6e-5}
    f = fit(Study("Heart", [0, 0, -9.81], known, (pose,), unknowns=[Unknown("bending_stiffness")], effects=[strip]))
    e = f.estimates["bending_stiffness"]
    assert f.answer.tone == FAIR and not e.identifiable and e.low is None
    said = f.answer.belief
    assert "1 reading fits" in said and "stable shapes: bending_stiffness = " in said and "measure the curve" in said
    values = [float(x) for x in said.split(" = ")[1].split(" N m^2")[0].split(" or ")]
    assert min(abs(v / EI - 1) for v in values) < 0.01 and max(values) > 1.15 * min(values)


@pytest.mark.parametrize(("cable", "load", "measured"), [(STIFF, 30.0, "z"), (LIMP, 0.0, "z"), (LIMP, 0.0, "xyz")])
def test_a_droop_test_has_one_shape(cable, load, measured):
    f = fit(cantilever(cable, (load,), [1.0], measured, FINE))
    e = f.estimates["bending_stiffness"]
    assert f.in_doubt == () and e.identifiable
    assert e.value == pytest.approx(cable[1], rel=0.02)
