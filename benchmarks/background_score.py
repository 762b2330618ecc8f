"""Scores of blind cases with a background (a random deviation of each pose), with and without an effect.

An effect counts as *named* if the answer is "explained" or "partly explained"; with background alone none should be. The size
of an effect is its main parameter as a vector that is zero if the effect is absent, so that 15 % of it means the same for a
factor of 1.1 as for one of 3; it is looked up in the chosen effects first, then in the ranking. *Attained*, in the answer, is
the RMS distance of validate poses from the true effect's curves without background.
"""

from statistics import median

import numpy as np

NAMED = ("explained", "partly explained")
SIZE, VALIDATE = 0.15, 1.3  # targets: the size to within, and validate poses within this of what is attained
STIFFNESSES = ("bending_stiffness", "torsional_stiffness")


def _anisotropy(p):
    """Axes of bending are the same after a quarter turn with the inverse ratio."""
    return np.log(p["ratio"]) * np.array([np.cos(2 * p["angle"]), np.sin(2 * p["angle"])])


SIZES = {
    "natural_curvature": lambda p, L: p["curvature"], "kink": lambda p, L: p["angle"],
    "anisotropic_bending": lambda p, L: _anisotropy(p), "bend_twist_coupling": lambda p, L: p["coupling"],
    "nonlinear_bending": lambda p, L: 1 - p["ratio"], "stiffness_profile": lambda p, L: np.log(p["factor"]),
    "extensibility": lambda p, L: 1 / p["axial_stiffness"], "point_mass": lambda p, L: p["mass"],
    "density_profile": lambda p, L: p["factor"] - 1, "uniform_load": lambda p, L: p["force"],
    "point_load": lambda p, L: p["force"], "tether": lambda p, L: p["stiffness"],
    "elastic_clamp": lambda p, L: 1 / np.asarray(p["stiffness"], float),
    "clamp_rotation": lambda p, L: p["rotation"], "clamp_offset": lambda p, L: p["offset"],
    "length_error": lambda p, L: p["length"] - L, "scan_scale": lambda p, L: p["factor"] - 1,
    "scan_offset": lambda p, L: p["offset"],
}  # fmt: skip
"""By kind, the size of an effect in a cable of length L (m); a support plane has none."""


def size_off_by(kind: str, found: dict, true: dict, length: float) -> float | None:
    """Relative error of an effect's size; None for a type without one. An end that only one of them has counts as zero."""
    if kind not in SIZES:
        return None
    a, b = (np.ravel(np.asarray(SIZES[kind](p, length), float)) for p in (found, true))
    count = max(len(a), len(b))
    a, b = (np.pad(x, (0, count - len(x))) for x in (a, b))
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


def row(result: dict, answer: dict, in_tie_set: bool) -> dict:
    """The score of one case with a background, in addition to `blind_score.score`."""
    out = {"background": answer["background"], "named": bool(result.get("chosen")) and result.get("verdict") in NAMED}
    after = result.get("after", {}).get("rms_validate")
    if after is not None:
        out["validate_over_attained"] = after / answer["attained_validate"]
    rms = result.get("discrepancy", {}).get("rms")
    if rms is not None:
        out["discrepancy_over_true"] = rms / answer["background"]
    out |= covered("plain_covers", result.get("plain_estimates", {}), answer)
    if answer["kinds"] and in_tie_set:
        true = next(e for e in answer["effect"] if e["kind"] == answer["kinds"][0])
        every = [*result.get("chosen", []), *result.get("ranking", [])]
        found = next((e for e in every if e["kind"] == true["kind"]), None)
        out["size_off_by"] = found and size_off_by(true["kind"], found["parameters"], true, answer["true_length"])
        out["parameters"], out["parameters_covered"] = within_errors(found, true) if found else (0, 0)
    return out


def within_errors(found: dict, true: dict) -> tuple[int, int]:
    """Of the parameters of an effect that have a standard error, how many there are and how many contain the truth in their
    95 % intervals. Of directions of bending that are the same, the one next to that found is the truth."""
    if true["kind"] == "anisotropic_bending":
        turned = {"ratio": 1 / true["ratio"], "angle": true["angle"] + np.pi / 2}
        true = min(true, turned, key=lambda p: abs(np.log(p["ratio"] / found["parameters"]["ratio"])))
        turns = round((found["parameters"]["angle"] - true["angle"]) / np.pi)
        true = {"ratio": true["ratio"], "angle": true["angle"] + turns * np.pi}
    known = [k for k, std in found.get("std", {}).items() if np.size(true.get(k, ())) == np.size(std)]
    three = (found["parameters"], true, found.get("std", {}))
    value, truth, std = (np.concatenate([np.ravel(p[k]) for k in known] or [[]]) for p in three)
    return len(std), int(np.sum(abs(value - truth) <= 1.96 * std))


def about_the_same_axis(answer: dict, chosen: list[dict]) -> dict:
    """The answer with the bending stiffness about the axis that the result takes as the first: a quarter turn of the axes with
    the inverse ratio is the same cable."""
    true = next((e for e in answer.get("effect", []) if e["kind"] == "anisotropic_bending"), None)
    found = next((c["parameters"] for c in chosen if c["kind"] == "anisotropic_bending"), None)
    if true is None or found is None or np.log(true["ratio"]) * np.log(found["ratio"]) > 0:
        return answer
    return answer | {"true_bending_stiffness": answer["true_bending_stiffness"] * true["ratio"]}


def covered(prefix: str, estimates: dict, answer: dict) -> dict:
    """Whether the intervals of the stiffnesses contain the truth, if there are intervals."""
    out = {}
    for name in STIFFNESSES:
        e, true = estimates.get(name, {}), answer.get(f"true_{name}")
        if "low" in e and true is not None:
            out[f"{prefix}_{name}"] = bool(e["low"] <= true <= e["high"])
    return out


def table(rows: list[dict]) -> dict:
    """Shares over the cases with a background, with their counts; a case that ended by a fault counts as missed."""
    rows = [r for r in rows if r["class"].startswith("background")]
    one, none = ([r for r in rows if r["class"] == f"background {n}"] for n in ("one", "none"))
    sized = [r for r in one if r["truth"][0] in SIZES]
    ratios = [r["discrepancy_over_true"] for r in rows if "discrepancy_over_true" in r]
    out = {
        "background_cases": len(rows),
        "background_alone_named": share(r.get("named", False) for r in none),
        "background_in_tie_set": share(r["in_tie_set"] for r in one),
        "background_missed_for_a_mistake": share(r.get("mistaken", False) for r in one if not r["in_tie_set"]),
        "background_named_and_wrong": share(r["named_and_wrong"] for r in rows),
        "background_size_within_15_percent": share((r.get("size_off_by") or np.inf) < SIZE for r in sized),
        "background_validate_within_1.3": share(r.get("validate_over_attained", np.inf) < VALIDATE for r in one),
        "background_discrepancy_over_true_median": median(ratios) if ratios else None,
    }
    count, inside = (sum(r.get(k, 0) for r in one) for k in ("parameters", "parameters_covered"))
    out["background_parameters_covered"] = {"share": inside / count if count else None, "of": count}
    for words, prefix in (("coverage_95", "covers_"), ("coverage_95_plain_fit", "plain_covers_")):
        for name, some in (("alone", none), ("with_effect", one)):
            out[f"background_{words}_{name}"] = share(v for r in some for k, v in r.items() if k.startswith(prefix))
    return out


def share(values) -> dict:
    """How many of them are true, with their count."""
    known = [bool(v) for v in values]
    return {"share": sum(known) / len(known) if known else None, "of": len(known)}
