"""Coverage of the intervals of EI and GJ if the baseline model is incomplete: `fit` alone, before any effect is found.

    python -m benchmarks.blind.generate --background --cases CASES --answers ANSWERS --count 60 --seed N
    python -m benchmarks.coverage CASES ANSWERS --json FILE [--only b001,b002] [--record]

In `alone` each pose has a random deviation and nothing else is missing; `with_effect` adds an undeclared effect. A value
without an interval, or that the fit itself doubts, is counted separately: an interval that contains the truth with a warning
is worth less than one without. Results of an earlier run in the file are kept.
"""

from pathlib import Path
from statistics import median

from benchmarks.background_score import STIFFNESSES, covered, share
from benchmarks.each_case import run


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


if __name__ == "__main__":
    run("coverage", __doc__, fitted, table)
