"""`explain` on scans compared with curves: false alarms, and effects that are named from both.

    python -m benchmarks.scan_alarms --json FILE [--none 40] [--strong 20] [--seed 1] [--data scan] [--record NAME]

Cables, poses and true shapes come from the independent rod of `benchmarks.blind`. Each study has one of four sensors,
structured light or time of flight, of the package's scanner or of `benchmarks.cameras`, which sees it from one to three sides,
with clamp blocks, something beside the cable, and up to two stretches that nothing shows. `none` studies miss nothing: any
verdict but "no missing effect" is an alarm. `strong` ones miss one effect of 4 to 10 times the noise of `SENSED`; the scan
should name the same effect as curves of the same poses with white noise of that size. Results of an earlier run in the
file are kept.
"""

import argparse
import json
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
import trimesh

from benchmarks import cameras
from benchmarks.blind import cases, effects, rod
from benchmarks.blind.noise import Noise
from benchmarks.blind.scene import observation_matrix
from benchmarks.blind.shapes import Lens
from benchmarks.blind_score import NAMED, STIFFNESSES, covered, share
from benchmarks.curves import arc_lengths, unit_tangents
from benchmarks.record import complete, record
from benchmarks.virtual_experiments import guide_points
from scan2flex_jax.cli.setup import prepare_jax
from scan2flex_jax.inference import explain
from scan2flex_jax.scan import scanner
from scan2flex_jax.study import Study

SENSED = 5e-4  # m, of one coordinate of the curves for comparison
STRENGTH = (4.0, 10.0)  # over it, log-uniform, as `blind.cases` measures it
POINTS, FINE = 120, 401  # of a curve, and of the shape that the scanner sees
THINNEST = {"light": 0.003, "flight": 0.008}  # m: a radius below the noise of time of flight is refused
THICKEST, OF_LENGTH, BENT = 0.025, 1 / 30, 0.3  # m, radius over the length, over the radius of the sharpest bend
UNSEEN, MOST_UNSEEN = (0.03, 0.1), 2  # of the length, stretches of a pose
MOST_POSES = 5  # that are fitted: each takes seconds to extract
ATTEMPTS = 60
CLEAR, REFUSED = "no missing effect", "fault"


def make(key, kinds):
    """A cable with true shapes: `(scene, fit, truth, shapes (P, FINE, 3), radius)`, or None where a draw fails."""
    rng = np.random.default_rng(key)
    posed = cases.pose_cable(rng, kinds, cases.FEWEST_FIT)
    if posed is None or posed[2] > MOST_POSES:
        return None
    scene, y, fit = posed
    base, truth = cases.compared(scene, y, kinds), []
    if base is None:
        return None
    s = [np.linspace(0, scene.cable.length, POINTS)] * fit
    strength = cases.strength_on(base, Lens(base.F.sigma, scene.cable.length, s, Noise(SENSED)))
    for kind in kinds:
        goal = np.exp(rng.uniform(*np.log(STRENGTH)))
        effect = cases.scaled(rng, kind, base, strength, (0.9 * STRENGTH[0], goal))
        if effect is None:
            return None
        truth.append(effect)
    seen = cases.observe(scene, y, truth, [np.linspace(0, 1, FINE)] * len(y))
    if seen is None:
        return None
    shapes, sensor = np.array(seen["shapes"]), draw_sensor(rng)
    bend = max(float(np.linalg.norm(np.diff(unit_tangents(x), axis=0), axis=1).max()) for x in shapes) * (FINE - 1)
    thin, thick = THINNEST[sensor["kind"]], min(THICKEST, scene.cable.length * min(OF_LENGTH, BENT / bend))
    return None if thick < thin else (scene, fit, truth, shapes, np.exp(rng.uniform(*np.log((thin, thick)))), sensor)


def draw_sensor(rng):
    """The sensor of a study: of the package or not, its kind, the noise (m) of a depth at 1 m where it is drawn."""
    kind = str(rng.choice(["light", "light", "flight"]))
    noise = rng.uniform(3e-4, 1e-3) if kind == "light" else rng.uniform(1e-3, 3e-3)
    return {"kind": kind, "own": bool(rng.integers(2)), "noise": float(noise), "views": int(rng.integers(1, 4))}


def eyes(rng, shape, count):
    """Viewpoints (count, 3), m: around the cable, about as far off as it is long."""
    middle, size = shape.mean(axis=0), np.ptp(shape, axis=0).max()
    first = rng.normal(size=3)
    out = []
    for k in range(count):
        way = first if k == 0 else rng.normal(size=3) - 0.7 * first
        out.append(middle + rng.uniform(1.0, 1.5) * (size + 0.2) * way / np.linalg.norm(way))
    return np.array(out)


