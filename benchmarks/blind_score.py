"""`explain` and `fit` over a folder of blind cases, scored against the sealed answers.

    python -m benchmarks.blind_score CASES ANSWERS --json FILE [--record blind]

Answers are read only after all cases are explained; results of an earlier run in the file are kept. ``accept`` in an answer
lists the effect types with the same shapes as the truth; a case is right if its tie set contains an accepted type. An effect is
*named* if the answer is "explained" or "partly explained".

Cases of `benchmarks.blind.generate --background` have classes and lines of their own: with background alone nothing should be
named. *Attained*, in the answer, is the RMS distance of validate poses from the true effect's curves without background.
"""

import argparse
import json
import time
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from benchmarks.record import complete, record
from scan2flex_jax.cli.setup import prepare_jax

NAMED = ("explained", "partly explained")
STIFFNESSES = ("bending_stiffness", "torsional_stiffness")
IN_CATALOGUE = {"taper_stiffness": "stiffness_taper", "taper_mass": "density_taper"}  # counted as unknown by the generator


def explained(folder: Path) -> dict:
    """The result of `explain`, with the cost of the call, and that of `fit`; or a failure."""
    from scan2flex_jax.inference import explain, fit  # noqa: PLC0415 - JAX must be set up first
    from scan2flex_jax.study import load_study  # noqa: PLC0415

    began, used = time.perf_counter(), time.process_time()
    try:
        study = load_study(folder)
        answer = explain(study)
        spent = time.process_time() - used
        plain = fit(study)
    except Exception as fault:  # a benchmark counts failures
        return {"fault": f"{type(fault).__name__}: {fault}"[:300], "seconds": time.perf_counter() - began}
    out = answer.to_json()
    out |= {"processor_seconds": spent, "poses_fitted": len(study.fit_poses)}
    out["ranking"] = out.get("ranking", [])[:6]
    said = {"reliable": plain.answer.belief.partition(":")[0], "overlooked": plain.overlooked}
    out["fit"] = said | {"estimates": plain.to_json()["estimates"]}
    return out | {"floor": 2**0.5 * answer.noise.total if answer.noise else None}


def share(values) -> dict:
    """Share of the values that are true, with their count."""
    known = [bool(v) for v in values]
    return {"share": sum(known) / len(known) if known else None, "of": len(known)}


def covered(prefix: str, estimates: dict, answer: dict) -> dict:
    """Whether the intervals of the stiffnesses contain the truth, if there are intervals."""
    out = {}
    for name in STIFFNESSES:
        e, true = estimates.get(name, {}), answer.get(f"true_{name}")
        if "low" in e and true is not None:
            out[f"{prefix}_{name}"] = bool(e["low"] <= true <= e["high"])
    return out


def parameters_covered(effect: dict, true: dict) -> tuple[int, int]:
    """Number of parameters with a standard error, and of those whose 95 % interval contains the truth. Axes of bending are
    the same after a quarter turn with the inverse ratio: the nearer of the two is the truth."""
    if true["kind"] == "anisotropic_bending":
        turned = {"ratio": 1 / true["ratio"], "angle": true["angle"] + np.pi / 2}
        true = min(true, turned, key=lambda p: abs(np.log(p["ratio"] / effect["parameters"]["ratio"])))
        turns = round((effect["parameters"]["angle"] - true["angle"]) / np.pi)
        true = {"ratio": true["ratio"], "angle": true["angle"] + turns * np.pi}
    known = [k for k, std in effect.get("std", {}).items() if np.size(true.get(k, ())) == np.size(std)]
    three = (effect["parameters"], true, effect.get("std", {}))
    value, truth, std = (np.concatenate([np.ravel(p[k]) for k in known] or [[]]) for p in three)
    return len(std), int(np.sum(abs(value - truth) <= 1.96 * std))


def about_the_same_axis(answer: dict, chosen: list[dict]) -> dict:
    """The answer with the bending stiffness about the axis that the result takes as the first."""
    true = next((e for e in answer.get("effect", []) if e["kind"] == "anisotropic_bending"), None)
    ours = next((c["parameters"] for c in chosen if c["kind"] == "anisotropic_bending"), None)
    if true is None or ours is None or np.log(true["ratio"]) * np.log(ours["ratio"]) > 0:
        return answer
    return answer | {"true_bending_stiffness": answer["true_bending_stiffness"] * true["ratio"]}


