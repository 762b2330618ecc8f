"""The paper's two physical experiments (Section 6.1) as virtual ones, fitted to curves and to clouds side by side.

`python -m benchmarks.virtual_experiments [--seeds N] [--pictures FOLDER]` from the repository's root writes
`benchmarks/results/virtual_experiments.json`. Their scans were never published, so the stiffnesses found in the paper are the
truth here: true shapes are those of the continuous equations (`tests/reference/cosserat_bvp.py`), not of the package's rod,
and the package's scanner sees them with its noise, outliers, hidden backs, a clamp block at each end and a table. Eight
guide points per pose are marked roughly on the seen side, as in the paper.

* *dress pack*: L 1.4 m, r 43 mm, 3 kg/m, EI 6.47, GJ 33.38 N m^2; twists of -90, 0 and 90 degrees are fitted, 45 is
  validated; a time-of-flight camera 1.6 m away, from two sides or from one.
* *PTFE cable*: L 0.90 m, r 4 mm, 0.336 kg/m, EI 0.0419 N m^2; structured light, one pose without torsion, EI only.

Both cables are inextensible. The clamps are exact, as the truth's. Coverage is that of the 95 % intervals. Failures stay in
the results.
"""

import argparse
import json
import sys
import tempfile
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from time import perf_counter

import jax
import numpy as np
import trimesh
from scipy.interpolate import CubicSpline
from scipy.spatial import cKDTree

from benchmarks.record import RESULTS, record
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.fitting import fit
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
        """The numbers to be found."""
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
    found = cosserat_bvp.solve(rods, cosserat_bvp.sag_curve(rods[0]))
    return found.positions(np.linspace(0.0, x.length, SAMPLES)), frames[-1]


def scanned(x: Experiment, twist: float, key: int) -> scanner.Scan:
    """A scan of one pose with the blocks of both clamps and a table in view."""
    curve, frame = true_shape(x, twist)
    blocks = [scanner.clamp_block(curve[0], -START[:, 2], x.radius), scanner.clamp_block(curve[-1], frame[:, 2], x.radius)]
    clutter = [*blocks, scanner.table(curve, x.radius)]
    return scanner.scan(curve, x.radius, np.array(x.eyes), x.sensor, key, clutter=clutter)


def marks(x: Experiment, twist: float, seed: int, count: int = 8) -> np.ndarray:
    """Guide points as a user marks them: on the side that the first eye sees, off by a third of the radius."""
    curve, _ = true_shape(x, twist)
    at = np.linspace(0.03 * SAMPLES, 0.97 * SAMPLES, count).astype(int)
    tangent = np.gradient(curve, axis=0)[at]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    look = np.array(x.eyes[0]) - curve[at]
    look -= np.sum(look * tangent, axis=1, keepdims=True) * tangent
    on = curve[at] + x.radius * look / np.linalg.norm(look, axis=1, keepdims=True)
    return on + 0.3 * x.radius * np.random.default_rng([31, seed]).normal(size=on.shape)


def study_of(x: Experiment, folder: Path, seed: int) -> Study:
    """The study as a user would hand it in, its clouds written to ``folder``."""
    poses = []
    for k, (name, role, twist) in enumerate(x.poses):
        trimesh.PointCloud(scanned(x, twist, 100 * seed + k).points).export(folder / f"{name}.ply")
        _, frame = true_shape(x, twist)
        start = Clamp(np.zeros(3), rotations.quaternion(START))
        end = Clamp(np.array(x.end), rotations.quaternion(frame))
        seen = {"scan": folder / f"{name}.ply", "viewpoints": np.array(x.eyes), "guide_points": marks(x, twist, seed)}
        poses.append(StudyPose(name, role, start, end, **seen))
    cable = {"length": x.length, "radius": x.radius, "length_density": x.density}
    cable |= {"shear_stiffness": RIGID, "axial_stiffness": RIGID, "torsional_stiffness": x.torsion}
    unknowns = tuple(Unknown(name) for name in x.unknowns)
    cable = {name: v for name, v in cable.items() if name not in x.unknowns}
    return Study(x.title, np.array([0.0, 0.0, -GRAVITY]), cable, tuple(poses), unknowns=unknowns, folder=folder)


