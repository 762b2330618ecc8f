"""The tables of docs/scanning.md: extraction from simulated scans, and direct fits to them. See `benchmarks.tables`."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.markdown import load, made_on, table

PAGE = Path(__file__).parents[1] / "docs" / "scanning.md"


def _row(name, cases, target):
    """Counts of the classes, and medians and the worst of the errors, of some cases."""
    classes = [case["class"] for case in cases]
    found = [case for case in cases if "refused" not in case]
    missed = [case for case, kind in zip(cases, classes, strict=True) if kind == "missed"]
    row = [name, len(cases), *(classes.count(kind) for kind in ("met", "not sure", "refused", "missed"))]
    row.append("-" if not missed else f"{max(_over(case, target[case['sensor']]) for case in missed):.1f} times")
    row.append(f"{np.median([case['rms_over_noise'] for case in found]):.2f}")
    return [*row, f"{np.median([case['rms_mm'] / case['bound_mm'] for case in found]):.1f}"]


def _over(case, target) -> float:
    """The largest ratio of an error to its target."""
    return max(case["rms_over_noise"] / target, case["bias_over_radius"] / 0.2, abs(case["length_error"]) / 0.005)


_HEAD = ["cases", "met, sure", "not sure", "refused", "missed, sure", "by at most", "RMS over noise", "RMS over bound"]


def extraction() -> str:
    """By sensor and number of viewpoints."""
    entry = load("extraction")
    cases, target = entry["results"]["cases"], entry["results"]["targets"]
    rows = []
    for sensor in target:
        for views in (1, 2, 3):
            some = [case for case in cases if (case["sensor"], case["views"]) == (sensor, views)]
            rows.append(_row(f"{sensor}, {views} view{'s' if views > 1 else ''}", some, target))
    planned = entry["results"]["planned"]
    said = "" if len(cases) == planned else f"\n{len(cases)} of the {planned} cases have been run with this code so far.\n"
    return table(["sensor", *_HEAD], rows) + said + made_on(entry)


def kinds() -> str:
    """By other features of the scan: gap, table, guide points."""
    entry = load("extraction")
    cases, target = entry["results"]["cases"], entry["results"]["targets"]
    chosen: dict[str, Callable] = {
        "plain": lambda c: not (c["gap"] or c["guide_points"] or c["table"]),
        "guide points": lambda c: c["guide_points"],
        "a gap of 10 %": lambda c: c["gap"],
        "a table": lambda c: c["table"],
    }
    rows = []
    for sensor in target:
        for name, of in chosen.items():
            rows.append(_row(f"{sensor}, {name}", [c for c in cases if c["sensor"] == sensor and of(c)], target))
    gaps = [_marked(c) for c in cases if c["gap"] and "refused" not in c]
    missed = [c for c in cases if c["class"] == "missed"]
    beyond = sum(c["bound_mm"] > target[c["sensor"]] * c["noise_mm"] for c in missed)
    said = f"\nOf the gaps in curves that were found, {sum(gaps)} of {len(gaps)} were marked as such. "
    said += f"Of the {len(missed)} curves that missed a target and\nsaid nothing, {beyond} have a Cramer-Rao bound above it.\n"
    return table(["", *_HEAD], rows) + said + made_on(entry)


def _marked(case) -> bool:
    """Whether the curve says that nothing was seen in the middle of the gap (0.35 to 0.45 of the length)."""
    middle = 0.4 * case["length"]
    return any(low < middle < high for low, high in case["gaps"])


def gradients() -> str:
    """Minimisers of the snakes energy, beside the numerical gradient."""
    entry = load("extraction")
    rows = []
    for g in entry["results"]["gradients"]:
        times = g.get("times_faster")
        rows.append([
            g["knots"], g["method"], g["evaluations"], f"{g['seconds']:.2g}", f"{g['energy']:.4f}", f"{g['rms_mm']:.2f} mm",
            "1" if g["method"] == "cg numerical" else "-" if times is None else f"{times:.0f}",
        ])  # fmt: skip
    head = ["knots", "method", "evaluations", "seconds", "final energy", "RMS from the true curve", "times faster, same energy"]
    large = entry["results"]["large"]
    said = (
        f"\n{large['points']:,} points: {large['first_seconds']:.1f} s the first time, with compilation "
        f"({large['first_cpu_seconds']:.1f} s of processor time), then {large['second_seconds']:.1f} s; "
        f"{large['peak_mb']:.0f} MB for the whole process.\n"
    )
    return table(head, rows) + said + made_on(entry)


_LETTERS = {"bending_stiffness": "EI", "torsional_stiffness": "GJ"}


def virtual() -> str:
    """The dress pack and the PTFE cable: errors of the estimates, intervals that hold the truth, distances of the shapes."""
    entry = load("virtual_experiments")
    rows = []
    for name, summary in entry["results"]["summary"].items():
        for data, s in summary.items():
            numbers = [(_LETTERS[key], s[key]) for key in _LETTERS if key in s]
            errors = ", ".join(f"{letter} {100 * x['rms_error']:.2f} %" for letter, x in numbers)
            stated = ", ".join(f"{100 * x['mean_relative_std']:.2f} %" for _, x in numbers)
            held = f"{sum(x['covered'] for _, x in numbers)} of {len(numbers) * (s['runs'] - s['failed'])}"
            far = [s[f"{role} rms_truth_mm"] for role in ("fit", "validate")]
            rows.append([name, data, errors, stated, held, *("-" if x is None else f"{x:.3f} mm" for x in far)])
    head = ["experiment", "fitted to", "error (RMS)", "stated deviation", "intervals hold it", "fitted poses", "never fitted"]
    return table(head, rows) + made_on(entry)


TABLES = {"extraction": extraction, "kinds": kinds, "gradients": gradients, "virtual": virtual}  # in the order of the page
