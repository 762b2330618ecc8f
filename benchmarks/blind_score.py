"""`explain` over a folder of blind cases, scored against the sealed answers: the figures of the README's benchmark table.

    python -m benchmarks.blind_score CASES ANSWERS --json FILE [--only v001,v002] [--jobs 2] [--record blind]

Answers are read only after all cases are diagnosed. ``accept`` in an answer lists the effect types with the same shapes as the
truth; a case counts as found if the tie set contains an accepted type. Cases of `benchmarks.blind.generate --background` have
their own class and lines in the table (`background_score`).
"""

import argparse
import json
import multiprocessing
import os
import signal
import sys
import time
import tomllib
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from pathlib import Path

from benchmarks import background_score
from benchmarks.background_score import NAMED, about_the_same_axis, covered, share
from benchmarks.record import record

os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")


_WARM = 20  # cases, after which a process has compiled what most studies need
# Effects in the catalogue that are not in the format's table of effects
BEYOND_THE_TABLE = {
    "taper_stiffness": "stiffness_taper", "taper_mass": "density_taper", "wavy_curvature": "curvature_profile",
}  # fmt: skip


def prepare(cores=None) -> None:
    """A worker process: on one core of the queue ``cores``, where XLA's threads of several workers would share them."""
    if cores is not None:
        os.sched_setaffinity(0, {cores.get()})
    from scan2flex_jax.cli.setup import prepare_jax  # noqa: PLC0415 - in each process, after its core is known

    prepare_jax()


@contextmanager
def workers(jobs: int):
    """A pool of ``jobs`` processes, each on a core of its own where there are enough, which ends them when interrupted."""
    context = multiprocessing.get_context("spawn")
    available = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else []
    cores = context.Queue() if 1 < jobs <= len(available) else None
    for core in available[:jobs] if cores else ():
        cores.put(core)
    pool = ProcessPoolExecutor(jobs, context, prepare, (cores,))
    try:
        yield pool
    except BaseException:
        for process in list((pool._processes or {}).values()):
            process.kill()
        raise
    finally:
        pool.shutdown(cancel_futures=True)


def diagnose(folder: Path, options: dict | None = None) -> dict:
    from scan2flex_jax.inference import explain  # noqa: PLC0415 - the environment must be set first
    from scan2flex_jax.study import load_study  # noqa: PLC0415

    began, used = time.perf_counter(), time.process_time()
    try:
        study = load_study(folder)
        if any(pose.curve is None for pose in study.poses):
            return {"skipped": "no centre curves"}
        found = explain(study, **(options or {}))
    except Exception as fault:  # a benchmark counts failures
        return {"fault": f"{type(fault).__name__}: {fault}"[:300], "seconds": time.perf_counter() - began}
    out = found.to_json()
    out |= {"processor_seconds": time.process_time() - used, "process": os.getpid(), "resident_mib": _resident()}
    out["poses_fitted"] = len(study.fit_poses)
    out["plain_estimates"] = {} if found.fit is None else found.fit.to_json()["estimates"]
    out["floor"] = 2**0.5 * found.noise.total if found.noise else None
    out["ranking"] = out.get("ranking", [])[:6]
    return out


