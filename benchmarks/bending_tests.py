"""The six bending tests: a picture of their shapes, the closed forms beside the elastica, and what friction does to each.

    python -m benchmarks.bending_tests

A strip of EI = 2e-5 N m^2 is solved in each test. The stiffness that a test then gives is the EI of a linear cable with the
same reading. With friction (30 % of EI slips, from half of the largest curvature of the test on) the cable is loaded from
straight (first), or was loaded half as much again before (returned).
"""

from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import brentq

from benchmarks.record import record
from scan2flex_jax import Boundary, Cable, CableModel, equilibrium
from scan2flex_jax.cli.setup import prepare_jax
from scan2flex_jax.convert.bench import INCLINE, Bench, G
from scan2flex_jax.effects import AnisotropicBending, Friction, PointLoad, ordered
from scan2flex_jax.rod.energy import strains

PICTURE = Path(__file__).parents[1] / "docs" / "test-benches.png"
EI, W, SHARE = 2e-5, 0.02 * G, 0.3  # N m^2, N/m, of EI
ELEMENTS, FLAT = 80, 100.0
LEVEL, UP, DOWN = [np.sqrt(0.5), 0, np.sqrt(0.5), 0], [1, 0, 0, 0], [0, 0, -1, 0]
ORIGIN = [0.0, 0.0, 0.0]


@dataclass(frozen=True)
class Case:
    """A test: length (m), supports, load at the tip (N), gravity (m/s^2), and what is read: its name and the node."""

    length: float
    supports: tuple
    load: float
    gravity: tuple
    column: str
    node: int
    sign: float = -1.0


CASES = {
    "droop": Case(0.06, ((ORIGIN, LEVEL), None), 2e-4 * G, (0, 0, -G), "droop", -1),
    "peirce": Case(0.0951, ((ORIGIN, LEVEL), None), 0.0, (0, 0, -G), "overhang", -1),
    "three-point": Case(0.05, ((ORIGIN, LEVEL), None), -0.004, (0, 0, 0), "deflection", -1, 1.0),
    "heart": Case(0.3, ((ORIGIN, UP), (ORIGIN, DOWN)), 0.0, (0, 0, -G), "height", ELEMENTS // 2),
    "ring": Case(0.3, ((ORIGIN, LEVEL), (ORIGIN, LEVEL)), 0.0, (0, 0, -G), "depth", ELEMENTS // 2),
    "hanging": Case(0.3, ((ORIGIN, LEVEL), ([0.2, 0, 0], LEVEL)), 0.0, (0, 0, -G), "sag", ELEMENTS // 2),
}


def solved(case, stiffness, friction=None, factor=1.0, after=None, start=None):
    """The equilibrium of a test with loads times ``factor``, on the branch of a ``start``."""
    cable = Cable(case.length, W / G, stiffness, 0.8 * stiffness)
    load = PointLoad(np.asarray(case.length), np.array([0.0, 0.0, -factor * case.load]))
    strip = AnisotropicBending(np.asarray(FLAT), np.asarray(0.5 * np.pi))  # so that loops stay in their plane
    effects = [strip, load] if friction is None else [strip, load, friction]
    model = CableModel(cable, factor * np.array(case.gravity), ordered(effects))
    e = equilibrium(model, Boundary.of(*case.supports), elements=ELEMENTS, after=after, start=start)
    if not bool(e.verdict.solved):
        raise RuntimeError(e.verdict.sentence())
    return e


def reading(case, e):
    """The reading (m) of a solved test; of the overhang the height of the tip above the incline."""
    x, _, z = np.asarray(e.points[case.node])
    return float(z + x * np.tan(INCLINE)) if case.column == "overhang" else case.sign * float(z)


def apparent(case, value, start):
    """EI (N m^2) of a linear cable with a reading, over the true one."""
    return brentq(lambda log: reading(case, solved(case, EI * np.exp(log), start=start)) - value, -1.5, 1.0, xtol=1e-4)


def closed(name, case, value):
    """EI by the closed form over the true one."""
    row = {case.column: value if name != "peirce" else case.length}
    row |= {"weight": case.load / G} if name == "droop" else {}
    row |= {"force": -2 * case.load} if name == "three-point" else {}
    row |= {"span": 0.2} if name == "hanging" else {}
    bench = Bench(name, [row], ["row"], case.length, W / G, 2 * case.length)
    return None if bench.guess is None else bench.guess / EI


def one(name, case):
    """The figures of a test."""
    plain = solved(case, EI)
    if name == "peirce":  # the length at which the tip meets the incline
        length = brentq(lambda x: reading(c := Case(**{**vars(case), "length": x}), solved(c, EI)), 0.05, 0.15)
        case = Case(**{**vars(case), "length": length})
        plain = solved(case, EI)
    bent = np.linalg.norm(np.asarray(strains(plain.rod, plain.configuration))[:, 3:5], axis=1).max()
    friction = Friction(share=SHARE, slip_curvature=0.5 * bent / np.sqrt(0.5 * (1 + FLAT)))  # over the mean stiffness
    start = plain.configuration
    first, more = (solved(case, EI, friction, factor, start=start) for factor in (1.0, 1.5))
    returned = solved(case, EI, friction, after=more, start=more.configuration)
    value = reading(case, plain)
    step = 1e-3  # sensitivity of the reading to log EI
    ends = [reading(case, solved(case, EI * (1 + sign * step), start=start)) for sign in (1, -1)]
    slope = (ends[0] - ends[1]) / (2 * step)
    slope = case.length / 3 if name == "peirce" else slope  # the cube of the overhang is in proportion to EI
    return {
        "test": name, "reading": case.column, "value_mm": 1e3 * (case.length if name == "peirce" else value),
        "closed": closed(name, case, value), "mm_per_percent": 10.0 * abs(slope),
        "first": float(np.exp(apparent(case, reading(case, first), start))),
        "returned": float(np.exp(apparent(case, reading(case, returned), start))),
    }, np.asarray(plain.points)[:, [0, 2]]  # fmt: skip


def picture(shapes):
    """The shape of each test, with its clamps and what is read."""
    figure, axes = plt.subplots(2, 3, figsize=(9.5, 5.6), layout="constrained")
    for ax, (name, shape) in zip(axes.ravel(), shapes.items(), strict=True):
        points = shape
        if name == "three-point":
            points = np.concatenate([shape[::-1] * [-1, 1], shape])
            ax.plot(*points[[0, -1]].T, "k^", ms=9, zorder=3)
            ax.annotate("", (0.0, 0.0), (0.0, 0.008), arrowprops={"arrowstyle": "->", "color": "C3"})
        elif name == "peirce":
            reach = np.array([0.0, 1.1 * points[-1, 0]])
            ax.plot(reach, -reach * np.tan(INCLINE), "0.5", lw=1)
        ax.plot(*points.T, color="C0", lw=2)
        if name != "three-point":
            ends = points[[0, -1]] if name in ("heart", "ring", "hanging") else points[:1]
            ax.plot(*ends.T, "ks", ms=7)
        if CASES[name].load > 0:
            ax.plot(*points[-1], "o", color="C3", ms=8)
        ax.set_title(name, fontsize=11)
        ax.set_aspect("equal", adjustable="datalim")
        ax.set_axis_off()
    figure.savefig(PICTURE, dpi=110)


def main():
    prepare_jax()
    found = {name: one(name, case) for name, case in CASES.items()}
    picture({name: points for name, (_, points) in found.items()})
    record("bending_tests", {"share": SHARE, "rows": [figures for figures, _ in found.values()]})


if __name__ == "__main__":
    main()