def score(result: dict, answer: dict) -> dict:
    """The score of one case."""
    truth, off = set(answer.get("kinds", [])), answer.get("off_catalogue", "none")
    if off in IN_CATALOGUE:
        truth, off = {IN_CATALOGUE[off]}, "none"
    accept, off = set(answer.get("accept", [])) | truth, off not in ("none", "")
    chosen, ranking = result.get("chosen", []), result.get("ranking", [])
    kinds = [c["kind"] for c in chosen]
    ties = set(kinds) | {k for r in ranking if r["verdict"] == "tied" for k in (r["kind"], *r["tied_with"])}
    test, named = result.get("test", {}), result.get("verdict") in NAMED
    of_class = "off" if off else "none" if not truth else "one" if len(truth) == 1 else "two"
    out = {k: result.get(k) for k in ("verdict", "seconds", "processor_seconds", "fault")}
    out |= {
        "truth": sorted(truth), "off": answer.get("off_catalogue", "none"), "strength": answer.get("plain_over_noise", 0.0),
        "poses": result.get("poses_fitted"), "p": test.get("p_value"), "chosen": kinds, "ties": sorted(ties),
        "class": f"background {of_class}" if "background" in answer else of_class,
        "mistaken": bool(result.get("mistakes")), "detected": bool(test.get("significant")), "named": named and bool(kinds),
        "in_tie_set": bool(kinds and ties & accept), "top_1": bool(kinds) and kinds[0] in accept,
        "named_and_wrong": named and not set(kinds) <= accept,
        "both": len(truth) > 1 and truth <= set(kinds), "both_tied": len(truth) > 1 and bool(kinds) and truth <= ties,
    }  # fmt: skip
    if plain := result.get("fit"):
        out |= {"fit": plain["reliable"], "fit_overlooked": plain["overlooked"]} | covered("fit", plain["estimates"], answer)
    out |= errors(result, answer) | covered("covers", result.get("estimates", {}), about_the_same_axis(answer, chosen))
    return out | (above_background(result, answer, out["in_tie_set"]) if "background" in answer else {})


def errors(result: dict, answer: dict) -> dict:
    """Errors of poses over the noise, and of places over the length."""
    out, chosen, floor = {}, result.get("chosen", []), result.get("floor")
    after, before = result.get("after", {}), result.get("before", {})
    if floor and chosen:
        out["fit_over_floor"] = after.get("rms_fit", float("nan")) / floor
        if "rms_validate" in after:
            out["validate_over_floor"] = after["rms_validate"] / floor
            out["validate_better"] = after["rms_validate"] < before["rms_validate"]
    places = {e["kind"]: e["position"] for e in answer.get("effect", []) if "position" in e}
    length, off = answer.get("true_length", answer.get("length")), []
    for c in chosen:
        if c["kind"] in places and "position" in c["parameters"]:
            std = c.get("std", {}).get("position") or 0.0
            off.append((abs(c["parameters"]["position"] - places[c["kind"]]) / length, std / length))
    if off:
        worst, std = max(off)
        out |= {"place_off_by": worst, "place_covered": worst <= 1.96 * std}
    return out


def above_background(result: dict, answer: dict, in_tie_set: bool) -> dict:
    """The score of a case with a background: scatter, prediction, and parameters of the effect."""
    out = {"background": answer["background"]}
    after, rms = result.get("after", {}).get("rms_validate"), result.get("discrepancy", {}).get("rms")
    out |= {} if after is None else {"validate_over_attained": after / answer["attained_validate"]}
    out |= {} if rms is None else {"discrepancy_over_true": rms / answer["background"]}
    if answer["kinds"] and in_tie_set:
        true = next(e for e in answer["effect"] if e["kind"] == answer["kinds"][0])
        every = [*result.get("chosen", []), *result.get("ranking", [])]
        effect = next((e for e in every if e["kind"] == true["kind"]), None)
        out["parameters"], out["parameters_covered"] = parameters_covered(effect, true) if effect else (0, 0)
    return out


