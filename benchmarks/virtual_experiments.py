"""The paper's two physical experiments (Section 6.1) as virtual ones, scanned and fitted: docs/scanning.md describes them.

`python -m benchmarks.virtual_experiments [--seeds N]` writes `benchmarks/results/virtual_experiments.json`. The scans of the
paper were never published, so its stiffnesses are the truth here: true shapes solve the continuous equations
(`tests/reference/cosserat_bvp.py`), seen by the package's scanner with noise, outliers, hidden backs, a clamp block at each
end and a table. Both cables are inextensible, and the clamps exact. Failures stay in the results.
"""

import argparse
import tempfile
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import jax
import numpy as np
import trimesh
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from benchmarks.curves import on_the_seen_side
from benchmarks.record import record
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.inference import fit
from scan2flex_jax.scan import scanner
from scan2flex_jax.study import Clamp, Study, StudyPose, Unknown
from tests.reference import cosserat_bvp, rotations

GRAVITY = 9.81
RIGID = 1.0e7  # N: an inextensible cable
START = np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]).T  # d3 = +x
SAMPLES = 801


@dataclass(frozen=True)
class Experiment:
    """A cable, its poses (name, role, twist in degrees), its end clamp, and how it is scanned."""

    title: str
    length: float
    radius: float
    density: float
    bending: float
    torsion: float
    unknowns: tuple[str, ...]
    poses: tuple[tuple[str, str, float], ...]
    end: tuple[float, float, float]
    turn: float  # degrees by which the end clamp is turned about the vertical
    sensor: scanner.Sensor
    eyes: tuple[tuple[float, float, float], ...]

    @property
    def truth(self) -> dict[str, float]:
        """The stiffnesses to be estimated."""
        known = {"bending_stiffness": self.bending, "torsional_stiffness": self.torsion}
        return {name: known[name] for name in self.unknowns}


_STIFF = ("bending_stiffness", "torsional_stiffness")
_TWISTS = (("minus-90", "fit", -90.0), ("zero", "fit", 0.0), ("plus-90", "fit", 90.0), ("plus-45", "validate", 45.0))
DRESS = Experiment(
    "dress pack", 1.4, 0.043, 3.0, 6.47, 33.38, _STIFF, _TWISTS, (1.05, 0.3, -0.1), 40.0, scanner.TIME_OF_FLIGHT,
    ((0.3, -1.7, 0.3), (0.9, 1.7, 0.4)),
)  # fmt: skip
PTFE = Experiment(
    "PTFE cable", 0.90, 0.004, 0.336, 0.0419, 0.0419, _STIFF[:1], (("sag", "fit", 0.0),), (0.5, 0.0, 0.05), 0.0,
    scanner.STRUCTURED_LIGHT, ((0.1, -0.7, 0.3), (0.5, 0.7, 0.2)),
)  # fmt: skip
EXPERIMENTS = {
    "dress pack, two views": DRESS,
    "dress pack, one view": replace(DRESS, eyes=DRESS.eyes[:1]),
    "PTFE cable, two views": PTFE,
    "PTFE cable, one view": replace(PTFE, eyes=PTFE.eyes[:1]),
}