def errors_along(x: Experiment, f, name: str, twist: float, count: int = 57) -> dict:
    """Point-wise distances (mm) of a pose along s, as in the paper's Fig. 4: model from truth, and data from model."""
    p = f.poses[name]
    truth, _ = true_shape(x, twist)
    s = np.linspace(0.0, x.length, count)
    model = CubicSpline(np.linspace(0.0, x.length, len(p.modelled)), p.modelled)(s)
    from_truth = cKDTree(_fine(truth)).query(model)[0]
    order = np.argsort(p.s)
    data = np.linalg.norm(p.residual, axis=1)[order]
    keep = np.linspace(0, len(order) - 1, min(count, len(order))).round().astype(int)
    return {
        "role": p.role,
        "rms_data_mm": 1e3 * p.rms,
        "max_data_mm": 1e3 * p.worst,
        "rms_truth_mm": 1e3 * float(np.sqrt(np.mean(from_truth**2))),
        "max_truth_mm": 1e3 * float(from_truth.max()),
        "along": {
            "s": np.round(s, 4).tolist(),
            "model_from_truth_mm": np.round(1e3 * from_truth, 3).tolist(),
            "s_data": np.round(p.s[order][keep], 4).tolist(),
            "data_from_model_mm": np.round(1e3 * data[keep], 3).tolist(),
        },
    }


def _fine(points):
    at = np.linspace(0, len(points) - 1, 16 * len(points))
    return np.stack([np.interp(at, np.arange(len(points)), c) for c in points.T], axis=1)


def one_run(x: Experiment, study: Study, data: str):
    """A fit compared with the truth, or the reason of its failure."""
    begin = perf_counter()
    try:
        f = fit(study, data=data)
    except Scan2FlexError as refusal:
        return {"data": data, "failed": str(refusal), "seconds": perf_counter() - begin}, None
    estimates = {}
    for name, true in x.truth.items():
        e = f.estimates[name]
        known = e.low is not None
        estimates[name] = {"value": e.value, "error": e.value / true - 1.0, "std": e.std, "low": e.low, "high": e.high}
        estimates[name] |= {"covered": bool(known and e.low <= true <= e.high)}
        estimates[name] |= {"z": (e.value - true) / e.std if known else None}
    run = {"data": data, "estimates": estimates, "seconds": perf_counter() - begin, "valid": f.valid}
    run["noise_mm"] = {"white": 1e3 * f.noise.white, "correlated": 1e3 * f.noise.correlated, "over": f.noise.correlation_length}
    run["poses"] = {name: errors_along(x, f, name, twist) for name, _, twist in x.poses}
    return run | {"messages": list(f.sentences)}, f


def told(name, seed, run):
    """One line per run."""
    if "failed" in run:
        return f"{name} seed {seed} {run['data']}: FAILED {run['failed']}"
    parts = [
        f"{n.split('_')[0]} {100 * e['error']:+.2f} % (z {e['z'] or np.nan:+.1f}{'' if e['covered'] else ', NOT COVERED'})"
        for n, e in run["estimates"].items()
    ]
    rms = " ".join(f"{p['rms_truth_mm']:.2f}/{p['rms_data_mm']:.2f}" for p in run["poses"].values())
    return f"{name} seed {seed} {run['data']}: {', '.join(parts)}; rms from truth/data mm {rms}; {run['seconds']:.1f} s"


def summary(runs, truth) -> dict:
    """Coverage counted, errors and distances over all seeds."""
    out = {}
    for data in ("cloud", "curve"):
        some = [r for r in runs if r["data"] == data]
        good = [r for r in some if "failed" not in r]
        out[data] = {"runs": len(some), "failed": len(some) - len(good)}
        for name in truth:
            found = [r["estimates"][name] for r in good]
            z = np.array([e["z"] for e in found if e["z"] is not None])
            out[data][name] = {
                "covered": sum(e["covered"] for e in found),
                "rms_error": float(np.sqrt(np.mean([e["error"] ** 2 for e in found]))) if found else None,
                "mean_error": float(np.mean([e["error"] for e in found])) if found else None,
                "mean_relative_std": float(np.mean([e["std"] for e in found if e["std"]])) / truth[name] if len(z) else None,
                "rms_z": float(np.sqrt(np.mean(z**2))) if len(z) else None,
            }
        for role in ("fit", "validate"):
            far = [p for r in good for p in r["poses"].values() if p["role"] == role]
            for key in ("rms_truth_mm", "rms_data_mm"):
                out[data][f"{role} {key}"] = float(np.sqrt(np.mean([p[key] ** 2 for p in far]))) if far else None
    return out


