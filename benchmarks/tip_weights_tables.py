"""The table of docs/real/tip-weights.md: real cables without and with a weight at the tip. See `benchmarks.tables`."""

from pathlib import Path

import numpy as np

from benchmarks.markdown import load, made_on, table

PAGE = Path(__file__).parents[1] / "docs" / "real" / "tip-weights.md"
NOISE = "noise unstated"
WORDS = {
    "without": "without the weight", "carried over": "with it: what the answer above predicts, nothing fitted",
    "with": "with it, undeclared; EI to 4 % and effects carried over",
    "with, alone": "with it, undeclared, nothing carried over",
    "both": "both series in one fit, mass unknown", "both, softening": "the same, and bending that softens",
    "both, friction": "the same, and inner friction in place of softening",
    "both, as found": "both series in one fit, mass unknown, with the effects found without the weight",
    "known weight": "both series in one fit, weight known, cable not weighed",
}  # fmt: skip
UNITS = {"mass": "kg", "position": "m", "curvature": "1/m", "angle": "rad", "force": "N", "width": "m", "slip_curvature": "1/m"}
_SIZES = ("mass", "curvature", "angle", "force", "factor", "ratio", "position", "offset", "stiffness", "coupling", "taper")


def weights() -> str:
    """Every question of every cable."""
    entry = load("tip_weights")
    rows = []
    for cable, r in entry["results"].items():
        for question, told in (r.get(NOISE, {}) if isinstance(r, dict) else {}).items():
            errors = [_errors(told, role) for role in _ROLES]
            rows.append([cable.replace("_", ", "), WORDS[question], _found(told), *errors, _poses(told)])
    head = ["cable", "series", "found", "fitted, mm", "left out in turn, mm", "never seen, mm", "their median, mm"]
    return table(head, rows) + made_on(entry)


def brief() -> str:
    """The short table: the finding for each cable, and the error of unseen poses before and after."""
    entry = load("tip_weights")
    rows = []
    for cable, r in entry["results"].items():
        told = r.get(NOISE, {}) if isinstance(r, dict) else {}
        for series, before in (("without", told.get("without", {})), ("with", told.get("carried over", {}))):
            if series in told:
                was = before.get("before", before.get("after", {})).get("rms_validate")
                now = told[series].get("after", {}).get("rms_validate")
                errors = " to ".join("-" if v is None else f"{1e3 * v:.1f}" for v in (was, now))
                words = f"{series} the weight", _found(told[series]), errors, _poses(told[series])
                rows.append([cable.replace("_", ", "), *words])
    return table(["cable", "series", "found", "poses never seen, mm", "their median, mm"], rows) + made_on(entry)


_ROLES = ("rms_fit", "rms_left_out", "rms_validate")


def _errors(told, role) -> str:
    """Before and after, in mm."""
    values = [told.get(when, {}).get(role) for when in ("before", "after")]
    return " to ".join(f"{1e3 * v:.1f}" for v in values if v is not None and np.isfinite(v)) or "-"


def _poses(told) -> str:
    """The median of the poses never seen, and how many of them fall over to another branch."""
    if "median of poses never seen" not in told:
        return "-"
    fallen = len(told["fallen over"])
    return f"{1e3 * told['median of poses never seen']:.1f}" + (f" ({fallen} on another branch)" if fallen else "")


def _found(told) -> str:
    """Verdict, effects with their 95 % intervals, EI."""
    if "failed" in told:
        return told["failed"]
    parts = [told["verdict"]] if "verdict" in told else []
    parts += [", ".join(map(_effect, told["added"]))] if told.get("added") else []
    parts += [f"{name} {e['value']:.3g} ({e['low']:.3g} to {e['high']:.3g})" if "low" in e else f"{name} {e['value']:.3g}"
              for name, e in told.get("estimates", {}).items() if np.ndim(e["value"]) == 0]  # fmt: skip
    return "; ".join(parts) or "-"


def _effect(chosen) -> str:
    """One effect: what tells its size and place."""
    said = []
    if np.ndim(chosen["parameters"].get("factor", 0.0)):  # a moment law
        at, factor = chosen["parameters"]["curvature"], chosen["parameters"]["factor"]
        return f"`{chosen['kind']}` (secant factor {factor[0]:.2g} at {at[0]:.2g} 1/m to {factor[-1]:.2g} at {at[-1]:.2g} 1/m)"
    for name, value in chosen["parameters"].items():
        size, std = float(np.linalg.norm(value)), chosen.get("std", {}).get(name)
        if name in _SIZES:
            along = None if std is None or not size else abs(float(np.dot(np.ravel(value), np.ravel(std)))) / size
            off = "" if along is None else f" ± {1.96 * along:.2g}"
            said.append(f"{name} {size:.3g}{off} {UNITS.get(name, '')}".strip())
    return f"`{chosen['kind']}` ({', '.join(said)})"


TABLES = {"weights": weights}
