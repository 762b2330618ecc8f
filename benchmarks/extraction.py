"""Extraction of centre curves from simulated scans: accuracy, automatic against numerical gradient, time and memory.

`python -m benchmarks.extraction [--quick] [--resume] [--only-cases | --only-rest] [--keys K ...]` from the repository's root
writes `benchmarks/results/extraction.json`.

Curves of four families that no rod model made, two sensors, one to three viewpoints, with and without a gap and guide
points. Failures stay in the results. Single-point noise is the sensor's standard deviation along the ray at the range of
the scan; targets: RMS at most 0.3 (structured light) or 0.5 (time of flight) of it, bias toward the sensor at most 0.2 of
the radius, length from clamp to clamp within 0.5 % (the curve and what is missing at its ends, as the package tells it to a
user; `arc_error` compares the arc alone with the same stretch of the true one). A case is

* *met*: within all targets, and nothing speaks against it;
* *not sure*: the curve comes with doubts, right or wrong; *refused*: there is no curve;
* *missed*: a target is missed, and nothing was said. This is the class by which users are hurt.

Beside every error stands what the points can tell at all, `bound_mm`: the Cramer-Rao bound on the RMS distance for a spline
of the fewest points that draws the true curve to a twentieth of the noise, from the true points (no flying ones, no
strays), their viewpoints and their noise. No estimator that is right on average comes below it; one that knows more of the
cable than that it is a smooth tube may. Where a part was not seen, the bound grows with what is guessed there.
"""

import argparse
import itertools
import json
import os
import resource
import time
from collections import Counter

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp  # noqa: E402
import numpy as np  # noqa: E402
from scipy.spatial import cKDTree  # noqa: E402

from benchmarks.record import RESULTS, record  # noqa: E402
from scan2flex_jax.errors import Scan2FlexError  # noqa: E402
from scan2flex_jax.scan import refine, scanner, shapes, snakes, snakes_minimisers, spline  # noqa: E402
from scan2flex_jax.scan.extraction import extract  # noqa: E402
from scan2flex_jax.scan.plausibility import clamp_to_clamp  # noqa: E402
from scan2flex_jax.scan.strand_matching import End  # noqa: E402

VIEWS = np.array([[0.3, -1.0, 0.6], [0.3, 1.0, 0.5], [-1.0, 0.1, 0.6]])
SENSORS = {"structured light": scanner.STRUCTURED_LIGHT, "time of flight": scanner.TIME_OF_FLIGHT}
TARGET = {"structured light": 0.3, "time of flight": 0.5}
CABLES = ((1.0, 0.004), (1.0, 0.012), (1.8, 0.045))  # length, radius (m)