@cache
def true_shape(x: Experiment, twist: float):
    """The centre line (SAMPLES, 3) in m at even arc length and the end frame, by collocation; twisted step by step."""
    level = rotations.about(np.array([0.0, 0.0, 1.0]), np.radians(x.turn)) @ START
    frames = [rotations.about(level[:, 2], np.radians(a)) @ level for a in np.linspace(0.0, twist, 1 + int(abs(twist) // 15))]
    K = np.array([x.bending, x.bending, x.torsion])
    rods = [cosserat_bvp.Clamped(x.length, K, GRAVITY * x.density, np.array(x.end), frame, START) for frame in frames]
    solution = cosserat_bvp.solve(rods, cosserat_bvp.sag_curve(rods[0]))
    return solution.positions(np.linspace(0.0, x.length, SAMPLES)), frames[-1]


def scanned(x: Experiment, twist: float, key: int) -> scanner.Scan:
    """A scan of one pose with the blocks of both clamps and a table in view."""
    curve, frame = true_shape(x, twist)
    blocks = [scanner.clamp_block(curve[0], -START[:, 2], x.radius), scanner.clamp_block(curve[-1], frame[:, 2], x.radius)]
    clutter = [*blocks, scanner.table(curve, x.radius)]
    return scanner.scan(curve, x.radius, np.array(x.eyes), x.sensor, key, clutter=clutter)


def guide_points(rng, curve, radius: float, eye, count: int = 8) -> np.ndarray:
    """Guide points as a user marks them: on the side that the first viewpoint sees, off by a third of the radius."""
    on = on_the_seen_side(curve, np.linspace(0.03 * len(curve), 0.97 * len(curve), count).astype(int), radius, eye)
    return on + 0.3 * radius * rng.normal(size=on.shape)


def study_of(x: Experiment, folder: Path, seed: int) -> Study:
    """The study as a user would hand it in, its clouds written to ``folder``."""
    poses = []
    for k, (name, role, twist) in enumerate(x.poses):
        trimesh.PointCloud(scanned(x, twist, 100 * seed + k).points).export(folder / f"{name}.ply")
        curve, frame = true_shape(x, twist)
        marks = guide_points(np.random.default_rng([31, seed]), curve, x.radius, np.array(x.eyes[0]))
        start = Clamp(np.zeros(3), rotations.quaternion(START))
        end = Clamp(np.array(x.end), rotations.quaternion(frame))
        seen = {"scan": folder / f"{name}.ply", "viewpoints": np.array(x.eyes), "guide_points": marks}
        poses.append(StudyPose(name, role, start, end, **seen))
    cable = {"length": x.length, "radius": x.radius, "length_density": x.density}
    cable |= {"shear_stiffness": RIGID, "axial_stiffness": RIGID, "torsional_stiffness": x.torsion}
    unknowns = tuple(Unknown(name) for name in x.unknowns)
    cable = {name: v for name, v in cable.items() if name not in x.unknowns}
    return Study(x.title, np.array([0.0, 0.0, -GRAVITY]), cable, tuple(poses), unknowns=unknowns, folder=folder)


def errors_along(x: Experiment, f, name: str, twist: float) -> dict:
    """Distances (mm) of a pose: from model to truth, at 57 points along s, and from data to model."""
    p, s = f.poses[name], np.linspace(0.0, x.length, 57)
    model = CubicSpline(np.linspace(0.0, x.length, len(p.modelled)), p.modelled)(s)
    from_truth = 1e3 * cKDTree(_fine(true_shape(x, twist)[0])).query(model)[0]
    rms = float(np.sqrt(np.mean(from_truth**2)))
    return {"role": p.role, "rms_data_mm": 1e3 * p.rms, "rms_truth_mm": rms, "max_truth_mm": float(from_truth.max())}


def _fine(points):
    at = np.linspace(0, len(points) - 1, 16 * len(points))
    return np.stack([np.interp(at, np.arange(len(points)), c) for c in points.T], axis=1)


def one_run(x: Experiment, study: Study) -> dict:
    """A fit compared with the truth, or the reason of its failure."""
    try:
        f = fit(study)
    except Scan2FlexError as refusal:
        return {"failed": str(refusal)}
    estimates = {}
    for name, true in x.truth.items():
        e = f.estimates[name]
        estimates[name] = {"value": e.value, "error": e.value / true - 1.0, "std": e.std}
        estimates[name]["covered"] = bool(e.low is not None and e.low <= true <= e.high)
    poses = {name: errors_along(x, f, name, twist) for name, _, twist in x.poses}
    return {"estimates": estimates, "valid": f.valid, "poses": poses, "messages": list(f.sentences)}


def summary(runs, truth) -> dict:
    """Coverage counted, errors and distances over all seeds."""
    good = [r for r in runs if "failed" not in r]
    out = {"runs": len(runs), "failed": len(runs) - len(good)}
    for name in truth:
        estimates = [r["estimates"][name] for r in good]
        stds = [e["std"] for e in estimates if e["std"]]
        out[name] = {
            "covered": sum(e["covered"] for e in estimates),
            "rms_error": float(np.sqrt(np.mean([e["error"] ** 2 for e in estimates]))) if good else None,
            "mean_relative_std": float(np.mean(stds)) / truth[name] if stds else None,
        }
    for role in ("fit", "validate"):
        far = [p["rms_truth_mm"] ** 2 for r in good for p in r["poses"].values() if p["role"] == role]
        out[f"{role} rms_truth_mm"] = float(np.sqrt(np.mean(far))) if far else None
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    seeds = parser.parse_args().seeds
    jax.config.update("jax_enable_x64", True)
    results = {"truth": {name: x.truth for name, x in EXPERIMENTS.items()}, "runs": {}, "summary": {}}
    for name, x in EXPERIMENTS.items():
        runs = results["runs"].setdefault(name, [])
        for seed in range(seeds):
            with tempfile.TemporaryDirectory() as folder:
                study = study_of(x, Path(folder), seed)
                runs.append({"seed": seed} | one_run(x, study))
        results["summary"][name] = summary(runs, x.truth)
        record("virtual_experiments", results)  # after each, so that an interrupted run leaves what it has
        print(f"{name}: {results['summary'][name]}", flush=True)


if __name__ == "__main__":
    main()
