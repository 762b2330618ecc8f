"""A single misread value among markers is named: a sign, a digit, exchanged rows, on shapes of the plane elastica.

By `tests.reference.cantilever`: a stiff beam that bends by a few millimetres, and a limp one that hangs down.
"""

from dataclasses import replace

import numpy as np
import pytest

from scan2flex_jax import Clamp, EffectDeclaration, Markers, Study, StudyPose, Unknown, fit
from scan2flex_jax.posterior.settings import Settings
from tests.reference.cantilever import solution

LEVEL = [[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]
G = 9.81
STIFF, LIMP = (0.5, 393.0, 0.85), (1.0, 0.1, 0.2)  # length (m), EI (N m^2), mass per length (kg/m)


def elastica(cable, load):
    """State (x, z, angle, curvature) along s of a level cantilever with a load (N) at its tip."""
    L, EI, density = cable
    return solution(L, EI, density * G, load=load)


def cantilever(cable, loads, at, measured, noise, *, seed=0, stated=None):
    """A study of EI from markers at ``at`` (shares of the length) under loads at the tip (N), rounded as they are read."""
    L, _, density = cable
    rng, poses = np.random.default_rng(seed), []
    for k, load in enumerate(loads):
        s = L * np.array(at)
        x, z, _, _ = elastica(cable, load)(s)
        points = np.stack([x, 0 * x, z], axis=1) + noise * rng.standard_normal((len(s), 3))
        points = np.where([name in measured for name in "xyz"], np.round(points, 5 if noise < 1e-4 else 4), np.nan)
        poses.append(StudyPose(f"load-{k + 1}", "fit", Clamp.of(([0, 0, 0], LEVEL)), markers=Markers(points, s), noise=stated))
    acting = [(f, p.name) for f, p in zip(loads, poses, strict=True) if f]
    effects = [EffectDeclaration("point_load", {"position": L, "force": [0, 0, -f]}, (name,)) for f, name in acting]
    known = {"length": L, "length_density": density, "torsional_stiffness": 0.8 * cable[1]}
    return Study("Cantilever", [0, 0, -G], known, poses, unknowns=[Unknown("bending_stiffness")], effects=effects)


def changed(study, pose, change):
    """The study with the markers of a pose changed in place."""
    own = study.poses[pose]
    points = own.markers.points.copy()
    change(points)
    poses = [replace(p, markers=replace(own.markers, points=points)) if p is own else p for p in study.poses]
    return replace(study, poses=tuple(poses))


def misread(marker, axis, value):
    """A change of one coordinate (m), by a function of the one measured."""

    def change(points):
        points[marker, axis] = value(points[marker, axis])

    return change


def rows(i, j):
    """A change that exchanges two rows."""

    def change(points):
        points[[i, j]] = points[[j, i]]

    return change


def digit(place, to):
    """Another digit: that of the decimal ``place`` (m) becomes ``to``."""

    def value(v):
        return np.sign(v) * (abs(v) + (to - int(abs(v) / place + 1e-6) % 10) * place)

    return value


def poses_exchanged(study, i, j):
    """The readings of two poses exchanged."""
    p, q = study.poses[i], study.poses[j]
    new = {p.name: q.markers, q.name: p.markers}
    return replace(study, poses=tuple(replace(x, markers=new.get(x.name, x.markers)) for x in study.poses))


FINE, ROUGH = 5e-6, 5e-4  # m: a dial gauge, and markers in a photograph
FEW, MANY = np.linspace(0.25, 1.0, 4), np.linspace(0.05, 1.0, 20)
DIAL = (STIFF, (10.0, 20.0, 30.0), [1.0], "z", FINE)
TABLE = (STIFF, (10.0, 30.0), np.linspace(0.2, 1.0, 6), "z", FINE)
HANGS = (LIMP, (0.0, 0.1, 0.3), FEW, "xyz", ROUGH)
PHOTO = (LIMP, (0.1,), MANY, "xz", ROUGH)
CASES = {
    "a dial reading halved": (DIAL, (2, misread(0, 2, lambda z: 0.5 * z)), "z of marker 1 of pose load-3 is misread"),
    "sign of a dial reading": (DIAL, (0, misread(0, 2, lambda z: -z)), "z of marker 1 of pose load-1 has the wrong sign"),
    "two dial readings exchanged": (
        (STIFF, (10.0, 20.0, 30.0, 40.0), [1.0], "z", FINE), (1, 3), "the markers of poses load-2 and load-4 are exchanged"),
    "a digit in a table of a beam": (TABLE, (1, misread(3, 2, digit(1e-3, 7))), "z of marker 4 of pose load-2 is misread"),
    "two rows of a stiff beam": (TABLE, (0, rows(2, 4)), "markers 3 and 5 of pose load-1 are exchanged"),
    "sign at a limp cable": (HANGS, (1, misread(1, 2, lambda z: -z)), "z of marker 2 of pose load-2 has the wrong sign"),
    "a digit at a limp cable": (HANGS, (2, misread(3, 0, digit(0.1, 1))), "x of marker 4 of pose load-3 is misread"),
    "two rows of a limp cable": (PHOTO, (0, rows(9, 10)), "markers 10 and 11 of pose load-1 are exchanged"),
    "sign in a photograph": (PHOTO, (0, misread(5, 2, lambda z: -z)), "z of marker 6 of pose load-1 has the wrong sign"),
    "a digit in a photograph": (PHOTO, (0, misread(12, 2, digit(0.01, 1))), "z of marker 13 of pose load-1 is misread"),
}  # fmt: skip


def wrong(case):
    given, (pose, change), _ = CASES[case]
    study = cantilever(*given)
    return poses_exchanged(study, pose, change) if isinstance(change, int) else changed(study, pose, change)


SLOW = ("sign at a limp cable", "a digit at a limp cable", "sign in a photograph")


@pytest.mark.parametrize("case", [pytest.param(c, marks=pytest.mark.slow) if c in SLOW else c for c in CASES])
def test_a_misread_value_is_named(case):
    f = fit(wrong(case))
    assert [CASES[case][2] in str(m) for m in f.mistakes] == [True]
    assert f.answer.belief.startswith("no: the input is likely mistaken") and not f.believable
    found = fit(f.mistakes[0].study)
    assert found.mistakes == ()
    np.testing.assert_allclose(found.estimates["bending_stiffness"].value, CASES[case][0][0][1], rtol=0.03)


@pytest.mark.parametrize("given", [DIAL, TABLE, HANGS, PHOTO])
@pytest.mark.parametrize("seed", [1, 2])
def test_right_readings_are_no_mistake(given, seed):
    f = fit(cantilever(*given, seed=seed))
    assert f.mistakes == () and f.believable
    e = f.estimates["bending_stiffness"]
    assert e.low < given[0][1] < e.high


def test_settings_reach_the_search_of_misread_values():
    strict = Settings(outlier=1e-300, gross=1e-300)
    assert not any("is misread" in str(m) for m in fit(wrong("a dial reading halved"), settings=strict).mistakes)
