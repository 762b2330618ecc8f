"""Extraction of centre curves from simulated scans: accuracy against the targets.

`python -m benchmarks.extraction` writes `benchmarks/results/extraction.json` case by case: an interrupted run continues, and
without that file it begins anew. docs/scanning.md defines scenes, targets and the classes of the results. The noise is that of
the sensor along the ray, at the range of the scan.
"""

import itertools
from collections import Counter

import jax

jax.config.update("jax_enable_x64", True)

import numpy as np  # noqa: E402
from scipy.spatial import cKDTree  # noqa: E402

from benchmarks.curves import on_the_seen_side, unit_tangents  # noqa: E402
from benchmarks.record import complete, record, recorded  # noqa: E402
from scan2flex_jax.errors import Scan2FlexError  # noqa: E402
from scan2flex_jax.scan import scanner, shapes  # noqa: E402
from scan2flex_jax.scan.extraction import extract  # noqa: E402
from scan2flex_jax.scan.plausibility import clamp_to_clamp  # noqa: E402
from scan2flex_jax.scan.strand_matching import End  # noqa: E402

VIEWS = np.array([[0.3, -1.0, 0.6], [0.3, 1.0, 0.5], [-1.0, 0.1, 0.6]])
SENSORS = {"structured light": scanner.STRUCTURED_LIGHT, "time of flight": scanner.TIME_OF_FLIGHT}
TARGET = {"structured light": 0.3, "time of flight": 0.5}
CABLES = ((1.0, 0.004), (1.0, 0.012), (1.8, 0.045))  # length, radius (m)


def ends(curve):
    """Both clamps of a true curve, with their directions."""
    tangent = unit_tangents(curve)
    return End(curve[0], tangent[0]), End(curve[-1], tangent[-1])


def compare(extracted, curve, radius, noise, eyes):
    """Errors of an extracted curve against the true one, between the true clamps."""
    fine = shapes.resample(curve, 8001)
    away, which = cKDTree(fine).query(extracted.points)
    look = eyes.mean(axis=0) - fine[which]
    look /= np.linalg.norm(look, axis=1, keepdims=True)
    rms = float(np.sqrt(np.mean(away**2)))
    return {
        "rms_mm": 1e3 * rms, "rms_over_noise": rms / noise,
        "bias_over_radius": float(np.mean(np.sum((extracted.points - fine[which]) * look, axis=1)) / radius),
        "length_error": float(clamp_to_clamp(extracted, *ends(curve)) / shapes.arc_length(fine)[-1] - 1.0),
        "sure": extracted.sure, "gaps": [list(gap) for gap in extracted.gaps],
    }  # fmt: skip


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
    at = np.linspace(8, len(curve) - 9, 10).astype(int)
    marks = on_the_seen_side(curve, at, radius, eyes[0]) if guided else None
    case = {"family": family, "radius": radius, "length": length, "sensor": sensor, "views": views, "gap": gap}
    case |= {"guide_points": guided, "table": table, "key": key, "points": len(scan.points), "noise_mm": 1e3 * float(noise)}
    try:
        known = {"length": length, "start": start, "end": end, "guide_points": marks, "viewpoints": eyes}
        extracted = extract(scan.points, radius, **known)
        case |= compare(extracted, curve, radius, noise, eyes)
        near = case["rms_over_noise"] <= TARGET[sensor] and case["bias_over_radius"] <= 0.2
        near = near and abs(case["length_error"]) <= 0.005
        case["class"] = "not sure" if not extracted.sure else "met" if near else "missed"
    except Scan2FlexError as refusal:
        case |= {"class": "refused", "refused": str(refusal)}
    return case


def specifications():
    """The cases by key: families x cables x sensors x viewpoints, plain, with guide points, with a gap, with a table."""
    kinds = ((False, False, False), (False, True, False), (True, False, False), (False, False, True))
    seen = itertools.product(shapes.FAMILIES, CABLES, SENSORS, (1, 2, 3), kinds)
    return {k: (family, *cable, sensor, views, *kind, k) for k, (family, cable, sensor, views, kind) in enumerate(seen)}


def main():
    done, todo = {case["key"]: case for case in recorded("extraction").get("cases", [])}, specifications()
    keep = lambda: record("extraction", {"targets": TARGET, "cases": [done[k] for k in sorted(done)]})  # noqa: E731
    complete(done, todo, lambda key: one_case(*todo[key]), keep)
    print(Counter(case["class"] for case in done.values()))


if __name__ == "__main__":
    main()