def scanned(rng, shape, radius, sensor, ends, path):
    """A scan of one shape written to ``path``: its viewpoints, and guide points on the side that the first one sees."""
    views, tangents = eyes(rng, shape, sensor["views"]), unit_tangents(shape)
    held = [(shape[k], way) for k, way, holds in zip((0, -1), (-tangents[0], tangents[-1]), ends, strict=True) if holds]
    middles, widths = rng.uniform(0.15, 0.85, MOST_UNSEEN), rng.uniform(*UNSEEN, MOST_UNSEEN)
    unseen = [(m - w / 2, m + w / 2) for m, w in zip(middles, widths, strict=True)][: int(rng.integers(MOST_UNSEEN + 1))]
    if sensor["own"]:
        kind = scanner.STRUCTURED_LIGHT if sensor["kind"] == "light" else scanner.TIME_OF_FLIGHT
        clutter, length = [scanner.clamp_block(*one, radius) for one in held], arc_lengths(shape)[-1]
        gaps = [(length * a, length * b) for a, b in unseen]
        points = scanner.scan(shape, radius, views, kind, int(rng.integers(2**31)), gaps=gaps, clutter=clutter).points
    else:
        scene = cameras.Scene(shape, radius, tuple(beside(rng, shape, radius, held)), tuple(unseen))
        seen = cameras.structured_light if sensor["kind"] == "light" else cameras.time_of_flight
        points = np.concatenate([seen(rng, scene, eye, sensor["noise"]) for eye in views])
    trimesh.PointCloud(points).export(path)
    return {"scan": path, "viewpoints": views, "guide_points": guide_points(rng, shape, radius, views[0])}


