"""Coverage of the intervals of EI and GJ if the baseline model is incomplete: `fit` alone, before any effect is found.

    python -m benchmarks.blind.generate --background --cases CASES --answers ANSWERS --count 60 --seed N
    python -m benchmarks.coverage CASES ANSWERS --json FILE [--only b001,b002] [--record]

In `alone` each pose has a random deviation and nothing else is missing; `with_effect` adds an undeclared effect. A value
without an interval, or that the fit itself doubts, is counted separately: an interval that contains the truth with a warning
is worth less than one without. Results of an earlier run in the file are kept.
"""

import argparse
import json
import sys
import tomllib
from pathlib import Path
from statistics import median

from benchmarks.background_score import STIFFNESSES, covered, share
from benchmarks.record import record


def fitted(folder: Path, answer: dict) -> dict:
    """The fit of one case, and its truth."""
    from scan2flex_jax.errors import Scan2FlexError  # noqa: PLC0415 - the environment must be set first
    from scan2flex_jax.fitting import fit  # noqa: PLC0415
    from scan2flex_jax.study import load_study  # noqa: PLC0415

    out = {"kinds": answer["kinds"], "background": answer["background"]}
    try:
        found = fit(load_study(folder))
    except Scan2FlexError as fault:
        return out | {"fault": str(fault)}
    told = found.to_json()
    rms = told.get("discrepancy", {}).get("rms")
    out |= {"believable": found.believable, "estimates": {name: told["estimates"][name] for name in STIFFNESSES}}
    out |= covered("covers", told["estimates"], answer) | {"rms_fit": found.rms("fit"), "rms_validate": found.rms("validate")}
    out |= {"true": {name: answer[f"true_{name}"] for name in STIFFNESSES}}
    return out | ({} if rms is None else {"discrepancy_over_true": rms / answer["background"]})


def table(rows: list[dict]) -> dict:
    """Coverage and width of the intervals of each class and stiffness."""
    out = {"cases": len(rows), "faults": sum("fault" in r for r in rows)}
    for words, some in (("alone", [r for r in rows if not r["kinds"]]), ("with_effect", [r for r in rows if r["kinds"]])):
        known = [r for r in some if "estimates" in r]
        for name in STIFFNESSES:
            key = f"covers_{name}"
            wide = [e["std"] / e["value"] for r in known if "std" in (e := r["estimates"][name])]
            out[f"{words}_{name}"] = share(r[key] for r in known if key in r) | {
                "without_warning": share(r[key] for r in known if key in r and r["believable"]),
                "withheld": sum(key not in r for r in known), "median_relative_std": median(wide) if wide else None,
            }  # fmt: skip
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    parser.add_argument("answers", type=Path)
    parser.add_argument("--json", type=Path, required=True, help="results so far: a run that was stopped goes on from it")
    parser.add_argument("--only", default="", help="names of cases, such as b001,b002")
    parser.add_argument("--record", action="store_true", help="write benchmarks/results/coverage.json")
    args = parser.parse_args()
    from scan2flex_jax.cli.setup import prepare_jax  # noqa: PLC0415

    prepare_jax()
    rows = json.loads(args.json.read_text())["rows"] if args.json.exists() else {}
    only = set(filter(None, args.only.split(",")))
    for path in sorted(args.answers.glob("*.toml")):
        if path.stem in rows or (only and path.stem not in only):
            continue
        rows[path.stem] = fitted(args.cases / path.stem, tomllib.loads(path.read_text()))
        args.json.write_text(json.dumps({"table": table(list(rows.values())), "rows": rows}, indent=1) + "\n")
        sys.stderr.write(f"{path.stem} {({k: v for k, v in rows[path.stem].items() if k.startswith('covers')})}\n")
    if args.record:
        record("coverage", {"table": table(list(rows.values())), "rows": rows})
    sys.stdout.write(json.dumps(table(list(rows.values())), indent=1) + "\n")


if __name__ == "__main__":
    main()