def _resident() -> float:
    """Memory (MiB) that this process occupies now."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 2**20


def memory(results: dict) -> dict:
    """Memory (MiB) of the process that diagnosed most of these cases, after 20 of them, at most later and at the end."""
    known = [r for r in results.values() if "resident_mib" in r]
    processes = [[r["resident_mib"] for r in known if r["process"] == p] for p in {r["process"] for r in known}]
    longest = max(processes, key=len, default=[])
    if len(longest) < 2 * _WARM:
        return {}
    after = longest[_WARM - 1 :]
    return {"studies": len(longest), "after_20": after[0], "most": max(after), "last": after[-1]}


def score(result: dict, answer: dict, tolerances: bool = False) -> dict:
    """The score of one case; ``tolerances``: its study states tolerances of clamps, length or gravity."""
    truth = set(answer.get("kinds", []))
    accept = set(answer.get("accept", [])) | truth
    off = answer.get("off_catalogue", "none")
    if off in BEYOND_THE_TABLE:
        truth, accept, off = {BEYOND_THE_TABLE[off]}, accept | {BEYOND_THE_TABLE[off]}, "none"
    off = off not in ("none", "")
    chosen = [c["kind"] for c in result.get("chosen", [])]
    ties = set(chosen) | {k for r in result.get("ranking", []) if r["verdict"] == "tied" for k in (r["kind"], *r["tied_with"])}
    out = {
        "truth": sorted(truth), "off": answer.get("off_catalogue", "none"), "strength": answer.get("plain_over_noise", 0.0),
        "poses": result.get("poses_fitted"), "verdict": result.get("verdict"), "p": result.get("test", {}).get("p_value"),
        "chosen": chosen, "ties": sorted(ties), "seconds": result.get("seconds"), "fault": result.get("fault"),
        "processor_seconds": result.get("processor_seconds"), "tolerances": tolerances,
        "class": "off" if off else "none" if not truth else "one" if len(truth) == 1 else "two",
    }  # fmt: skip
    named, out["mistaken"] = result.get("verdict") in NAMED, bool(result.get("mistakes"))
    out["detected"] = bool(result.get("test", {}).get("significant"))
    out["in_tie_set"] = bool(ties & accept) if chosen else False
    out["top_1"] = bool(chosen) and chosen[0] in accept
    out["named_and_wrong"] = named and not set(chosen) <= accept
    out["both"] = len(truth) > 1 and truth <= set(chosen)
    out["both_tied"] = len(truth) > 1 and bool(chosen) and truth <= ties
    out["field_beside"] = any(k.startswith("field of") for k in ties)
    after, before, floor = result.get("after", {}), result.get("before", {}), result.get("floor")
    if floor and chosen:
        out["fit_over_floor"] = after.get("rms_fit", float("nan")) / floor
        if "rms_validate" in after:
            out["validate_over_floor"] = after["rms_validate"] / floor
            out["validate_better"] = after["rms_validate"] < before["rms_validate"]
    places = {e["kind"]: e["position"] for e in answer.get("effect", []) if "position" in e}
    told = [*result.get("ranking", []), *result.get("chosen", [])]  # a chosen effect may stand low in the ranking, which is cut
    errors = {r["kind"]: r.get("std", {}).get("position") for r in told}
    length, off_by = answer.get("true_length", answer.get("length")), []
    for c in result.get("chosen", []):
        if c["kind"] in places and "position" in c["parameters"]:
            off_by.append((abs(c["parameters"]["position"] - places[c["kind"]]) / length, (errors[c["kind"]] or 0.0) / length))
    if off_by:
        worst, error = max(off_by)
        out |= {"place_off_by": worst, "place_std": error, "place_covered": worst <= 1.96 * error}
    same_axis = about_the_same_axis(answer, result.get("chosen", []))
    out |= covered("covers", result.get("estimates", {}), same_axis)
    if "background" in answer:
        out |= background_score.row(result, answer, out["in_tie_set"]) | {"class": f"background {out['class']}"}
    return out


def table(rows: list[dict]) -> dict:
    """Shares over the cases of each class, with their counts."""

    def known(rows, key):
        return share(r[key] for r in rows if r.get(key) is not None)

    def under(rows, key, most):
        return share(r[key] < most for r in rows if key in r)

    def of(name):
        return [r for r in rows if r["class"] == name and not r.get("fault")]

    none, one, two, off = (of(n) for n in ("none", "one", "two", "off"))
    found = [r for r in one if r["detected"]]
    strong = [r for r in one if r["strength"] > 1.5]
    right = [r for r in one if r["top_1"]]
    chosen = [r for r in one + two if r["chosen"]]
    timed = [r for r in rows if r.get("processor_seconds")]
    mean = lambda rows, f: sum(map(f, rows)) / len(rows) if rows else None  # noqa: E731
    return {
        "cases": len(rows), "faults": sum(bool(r.get("fault")) for r in rows),
        "false_alarms": known(none, "detected"),
        "detected": known(one, "detected"),
        "detected_above_0.7": known([r for r in one + two if r["strength"] > 0.7], "detected"),
        "truth_in_tie_set": known(one, "in_tie_set"),
        "truth_in_tie_set_6_poses": known([r for r in one if (r["poses"] or 0) >= 6], "in_tie_set"),
        "truth_in_tie_set_when_detected": known(found, "in_tie_set"),
        "mean_tie_set": mean([r for r in one if r["chosen"]], lambda r: len(r["ties"])),
        "top_1": known(one, "top_1"), "top_1_above_1.5": known(strong, "top_1"),
        "named_and_wrong": known(one + off + none, "named_and_wrong"),
        "both_of_a_pair": known(two, "both"), "both_tied": known(two, "both_tied"), "one_of_a_pair": known(two, "in_tie_set"),
        "off_catalogue_flagged": share(r["verdict"] == "unexplained" for r in off),
        "off_catalogue_flagged_or_right": share(r["verdict"] == "unexplained" or r["in_tie_set"] for r in off),
        "off_catalogue_field": share(r["verdict"] == "unexplained" or r["field_beside"] for r in off),
        "fit_within_5_percent": under(right, "fit_over_floor", 1.05),
        "validate_better": known(chosen, "validate_better"),
        "validate_within_1.15": under(right, "validate_over_floor", 1.15),
        "validate_within_1.15_no_tolerance": under([r for r in right if not r["tolerances"]], "validate_over_floor", 1.15),
        "coverage_95": share(r[k] for r in right for k in r if k.startswith("covers_")),
        "place_within_2_percent": under(one + two, "place_off_by", 0.02),
        "place_within_2_percent_if_seen": under([r for r in one + two if r.get("place_std", 1.0) < 0.01], "place_off_by", 0.02),
        "place_covered": known(one + two, "place_covered"),
        **(background_score.table(rows) if any("background" in r for r in rows) else {}),
        "seconds_mean": mean([r for r in rows if r.get("seconds")], lambda r: r["seconds"]),
        "seconds_most": max((r["seconds"] for r in rows if r.get("seconds")), default=None),
        "processor_seconds_mean": mean(timed, lambda r: r["processor_seconds"]),
        "processor_seconds_most": max((r["processor_seconds"] for r in timed), default=None),
    }  # fmt: skip


def main() -> None:
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # a stopped run ends its workers too
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", type=Path)
    parser.add_argument("answers", type=Path)
    parser.add_argument("--json", type=Path, required=True)
    parser.add_argument("--only", default="")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--per-process", type=int, default=50, help="cases after which a process is replaced")
    parser.add_argument("--record", help="name of the record in benchmarks/results")
    args = parser.parse_args()
    wanted = set(filter(None, args.only.split(",")))
    folders = [f for f in sorted(args.cases.iterdir()) if f.is_dir() and (not wanted or f.name in wanted)]
    results = json.loads(args.json.read_text())["results"] if args.json.exists() else {}
    todo = [f for f in folders if f.name not in results]
    together = args.per_process * args.jobs
    for batch in (todo[i : i + together] for i in range(0, len(todo), together)):
        with workers(args.jobs) as pool:
            running = {pool.submit(diagnose, f): f.name for f in batch}
            for finished in as_completed(running):
                name = running[finished]
                results[name] = finished.result()
                brief = {k: results[name].get(k) for k in ("verdict", "seconds", "fault")}
                sys.stderr.write(f"{name} {brief} {[c['kind'] for c in results[name].get('chosen', [])]}\n")
                args.json.write_text(json.dumps({"results": results}))
    done = {n: r for n, r in results.items() if "skipped" not in r}
    answers = {n: tomllib.loads((args.answers / f"{n}.toml").read_text()) for n in done}
    loose = {n: "tolerance" in tomllib.loads((args.cases / n / "study.toml").read_text()) for n in done}
    rows = {n: score(done[n], answers[n], loose[n]) for n in done}
    figures = table(list(rows.values())) | {"memory": memory(done)}
    args.json.write_text(json.dumps({"table": figures, "rows": rows, "results": results}, indent=1) + "\n")
    if args.record:
        record(args.record, {"table": figures, "rows": rows})
    sys.stdout.write(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    main()
