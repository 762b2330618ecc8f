"""Rods of an independent solver whose stiffness varies, each explained as a stranger's study.

    python -m benchmarks.rods [NAME ...]

Each rod is held level at one end and droops under its own weight and under weights at its tip, one way up and rolled by 180
degrees; nine markers a pose, noise 1 mm, stated. The study says "uniform". The solver is a plane elastica on 400 segments,
moments and angles in turn (numpy alone). Two rods are uniform: no field may be named.
"""

import sys
import time

import numpy as np

from benchmarks.record import complete, record, recorded
from scan2flex_jax import explain
from scan2flex_jax.cli.setup import prepare_jax
from scan2flex_jax.study import Clamp, EffectDeclaration, Markers, Study, StudyPose, Unknown

LENGTH, MASS, G, NOISE, SEGMENTS = 1.2, 0.05, 9.81, 1e-3, 400
WEIGHTS = {0.0: "fit", 0.01: "fit", 0.02: "validate", 0.03: "fit"}  # kg at the tip
PLACES = np.linspace(LENGTH / 9, LENGTH, 9)
TOLD = np.linspace(0.1, 0.9, 9) * LENGTH  # where EI is compared


def exponential(ratio):
    return lambda t: ratio ** (0.5 - t)


def linear_diameter(ratio):
    """A solid cone: EI with the fourth power of the diameter."""
    thin = ratio**-0.25
    return lambda t: ((1.0 - (1.0 - thin) * t) / (1.0 - 0.5 * (1.0 - thin))) ** 4


def steps(*values):
    return lambda t: np.array(values)[np.minimum((t * len(values)).astype(int), len(values) - 1)]


def sleeve(t):
    return np.where(np.abs(t - 0.4) < 0.1, 5.0, 1.0)


# name: EI over that of the middle at s/L, EI of the middle (N m^2), natural curvature (1/m), power of the mass along the rod
RODS = {
    "exponential 2": (exponential(2.0), 0.5, 0.0, 0.0),
    "exponential 10": (exponential(10.0), 0.5, 0.05, 0.0),
    "exponential 200": (exponential(200.0), 0.5, 0.0, 0.5),
    "cone 5": (linear_diameter(5.0), 0.4, 0.0, 0.5),
    "cone 50": (linear_diameter(50.0), 0.5, 0.05, 0.5),
    "two steps": (steps(4.0, 1.0), 0.4, 0.0, 0.5),
    "three steps": (steps(5.0, 1.0, 0.2), 0.5, 0.05, 0.5),
    "sleeve": (sleeve, 0.3, 0.0, 0.0),
    "uniform": (np.ones_like, 0.4, 0.0, 0.0),
    "uniform, bent": (np.ones_like, 0.3, 0.1, 0.0),
}


def drooped(EI, density, bend, weight):
    """Nodes (SEGMENTS + 1, 2) in m of a plane elastica, level at the start: horizontal, and up."""
    ds, angle = LENGTH / SEGMENTS, np.zeros(SEGMENTS)
    for _ in range(2000):
        x = np.r_[0.0, np.cumsum(np.cos(angle)) * ds]
        middle, load = 0.5 * (x[1:] + x[:-1]), density * ds
        outer = np.cumsum((load * middle)[::-1])[::-1] - 0.5 * load * middle  # half of its own segment
        borne = np.cumsum(load[::-1])[::-1] - 0.5 * load
        moment = -G * (outer - borne * middle + weight * (x[-1] - middle))
        strain = (moment / EI + bend) * ds
        turned = np.cumsum(strain) - 0.5 * strain
        off, angle = np.max(np.abs(turned - angle)), angle + 0.3 * (turned - angle)
        if off < 1e-12:
            break
    return np.stack([np.r_[0.0, np.cumsum(np.cos(angle))], np.r_[0.0, np.cumsum(np.sin(angle))]], axis=1) * ds


def study(name, seed, sides=(("up", 1.0), ("rolled", -1.0))):
    """The stranger's study of a rod, one way up and rolled."""
    form, middle, bend, power = RODS[name]
    rng, t = np.random.default_rng(seed), (np.arange(SEGMENTS) + 0.5) / SEGMENTS
    EI = middle * form(t)
    density = MASS / LENGTH * EI**power / np.mean(EI**power)
    poses, loads = [], []
    for roll, sign in sides:
        q = np.array([0.5, 0.0, 0.5, 0.0] if roll == "up" else [0.0, 0.5, 0.0, 0.5]) * np.sqrt(2.0)
        for weight, role in WEIGHTS.items():
            flat = drooped(EI, density, sign * bend, weight)
            at = np.linspace(0.0, LENGTH, SEGMENTS + 1)
            points = np.stack([np.interp(PLACES, at, flat[:, 0]), 0.0 * PLACES, np.interp(PLACES, at, flat[:, 1])], axis=1)
            points[:, [0, 2]] += NOISE * rng.standard_normal((len(PLACES), 2))
            points[:, 1] = np.nan
            held, markers = Clamp(np.zeros(3), q), Markers(points, PLACES)
            poses.append(StudyPose(f"{roll}-{1e3 * weight:.0f}", role, held, None, markers=markers, noise=NOISE))
    for weight in [w for w in WEIGHTS if w]:
        names = tuple(p.name for p in poses if p.name.endswith(f"-{1e3 * weight:.0f}"))
        loads.append(EffectDeclaration("point_mass", {"position": LENGTH, "mass": weight}, poses=names))
    cable = {"length": LENGTH, "length_density": MASS / LENGTH, "torsional_stiffness": 1.0}
    return Study.from_arrays(cable, poses, [Unknown("bending_stiffness")], effects=loads, title=name)


def row(name, seed):
    """What `explain` says of a rod, and EI beside the truth."""
    began, e = time.process_time(), explain(study(name, seed))
    form, middle, *_ = RODS[name]
    true, out = middle * form(TOLD / LENGTH), {"verdict": e.verdict, "found": [list(h.names) for h in _told(e)]}
    out["unseen_mm"] = [1e3 * e.rms("validate", after) for after in (False, True)]
    if e.along is not None:
        EI, low, high = e.along.at(TOLD)
        out |= {"off": float(np.max(np.abs(EI / true - 1.0))), "held": float(np.mean((low <= true) & (true <= high)))}
    return out | {"processor_seconds": time.process_time() - began}


def _told(e):
    return (e.decision.best, *e.decision.tied)


def main() -> None:
    prepare_jax()
    rows, seeds = recorded("rods").get("rods", {}), {name: 100 + k for k, name in enumerate(RODS)}
    complete(rows, sys.argv[1:] or list(RODS), lambda name: row(name, seeds[name]), lambda: record("rods", {"rods": rows}))


if __name__ == "__main__":
    main()
