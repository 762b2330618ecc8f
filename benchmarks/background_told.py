"""An effect above a background, fitted by `fit` that is given its type and starts at the true values.

    python -m benchmarks.background_told CASES ANSWERS --json FILE [--only b001,b002] [--record]

The cases are those of `benchmarks.blind.generate --background` with one effect. Each is fitted with the true effect type
declared, its parameters and the stiffnesses unknown. `fit` takes unweighted distances; `explain` has to find the type, but
weighs the discrepancy of each pose. Results of an earlier run in the file are kept.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.background_score import SIZE, SIZES, STIFFNESSES, VALIDATE, share, size_off_by
from benchmarks.each_case import run
from benchmarks.unknowns import freed


def fitted(folder: Path, answer: dict) -> dict:
    """Errors of size and of validate poses, of a fit that is given the effect type of the case and starts at the truth."""
    from scan2flex_jax.errors import Scan2FlexError  # noqa: PLC0415 - the environment must be set first
    from scan2flex_jax.fitting import fit  # noqa: PLC0415
    from scan2flex_jax.study import EffectDeclaration, load_study  # noqa: PLC0415

    true = dict(answer["effect"][0])
    kind = true.pop("kind")
    study = load_study(folder)
    own = tuple(replace(u, guess=answer[f"true_{u.name}"]) if u.name in STIFFNESSES else u for u in study.unknowns)
    more = freed(kind, true)
    effects = (*study.effects, EffectDeclaration(kind, true))
    out = {"kind": kind}
    try:
        found = fit(replace(study, effects=effects, unknowns=(*own, *more)))
    except Scan2FlexError as fault:
        return out | {"fault": str(fault)}
    estimated = {u.name.partition(".")[2]: found.estimates[u.name].value for u in more}
    values = true | estimated
    if kind in SIZES:
        out["size_off_by"] = size_off_by(kind, values, true, answer["true_length"])
    attained = found.rms("validate") / answer["attained_validate"]
    return out | {"validate_over_attained": attained if np.isfinite(attained) else None}


def table(rows: list[dict]) -> dict:
    """Shares of the cases within the targets of `background_score`; a case with a fault counts as missed."""
    sized = [r for r in rows if r["kind"] in SIZES]
    return {
        "cases": len(rows), "faults": sum("fault" in r for r in rows),
        "size_within_15_percent": share(r.get("size_off_by", np.inf) < SIZE for r in sized),
        "validate_within_1.3": share((r.get("validate_over_attained") or np.inf) < VALIDATE for r in rows),
    }  # fmt: skip


if __name__ == "__main__":
    run("background_told", __doc__, fitted, table, lambda answer: len(answer["kinds"]) == 1)