def known(rows: list[dict], key: str) -> dict:
    """Share of a truth value over the rows that have it."""
    return share(r[key] for r in rows if r.get(key) is not None)


def under(rows: list[dict], key: str, most: float) -> dict:
    """Share of the rows with a number in which it is below ``most``."""
    return share(r[key] < most for r in rows if key in r)


def mean(values) -> float | None:
    some = [v for v in values if v]
    return sum(some) / len(some) if some else None


class Classes:
    """The rows of the cases by class: ``none`` missing, ``one`` effect, ``two`` effects, and ``off`` the catalogue; ``right``:
    one effect, ranked first."""

    def __init__(self, rows: list[dict], prefix: str = ""):
        rows = [r for r in rows if prefix or not r.get("fault")]  # with a background, a fault counts as missed
        self.none, self.one, self.two, self.off = (
            [r for r in rows if r["class"] == prefix + n] for n in ("none", "one", "two", "off")
        )
        self.every, self.placed = rows, self.one + self.two
        self.right = [r for r in self.one if r["top_1"]]


Metric = tuple[str, str | None, Callable[[Classes], object]]
METRICS: dict[str, Metric] = {
    "false_alarms": ("nothing missing: alarms at the 5 % level", "3-8 %", lambda c: known(c.none, "detected")),
    "detected_above_0.7": ("one or two effects of strength above 0.7: detected", "95 %",
                           lambda c: known([r for r in c.placed if r["strength"] > 0.7], "detected")),
    "truth_in_tie_set_6_poses": ("one effect, six poses or more: in the tie set", "90 %",
                                 lambda c: known([r for r in c.one if (r["poses"] or 0) >= 6], "in_tie_set")),
    "truth_in_tie_set": ("one effect, all cases: in the tie set", None, lambda c: known(c.one, "in_tie_set")),
    "mean_tie_set": ("effect types in a tie set, mean", "2 at most",
                     lambda c: mean(len(r["ties"]) for r in c.one if r["chosen"])),
    "top_1": ("one effect: ranked first", "85 %", lambda c: known(c.one, "top_1")),
    "top_1_above_1.5": ("the same, strength above 1.5", "95 %",
                        lambda c: known([r for r in c.one if r["strength"] > 1.5], "top_1")),
    "named_and_wrong": ("named alone, and wrong", "2 % at most", lambda c: known(c.one + c.off + c.none, "named_and_wrong")),
    "both_of_a_pair": ("two effects: both found", "80 %", lambda c: known(c.two, "both")),
    "both_tied": ("two effects: both in the tied sets", None, lambda c: known(c.two, "both_tied")),
    "one_of_a_pair": ("two effects: at least one in the tie set", None, lambda c: known(c.two, "in_tie_set")),
    "off_catalogue_flagged": ('an effect outside the catalogue: answered "unexplained"', "75 %",
                              lambda c: share(r["verdict"] == "unexplained" for r in c.off)),
    "fit_within_5_percent": ("ranked first and right: RMS after within 5 % of the noise", "all",
                             lambda c: under(c.right, "fit_over_floor", 1.05)),
    "validate_better": ("poses never fitted: predicted better than before", "90 %",
                        lambda c: known([r for r in c.placed if r["chosen"]], "validate_better")),
    "validate_within_1.15": ("ranked first and right: those within 1.15 of the noise", "all",
                             lambda c: under(c.right, "validate_over_floor", 1.15)),
    "place_within_2_percent": ("right effect type with a position along the cable: within 2 % of the length", "all",
                               lambda c: under(c.placed, "place_off_by", 0.02)),
    "place_covered": ("95 % intervals of positions that hold the truth", None, lambda c: known(c.placed, "place_covered")),
    "coverage_95": ("95 % intervals of EI and GJ that hold the truth, after", "92-97 %",
                    lambda c: share(r[k] for r in c.right for k in r if k.startswith("covers_"))),
}  # fmt: skip
"""By name: words, target, and a share with its count or a number, from the classes of a run."""