def beside(rng, shape, radius, held):
    """Blocks of the clamps, and a rod that passes the cable."""
    for position, outward in held:
        axes = np.linalg.qr(np.c_[outward, rng.normal(size=(3, 2))])[0].T
        yield cameras.box(position + 3 * radius * outward, axes, 3 * radius * np.ones(3))
    at = int(rng.integers(FINE // 5, 4 * FINE // 5))
    tangent, away, along = unit_tangents(shape)[at], rng.normal(size=3), rng.normal(size=3)
    away = np.cross(tangent, away) / np.linalg.norm(np.cross(tangent, away))
    along = np.cross(along, away) / np.linalg.norm(np.cross(along, away))
    middle = shape[at] + rng.uniform(2.2, 4.0) * radius * away
    yield cameras.rod(middle - 0.15 * along, middle + 0.15 * along, rng.uniform(0.3, 1.0) * radius)


def studies(key, made, folder):
    """The study of scans, and the one of curves with white noise, of the same poses."""
    (scene, fit, _, shapes, radius, sensor), rng, poses = made, np.random.default_rng([*key, 1]), {"scan": [], "curve": []}
    view = observation_matrix(np.linspace(0, 1, FINE), np.linspace(0, 1, POINTS))
    for p, shape in enumerate(shapes):
        held = {"name": f"p{p + 1}", "role": "fit" if p < fit else "validate"}
        held["start"] = (scene.start[0][p], scene.start[1][p])
        if scene.end_kind[p] != rod.FREE:
            held["end"] = (scene.end[0][p], scene.end[1][p] if scene.end_kind[p] == rod.CLAMP else None)
        ends = True, scene.end_kind[p] == rod.CLAMP
        poses["scan"].append(held | scanned(rng, shape, radius, sensor, ends, folder / f"p{p + 1}.ply"))
        poses["curve"].append(held | {"points": view @ shape + SENSED * rng.normal(size=(POINTS, 3))})
    cable = {"length": scene.cable.length, "radius": radius, "length_density": scene.cable.density}
    cable |= {"axial_stiffness": scene.cable.axial, "shear_stiffness": scene.cable.shear}
    make = partial(Study.from_arrays, cable, unknowns=STIFFNESSES, gravity=scene.gravity)
    return {data: make(poses=some, title=data) for data, some in poses.items()}


def answered(study) -> dict:
    """The answer of `explain`, or its failure."""
    try:
        answer = explain(study).to_json()
    except Exception as fault:  # a benchmark counts failures
        return {"verdict": REFUSED, "fault": f"{type(fault).__name__}: {fault}"[:300]}
    return {k: answer[k] for k in ("verdict", "chosen", "estimates") if k in answer}


def one(seed, index, kinds, data) -> dict:
    """One case: its truth and the answers to the ``data`` asked for; a draw that fails a check is drawn again."""
    for attempt in range(ATTEMPTS):
        key = [seed, index, attempt]
        made = make(key, kinds)
        if made is not None:
            break
    else:
        return {"kinds": list(kinds), "scan": {"verdict": REFUSED, "fault": f"no design in {ATTEMPTS} attempts"}}
    cable = made[0].cable
    true = {"bending_stiffness": cable.bending, "torsional_stiffness": cable.torsion}
    out = {"kinds": list(kinds), "truth": made[2], "true": true, "radius": made[4], "sensor": made[5]}
    with tempfile.TemporaryDirectory() as folder:
        both = studies(key, made, Path(folder))
        out |= {name: answered(both[name]) for name in data}
    return out


def kinds_of(row, data) -> set:
    """The effect types of an answer."""
    return {c["kind"] for c in row.get(data, {}).get("chosen", [])}


def named(row, data) -> set:
    """The effect types that an answer names."""
    return kinds_of(row, data) if row.get(data, {}).get("verdict") in NAMED else set()


def held(rows, data):
    """Share of the intervals of stiffnesses that hold the truth."""
    inside = []
    for r in rows:
        true = {f"true_{name}": value for name, value in r["true"].items()}
        inside += covered("covers", r[data].get("estimates", {}), true).values()
    return share(inside)


def alarms(rows, data):
    return share(r[data]["verdict"] != CLEAR for r in rows if r[data]["verdict"] != REFUSED)


def refused(rows):
    return share(r["scan"]["verdict"] == REFUSED for r in rows)


NOTHING_MISSING = [
    ("nothing missing: scans that raise an alarm at the 5 % level", "3 of 40 at most", lambda rows: alarms(rows, "scan")),
    ("nothing missing: scans that are refused, in one sentence", None, refused),
    ("the same poses as curves", None, lambda rows: alarms(rows, "curve")),
    ("nothing missing: 95 % intervals of EI and GJ from scans that hold the truth", "92-97 %", lambda rows: held(rows, "scan")),
    ("the same from curves", "92-97 %", lambda rows: held(rows, "curve")),
]
STRONG = [
    ("a strong effect: named alone from curves", None, lambda rows: share(named(r, "curve") for r in rows)),
    ("a strong effect: named alone from scans", None, lambda rows: share(named(r, "scan") for r in rows)),
    ("from scans, and rightly", None, lambda rows: share(named(r, "scan") == set(r["kinds"]) for r in rows)),
    ("the likeliest from scans is the true one, ties included", None,
     lambda rows: share(kinds_of(r, "scan") == set(r["kinds"]) for r in rows)),
    ("from scans as from curves", "16 of 20",
     lambda rows: share(named(r, "curve") and named(r, "scan") == named(r, "curve") for r in rows)),
    ("the same answer as from curves, ties and unexplained cases included", None, lambda rows: share(
        r["scan"].get("verdict") == r["curve"].get("verdict") and kinds_of(r, "scan") == kinds_of(r, "curve") for r in rows)),
]  # fmt: skip
"""Words, target, and share, of the rows of studies with nothing missing and of those with a strong effect."""


def scored(rows: dict) -> list[tuple]:
    """Words, value and target of each line."""
    of_class = {way: [r for r in rows.values() if bool(r["kinds"]) == way and "true" in r] for way in (False, True)}
    lines = [(some, *line) for way, some in of_class.items() if some for line in (STRONG if way else NOTHING_MISSING)]
    lines = [line for line in lines if "curve" not in line[1] or all("curve" in r for r in line[0])]
    return [(words, value(some), target) for some, words, target, value in lines]


def wanted(args) -> dict:
    """Name, place in the seed's sequence, and effect types of each case."""
    kinds = list(np.random.default_rng([args.seed, 0, 0, 3]).permutation(list(effects.CATALOGUE)))
    out = {f"n{k + 1:03d}": (k, ()) for k in range(args.none)}
    return out | {f"e{k + 1:03d}": (1000 + k, (str(kinds[k % len(kinds)]),)) for k in range(args.strong)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", type=Path, required=True, help="results so far: a run that was stopped goes on from it")
    parser.add_argument("--none", type=int, default=40, help="studies with nothing missing")
    parser.add_argument("--strong", type=int, default=20, help="studies with a strong effect")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--record", help="name of the record, such as scan_sensors")
    parser.add_argument("--data", nargs="+", default=["scan", "curve"], choices=["scan", "curve"])
    args = parser.parse_args()
    prepare_jax()
    rows = json.loads(args.json.read_text())["rows"] if args.json.exists() else {}
    cases = wanted(args)
    keep = lambda: args.json.write_text(json.dumps({"rows": rows}, indent=1) + "\n")  # noqa: E731
    complete(rows, cases, lambda name: one(args.seed, *cases[name], args.data), keep)
    if args.record:
        record(args.record, {"rows": rows})
    for words, value, _ in scored(rows):
        print(f"{words}: {value}")


if __name__ == "__main__":
    main()
