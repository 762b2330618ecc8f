"""Rate of false alarms of `explain` on studies with nothing missing.

    python -m benchmarks.calibration --json FILE [--jobs 2] CASES ANSWERS [CASES ANSWERS ...]

All cases with nothing missing of folders that `benchmarks.blind` made are explained; the record holds their probabilities that
nothing is missing, and the share below 5 % with its 95 % interval (Clopper and Pearson).
"""

import argparse
import tomllib
from pathlib import Path

from scipy import stats

from benchmarks.blind_score import explain_all
from benchmarks.record import record

LEVEL = 0.05


def with_nothing_missing(cases: Path, answers: Path) -> dict[str, Path]:
    """Study folders by a name that includes their parent folder."""
    found = {}
    for folder in sorted(f for f in cases.iterdir() if f.is_dir()):
        answer = tomllib.loads((answers / f"{folder.name}.toml").read_text())
        if not answer.get("kinds") and answer.get("off_catalogue", "none") in ("none", ""):
            found[f"{cases.parent.name}/{folder.name}"] = folder
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER", help="CASES ANSWERS, in pairs")
    parser.add_argument("--json", type=Path, required=True, help="results so far: a run that was stopped goes on from it")
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args()
    if len(args.folders) % 2:
        parser.error("name the answers of each folder of cases")
    todo: dict[str, Path] = {}
    for cases, answers in zip(args.folders[::2], args.folders[1::2], strict=True):
        todo |= with_nothing_missing(cases, answers)
    found = explain_all(todo, args.json, args.jobs)
    p = [r["test"]["p_value"] for r in found.values() if "test" in r]
    others = {n: r.get("fault") or r.get("verdict") for n, r in found.items() if "test" not in r}
    alarms = sum(v < LEVEL for v in p)
    low, high = stats.binomtest(alarms, len(p)).proportion_ci(method="exact")
    figures = {"cases": len(p), "alarms": alarms, "share": alarms / len(p), "low": float(low), "high": float(high)}
    record("calibration", figures | {"probabilities": sorted(p), "without_a_test": others})


if __name__ == "__main__":
    main()