BACKGROUND: dict[str, Metric] = {
    "alone_named": ("background alone, and something named", "5 % at most", lambda c: share(r["named"] for r in c.none)),
    "in_tie_set": ("one effect above it: in the tie set", "85 %", lambda c: known(c.one, "in_tie_set")),
    "missed_for_a_mistake": ("not in it, since a likely mistake of the input was reported", None,
                             lambda c: share(r["mistaken"] for r in c.one if not r["in_tie_set"])),
    "named_and_wrong": ("named, and wrong", None, lambda c: known(c.none + c.one, "named_and_wrong")),
    "validate_within_1.3": ("one effect: poses never fitted within 1.3 of the error of the true model", "80 %",
                            lambda c: share(r.get("validate_over_attained", np.inf) < 1.3 for r in c.one)),
    "discrepancy_over_true_median": ("reported over true scatter, median", None,
                                     lambda c: np.median([v for r in c.every if (v := r.get("discrepancy_over_true"))])),
    "coverage_95": ("95 % intervals of EI and GJ that hold the truth, with an effect", "92-97 %",
                    lambda c: share(r[k] for r in c.one for k in r if k.startswith("covers_"))),
    "parameters_covered": ("95 % intervals of the effect's parameters that hold the truth", "92-97 %", lambda c: {
        "share": sum(r.get("parameters_covered", 0) for r in c.one) / max(1, sum(r.get("parameters", 0) for r in c.one)),
        "of": sum(r.get("parameters", 0) for r in c.one)}),
}  # fmt: skip


def reliable(rows: list[dict]) -> list[tuple[str, dict, dict]]:
    """How often `fit` alone says yes, and how often the intervals of EI and GJ beside a yes hold: in words, without the score
    of effects that its estimates may have absorbed (`Fit.overlooked`), and with it."""
    rows = [r for r in rows if "fit" in r]
    yes = [lambda r: r["fit"] == "yes" or bool(r["fit_overlooked"]), lambda r: r["fit"] == "yes"]
    kinds = {
        "nothing missing: yes": [r for r in rows if r["class"] == "none"],
        "an effect of strength below 1.5: yes": [r for r in rows if r["class"] != "none" and r["strength"] < 1.5],
        "an effect of strength above 1.5: yes": [r for r in rows if r["class"] != "none" and r["strength"] >= 1.5],
    }
    out = [(words, *(share(y(r) for r in some) for y in yes)) for words, some in kinds.items()]
    held = [share(r[f"fit_{k}"] for r in rows if y(r) for k in STIFFNESSES if f"fit_{k}" in r) for y in yes]
    return [*out, ("yes: 95 % intervals of EI and GJ that hold the truth", *held)]


def scored(rows: list[dict]) -> list[tuple]:
    """Words, value and target of each metric; of those with a background, if these are such cases."""
    above = rows[0]["class"].startswith("background")
    metrics, classes = (BACKGROUND, Classes(rows, "background ")) if above else (METRICS, Classes(rows))
    return [(words, value(classes), target) for words, target, value in metrics.values()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    parser.add_argument("answers", type=Path)
    parser.add_argument("--json", type=Path, required=True)
    parser.add_argument("--record", help="name of the record in benchmarks/results")
    args = parser.parse_args()
    prepare_jax()
    results = json.loads(args.json.read_text())["results"] if args.json.exists() else {}
    keep = lambda: args.json.write_text(json.dumps({"results": results}))  # noqa: E731
    complete(results, sorted(f.name for f in args.cases.iterdir()), lambda name: explained(args.cases / name), keep)
    answers = {n: tomllib.loads((args.answers / f"{n}.toml").read_text()) for n in results}
    rows = {n: score(results[n], answers[n]) for n in results}
    args.json.write_text(json.dumps({"rows": rows, "results": results}, indent=1) + "\n")
    if args.record:
        record(args.record, {"rows": rows})
    for words, value, _ in scored(list(rows.values())):
        print(f"{words}: {value}")
    for words, without, value in reliable(list(rows.values())):
        print(f"`fit`, {words}: {without} without the score, {value} with it")


if __name__ == "__main__":
    main()
