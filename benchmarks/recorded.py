"""Fits and answers of recorded studies, to compare a change of the code with the code before it.

    python -m benchmarks.recorded --write        # record the answers of this code
    python -m benchmarks.recorded                # compare this code with the record

Fits: the examples and, where ``SCAN2FLEX_DATA`` is, the practice studies of centre curves and the two of wrong branches.
Answers of ``explain``: the studies named in `EXPLAINED`. A comparison ends with code 1 where an estimate moved by more than
`SAME` (relative) or an answer changed.
"""

import argparse
import os
import sys
from pathlib import Path

import numpy as np

from benchmarks.record import committed, record
from scan2flex_jax.cli.setup import prepare_jax
from scan2flex_jax.examples import example_path

SAME = 1.0e-8
EXAMPLES = ("simulated-cable", "black-wire", "red-wire", "textile-strip")
EXPLAINED = (
    "black-wire", "textile-strip", "d01", "d03", "d05", "d08", "d10", "d13", "d16", "d19", "d21", "d25", "d27", "d28",
)  # fmt: skip


def studies() -> dict[str, Path]:
    """Folders by name."""
    found = {name: example_path(name) for name in EXAMPLES}
    data = os.environ.get("SCAN2FLEX_DATA")
    if data:
        found |= {p.name: p for p in sorted((Path(data) / "practice" / "cases").iterdir())}
        found |= {p.name: p for p in sorted((Path(data) / "branches").glob("study-*"))}
    return found


def fitted(study) -> dict:
    """The numbers of a fit."""
    from scan2flex_jax import fit  # noqa: PLC0415 - after float64 is on

    result = fit(study)
    values = {name: np.asarray(e.value).tolist() for name, e in result.estimates.items()}
    stds = {name: None if e.std is None else np.asarray(e.std).tolist() for name, e in result.estimates.items()}
    return {"values": values, "stds": stds, "rms": result.rms(), "equilibria": result.equilibria, "seconds": result.seconds}


def explained(study) -> dict:
    """The answer of the loop."""
    from scan2flex_jax import explain  # noqa: PLC0415 - after float64 is on

    out = explain(study).to_json()
    ranking = [{k: r.get(k) for k in ("kind", "verdict", "log_evidence")} for r in out.get("ranking", [])[:4]]
    return {
        "verdict": out["verdict"], "chosen": [c["kind"] for c in out.get("chosen", [])], "ranking": ranking,
        "p_value": out.get("test", {}).get("p_value"), "seconds": out.get("seconds"),
    }  # fmt: skip


def answers(names: list[str]) -> dict:
    """Fits and explanations of all studies, by name."""
    from scan2flex_jax import load_study  # noqa: PLC0415

    out: dict = {"fits": {}, "explained": {}}
    for name, folder in studies().items():
        if names and name not in names:
            continue
        study = load_study(folder)
        if any(pose.curve is None for pose in study.poses):
            continue  # scans: minutes, and their own benchmark
        out["fits"][name] = fitted(study)
        if name in EXPLAINED:
            out["explained"][name] = explained(study)
        sys.stderr.write(f"{name}\n")
    return out


def differences(before: dict, now: dict) -> list[str]:
    """A sentence for each fit or answer that changed."""
    said = []
    for name, fit in now["fits"].items():
        old = before["fits"].get(name)
        for key, value in fit["values"].items() if old else ():
            off = float(np.max(np.abs(np.subtract(value, old["values"][key])) / (np.abs(old["values"][key]) + 1e-300)))
            if not off <= SAME:
                said.append(f"fit of {name}: {key} differs by {off:.2g}")
    for name, answer in now["explained"].items():
        old = before["explained"].get(name)
        for key in ("verdict", "chosen") if old else ():
            if old[key] != answer[key]:
                said.append(f"answer of {name}: {key} was {old[key]} and is {answer[key]}")
        ranks = [[(r["kind"], r["verdict"]) for r in a["ranking"]] for a in (old, answer)] if old else [(), ()]
        if ranks[0] != ranks[1]:
            said.append(f"answer of {name}: ranking was {ranks[0]} and is {ranks[1]}")
    return said


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="record the answers instead of comparing them")
    parser.add_argument("names", nargs="*", metavar="STUDY")
    args = parser.parse_args()
    prepare_jax()
    now = answers(args.names)
    if args.write:
        record("recorded", now)
        return
    said = differences(committed("recorded")["results"], now)
    sys.stdout.write("\n".join(said or [f"{len(now['fits'])} fits and {len(now['explained'])} answers as recorded"]) + "\n")
    if said:
        raise SystemExit(1)


if __name__ == "__main__":
    main()