def ends(curve):
    """Both clamps of a true curve, with their directions."""
    tangent = np.gradient(curve, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return End(curve[0], tangent[0]), End(curve[-1], tangent[-1])


def guides(curve, radius, eye, count=10):
    """Points that a user would mark: on the side that the first viewpoint sees."""
    some = curve[np.linspace(8, len(curve) - 9, count).astype(int)]
    look = eye - some
    tangent = np.gradient(curve, axis=0)[np.linspace(8, len(curve) - 9, count).astype(int)]
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    look -= np.sum(look * tangent, axis=1, keepdims=True) * tangent
    return some + radius * look / np.linalg.norm(look, axis=1, keepdims=True)


def fewest_knots(curve, noise):
    """The smallest spline that draws the curve to a twentieth of the noise (RMS)."""
    at = np.linspace(0.0, 1.0, len(curve))
    for count in range(6, 80, 2):
        W = np.asarray(spline.weights(count, jnp.asarray(at * (count - 1))))
        left = curve - W @ np.linalg.lstsq(W, curve, rcond=None)[0]
        if np.sqrt(np.mean(np.sum(left**2, axis=1))) < 0.05 * noise:
            break
    return count


def bound(curve, radius, scan, eyes, sensor, noise):
    """Cramer-Rao bound (m) on the RMS distance of a centre curve, on all of it and on what lies near points."""
    K = fewest_knots(curve, noise)
    fine = shapes.resample(curve, 4001)
    tangent = np.gradient(fine, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normals = np.linalg.svd(tangent[:, None])[2][:, 1:]
    frame = normals[np.linspace(0, 4000, K).round().astype(int)]
    H = np.eye(2 * K) / (5.0 * radius) ** 2  # far from the cloud nothing is known but that the cable is near
    seen = np.zeros(len(fine), bool)
    for v, eye in enumerate(eyes):
        points = scan.points[scan.on_cable & (scan.view == v)]
        which = cKDTree(fine).query(points)[1]
        seen[which] = True
        _, n, blur, _ = refine.along_ray(points, fine[which], tangent[which], eye[None], radius)
        sigma = sensor.noise * np.linalg.norm(points - eye, axis=1) ** sensor.noise_growth * blur[0]
        W = np.asarray(spline.weights(K, jnp.asarray(which / 4000 * (K - 1))))
        J = (W[:, :, None] * np.einsum("kci,ni->nkc", frame, n[0])).reshape(len(W), 2 * K) / sigma[:, None]
        H += J.T @ J
    every = np.arange(0, 4001, 10)
    W = np.asarray(spline.weights(K, jnp.asarray(every / 4000 * (K - 1))))
    cov = np.linalg.inv(H).reshape(K, 2, K, 2)
    variance = sum(np.einsum("nk,kl,nl->n", W, cov[:, c, :, c], W) for c in range(2))
    near = np.convolve(seen, np.ones(41), "same")[every] > 0
    return {"bound_mm": 1e3 * float(np.sqrt(np.mean(variance))), "bound_seen_mm": 1e3 * float(np.sqrt(np.mean(variance[near])))}


def compare(found, curve, radius, noise, eyes):
    """Errors of an extracted curve beside the true one, between the true clamps."""
    fine = shapes.resample(curve, 8001)
    away, which = cKDTree(fine).query(found.points)
    look = eyes.mean(axis=0) - fine[which]
    look /= np.linalg.norm(look, axis=1, keepdims=True)
    length = shapes.arc_length(fine)[-1]
    seen = np.ones(len(away), bool)
    for a, b in found.gaps:
        seen &= (found.arc_length < a) | (found.arc_length > b)
    return {
        "rms_mm": 1e3 * float(np.sqrt(np.mean(away**2))),
        "rms_seen_mm": 1e3 * float(np.sqrt(np.mean(away[seen] ** 2))),
        "rms_over_noise": float(np.sqrt(np.mean(away**2)) / noise),
        "rms_seen_over_noise": float(np.sqrt(np.mean(away[seen] ** 2)) / noise),
        "bias_over_radius": float(np.mean(np.sum((found.points - fine[which]) * look, axis=1)) / radius),
        "length_error": float(clamp_to_clamp(found, *ends(curve)) / length - 1.0),
        "arc_error": float(found.length / max(abs(which[-1] - which[0]) / 8000.0 * length, 1e-9) - 1.0),
        "sure": found.sure,
        "doubts": list(found.doubts),
        "std_mm": 1e3 * float(np.sqrt(np.mean(found.std**2))),
        "gaps": [list(gap) for gap in found.gaps],
        "found_by": found.found_by,
        "along_ray": found.along_ray,
    }


def one_case(family, length, radius, sensor, views, gap, guided, table, key):
    """Scan a curve, extract it, compare."""
    curve = shapes.random_smooth(length, radius, key) if family == "random" else shapes.FAMILIES[family](length, radius)
    eyes = VIEWS[:views] * (1.0 if length < 1.5 else 1.4)
    clutter = [scanner.table(curve, radius)] if table else []
    gaps = ((0.35 * length, 0.45 * length),) if gap else ()
    scan = scanner.scan(curve, radius, eyes, SENSORS[sensor], key, gaps=gaps, clutter=clutter)
    reach = np.mean(np.linalg.norm(curve[None] - eyes[:, None], axis=2))
    noise = SENSORS[sensor].noise * reach ** SENSORS[sensor].noise_growth
    start, end = ends(curve)
    marks = guides(curve, radius, eyes[0]) if guided else None
    case = {"family": family, "radius": radius, "length": length, "sensor": sensor, "views": views, "gap": gap}
    case |= {"guide_points": guided, "table": table, "key": key, "points": len(scan.points), "noise_mm": 1e3 * float(noise)}
    case |= bound(curve, radius, scan, eyes, SENSORS[sensor], noise)
    began = time.perf_counter()
    try:
        known = {"length": length, "start": start, "end": end, "guide_points": marks, "viewpoints": eyes}
        found = extract(scan.points, radius, **known)
        case |= compare(found, curve, radius, noise, eyes)
        near = case["rms_over_noise"] <= TARGET[sensor] and case["bias_over_radius"] <= 0.2
        case["ok"] = bool(near and abs(case["length_error"]) <= 0.005)
        case["class"] = "not sure" if not found.sure else "met" if case["ok"] else "missed"
    except Scan2FlexError as refusal:
        case |= {"ok": False, "class": "refused", "refused": str(refusal)}
    case["seconds"] = time.perf_counter() - began
    return case


def specifications(quick: bool):
    """The cases by key: families x cables x sensors x viewpoints, plain, with guide points, with a gap, with a table."""
    kinds = ((False, False, False), (False, True, False), (True, False, False), (False, False, True))
    seen = itertools.product(shapes.FAMILIES, CABLES, SENSORS, (1, 2, 3), kinds[: 1 if quick else 4])
    return {k: (family, *cable, sensor, views, *kind, k) for k, (family, cable, sensor, views, kind) in enumerate(seen)}


def accuracy(wanted, results):
    """The cases, added to the results and written as they come, so that an interrupted run can be gone on with."""
    done = {case["key"]: case for case in results.get("cases", [])}
    for key, specification in wanted.items():
        if key not in done:
            done[key] = one_case(*specification)
            print(_line(done[key]), flush=True)
            results["cases"] = [done[k] for k in sorted(done)]
            record("extraction", results)


def _line(case):
    keys = ("family", "radius", "sensor", "views", "gap", "guide_points", "table", "class")
    rest = ("bound_mm", "rms_over_noise", "rms_seen_over_noise", "bias_over_radius", "length_error", "seconds")
    numbers = [f"{k}={case[k]:.4f}" for k in rest if k in case]
    return " ".join([*(str(case.get(k)) for k in keys), *numbers, case.get("refused", "")[:60]])


def timed(x0, problem, method, steps):
    """A run of a minimiser without its compilation."""
    snakes_minimisers.minimise_snakes(x0, problem, method, steps)
    return snakes_minimisers.minimise_snakes(x0, problem, method, steps)


def to_the_same_energy(x0, problem, method, baseline):
    """Evaluations and seconds that a method needs for the energy that the numerical gradient reached."""
    for steps in (5, 10, 20, 40, 80, 160, 320, 800):
        out = timed(x0, problem, method, steps)
        if out.energy <= baseline.energy * (1.0 + 1e-6):
            speed = baseline.seconds / out.seconds
            return {"same_energy_evaluations": out.evaluations, "same_energy_seconds": out.seconds, "times_faster": speed}
    return {"times_faster": None}


def gradients(knots=(12, 20)):
    """Automatic against numerical gradient on one cloud: evaluations, seconds, energy, accuracy."""
    length, radius = 1.0, 0.012
    curve = shapes.figure_of_eight(length, radius)
    scan = scanner.scan(curve, radius, VIEWS[:2], scanner.STRUCTURED_LIGHT, 3)
    rng = np.random.default_rng(4)
    points = jnp.asarray(scan.points[rng.permutation(len(scan.points))[:2048]])
    rows = []
    for count in knots:
        x0 = spline.evenly(curve, count) + rng.normal(size=(count, 3)) * 0.5 * radius
        flags = jnp.zeros(len(snakes.gap_samples(count)), bool)
        real = jnp.ones(len(points), bool)
        problem = snakes.SnakesProblem(points, jnp.full(len(points), radius), real, flags, jnp.asarray(radius))
        baseline = timed(x0, problem, "cg numerical", 200)
        for method in snakes_minimisers.METHODS:
            out = baseline if method == "cg numerical" else timed(x0, problem, method, 800)
            error = float(np.sqrt(np.mean(cKDTree(spline.evenly(out.points, 4000)).query(curve[20:-20])[0] ** 2)))
            row = {"knots": count, "method": method, "evaluations": out.evaluations, "seconds": out.seconds}
            row |= {"start_energy": out.start_energy, "energy": out.energy, "gradient": out.gradient}
            row |= {"converged": out.converged, "rms_mm": 1e3 * error}
            if method != "cg numerical":
                row |= to_the_same_energy(x0, problem, method, baseline)
            rows.append(row)
            print(row, flush=True)
    return rows


def large():
    """100,000 points: first call (compilation included), second call, memory of the whole process."""
    length, radius = 1.0, 0.012
    curve = shapes.random_smooth(length, radius, 1)
    sensor = scanner.Sensor(**{**scanner.STRUCTURED_LIGHT.__dict__, "points": 34_000})
    points = scanner.scan(curve, radius, VIEWS, sensor, 1).points
    points = np.concatenate([points, points[: max(0, 100_000 - len(points))]])[:100_000]
    start, end = ends(curve)
    seconds, cpu = [], []
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    jax.clear_caches()
    for _ in range(2):
        began, worked = time.perf_counter(), time.process_time()
        extract(points, radius, length=length, start=start, end=end)
        seconds.append(time.perf_counter() - began)
        cpu.append(time.process_time() - worked)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    row = {"points": len(points), "first_seconds": seconds[0], "second_seconds": seconds[1], "load": os.getloadavg()[0]}
    return row | {"first_cpu_seconds": cpu[0], "second_cpu_seconds": cpu[1], "peak_mb": peak, "before_mb": before}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="plain cases alone, and one number of knots")
    parser.add_argument("--resume", action="store_true", help="keep the cases that the file has")
    parser.add_argument("--keys", type=int, nargs="*", help="these cases and no others")
    parser.add_argument("--only-cases", action="store_true", help="the accuracy alone; keep the other results")
    parser.add_argument("--only-rest", action="store_true", help="gradients and 100,000 points again; keep the cases")
    options = parser.parse_args()
    path = RESULTS / "extraction.json"
    old = json.loads(path.read_text())["results"] if path.exists() else {}
    results = {"targets": TARGET, "planned": len(specifications(options.quick))}
    if options.only_cases:
        results |= {k: v for k, v in old.items() if k in ("large", "gradients")}
    else:
        results |= {"large": large(), "gradients": gradients((12,) if options.quick else (12, 20))}
    if options.resume or options.only_rest:
        results["cases"] = old.get("cases", [])
    record("extraction", results)
    if not options.only_rest:
        wanted = specifications(options.quick)
        accuracy({k: wanted[k] for k in options.keys or wanted}, results)
    print(Counter(case["class"] for case in results["cases"]))


if __name__ == "__main__":
    main()
