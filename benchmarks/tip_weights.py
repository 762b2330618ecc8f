"""Real cables with and without a weight at the tip, for the notebook "Weights on a soft robot arm".

The notebook says where the data are from; they have no licence, so nothing of them is kept here.

How a row is read (x to the side, z up, metres, radians): the clamp is turned by `Gamma` about y from a cable that hangs down,
`X, Z` are the markers in the turned frame, at L/2 and L. Poses are planar, so GJ is given and without influence on them. By
angle, every third pose is fitted from the first on; the others are `validate`. Poses stand in the order of the file, to both
sides by turns and further each time: it is taken for the order of measurement, and effects with memory need it.
"""

import csv
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from scan2flex_jax.prediction import predict
from scan2flex_jax.study import EffectDeclaration, Markers, Study, Unknown

FOLDER = "fixed_base/data_in/0802-equilibrium_data"
EVERY = 3  # of the poses, sorted by angle, is fitted
GJ = 0.1  # N m^2
CARRIED = 0.04  # relative standard deviation with which EI is carried over to another series
HANGING = np.array([[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])  # columns d1, d2, d3: down; d2 = y bends it in plane


@dataclass(frozen=True)
class Series:
    """One cable with one weight (kg, m); per pose its angle (rad) and markers (n, 2, 2)."""

    name: str
    mass: float
    end_mass: float
    length: float
    diameter: float
    angles: np.ndarray
    markers: np.ndarray


def read(cable, weighted, measured: Path, stated: Path) -> Series:
    """A series of the clones in the order of its file."""
    name = f"{cable}_{'' if weighted else 'un'}weighted"
    table = measured / FOLDER / f"{name}_equilibria" / "theta_equilibria.csv"
    constants = stated / "object_parameters" / f"{name}.txt"
    for path in (table, constants):
        if not path.is_file():
            sys.exit(f"{path} is missing: name the folders of PAC_model_matlab and floating_PAC_model")
    mass, end_mass, length, diameter, *_ = map(float, constants.read_text().strip().split(","))
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    markers = [[[float(row[f"{axis}_{place}"]) for axis in "XZ"] for place in ("mid", "end")] for row in rows]
    return Series(name, mass, end_mass, length, diameter, np.array([float(row["Gamma"]) for row in rows]), np.array(markers))


def poses_of(series: Series) -> list[dict]:
    """The poses as `Study.from_arrays` takes them."""
    out, ranks = [], np.argsort(np.argsort(series.angles)).tolist()
    for k, angle, seen in zip(ranks, series.angles, series.markers, strict=True):
        c, s = np.cos(angle), np.sin(angle)
        R = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        points = np.stack([seen[:, 0], np.zeros(2), seen[:, 1]], axis=1) @ R.T
        markers = Markers(points, [series.length / 2, series.length])
        pose = {"name": f"{series.name}-{k:02d}", "role": "validate" if k % EVERY else "fit"}
        out.append(pose | {"start": ([0.0, 0.0, 0.0], R @ HANGING), "markers": markers})
    return out


def study_of(series: Series, fitting: float, unknowns=("bending_stiffness",), effects=()):
    """One series, its fitting (kg) declared at the tip."""
    cable = {"length": series.length, "radius": series.diameter / 2, "length_density": series.mass / series.length}
    held = EffectDeclaration("point_mass", {"position": series.length, "mass": fitting})
    cable["torsional_stiffness"] = GJ
    return Study.from_arrays(cable, poses_of(series), unknowns, title=series.name, effects=(held, *effects))


def of_explanation(explanation, seconds: float) -> dict:
    """The estimates of an explanation, and its effects in short."""
    estimates = explanation.to_json()["estimates"]
    return {"estimates": estimates, "added": [r.in_short() for r in explanation.chosen], "seconds": seconds}


def carried_over(figures: dict) -> dict:
    """EI with its prior, and the effects, of an explanation of the series without the weight (`of_explanation`)."""
    EI = figures["estimates"]["bending_stiffness"]["value"]
    effects = tuple(EffectDeclaration(c["kind"], c["parameters"]) for c in figures["added"])
    return {"unknowns": [Unknown("bending_stiffness", prior={"mean": EI, "std": CARRIED * EI})], "effects": effects}


def predicted(study, EI: float) -> dict:
    """RMS distance (m) of the markers of each role from the cable of this EI, nothing fitted."""
    known = replace(study, cable=study.cable | {"bending_stiffness": EI}, unknowns=())
    errors: dict[str, list[float]] = {"fit": [], "validate": []}
    for pose, shape in zip(known.poses, predict(known).values(), strict=True):
        at = [np.interp(pose.markers.arc_length, shape.s, x) for x in shape.points.T]
        errors[pose.role].append(float(np.mean(np.sum((np.transpose(at) - pose.markers.points) ** 2, axis=1))))
    return {"after": {f"rms_{role}": float(np.sqrt(np.mean(e))) for role, e in errors.items()}}