def picture(x: Experiment, f, run, path: Path) -> None:
    """Clouds with the fitted shapes, and the point-wise errors along s of all poses (the paper's Figs. 3 and 4)."""
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(12.0, 5.0), layout="constrained")
    space, along = figure.add_subplot(1, 2, 1, projection="3d"), figure.add_subplot(1, 2, 2)
    for k, (name, role, twist) in enumerate(x.poses):
        colour, cloud = f"C{k}", scanned(x, twist, k).points
        words = f"{name} ({'fitted' if role == 'fit' else 'never fitted'})"
        space.plot(*cloud[:: max(1, len(cloud) // 1500)].T, ".", ms=0.7, color=colour, alpha=0.4)
        space.plot(*f.poses[name].modelled.T, color=colour, label=words)
        e = run["poses"][name]["along"]
        along.plot(e["s_data"], e["data_from_model_mm"], color=colour, lw=0.8, alpha=0.5)
        along.plot(e["s"], e["model_from_truth_mm"], color=colour, lw=2.0, ls="-" if role == "fit" else "--", label=words)
    space.set_aspect("equal")
    space.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)")
    space.legend(fontsize="small")
    title = f"{x.title}: modelled from true centre line (thick), scan from model (thin)"
    along.set(xlabel="s (m)", ylabel="distance (mm)", ylim=(0.0, None))
    along.set_title(title, fontsize="medium")
    along.legend(fontsize="small")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130)


def drawn(results, path: Path, data: str = "cloud") -> None:
    """Point-wise distances along s of every pose, as in the paper's Fig. 4, from the record: the first run of each cable."""
    from matplotlib.figure import Figure  # noqa: PLC0415

    names = [name for name in EXPERIMENTS if name.endswith("two views") and results["runs"].get(name)]
    figure = Figure(figsize=(5.0 * len(names), 6.0), layout="constrained")
    rows = figure.subplots(2, len(names), squeeze=False, sharex="col")
    for (above, below), name in zip(rows.T, names, strict=True):
        run = next(r for r in results["runs"][name] if r["data"] == data and "failed" not in r)
        for k, (pose, p) in enumerate(run["poses"].items()):
            e, unseen = p["along"], p["role"] == "validate"
            label, style = f"{pose}{', never fitted' if unseen else ''}", "--" if unseen else "-"
            above.plot(e["s"], e["model_from_truth_mm"], style, lw=1.8, color=f"C{k}", label=label)
            below.plot(e["s_data"], e["data_from_model_mm"], "s" if unseen else "o", ms=3, color=f"C{k}")  # no line over gaps
        above.set(ylabel="modelled to true\ncentre line (mm)", ylim=(0.0, None))
        below.set(xlabel="s (m)", ylabel="scan to modelled\ncentre line (mm)", ylim=(0.0, None))
        above.set_title(name, pad=40)
        above.legend(frameon=False, fontsize="small", loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=2)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=130)


def main() -> None:
    """Run all experiments with several seeds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draw", type=Path, help="draw what the record has into this file, and run nothing")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--only", default="", help="experiments whose name holds this")
    parser.add_argument("--pictures", type=Path)
    options = parser.parse_args()
    if options.draw:
        drawn(json.loads((RESULTS / "virtual_experiments.json").read_text())["results"], options.draw)
        return
    jax.config.update("jax_enable_x64", True)
    results = {"truth": {name: x.truth for name, x in EXPERIMENTS.items()}, "runs": {}, "summary": {}}
    for name, x in EXPERIMENTS.items():
        runs = results["runs"].setdefault(name, [])
        for seed in range(options.seeds if options.only in name else 0):
            with tempfile.TemporaryDirectory() as folder:
                study = study_of(x, Path(folder), seed)
                for data in ("cloud", "curve"):
                    run, f = one_run(x, study, data)
                    runs.append({"seed": seed} | run)
                    sys.stderr.write(told(name, seed, run) + "\n")
                    if options.pictures and f is not None and seed == 0:
                        picture(x, f, run, options.pictures / f"{name.replace(', ', '-').replace(' ', '-')}-{data}.png")
        if runs:
            results["summary"][name] = summary(runs, x.truth)
            if not options.only:
                record("virtual_experiments", results)  # after each, so that an interrupted run leaves what it has
            sys.stderr.write(f"{results['summary'][name]}\n")


if __name__ == "__main__":
    main()
