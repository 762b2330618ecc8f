"""Deliberate mistakes in studies: are they named by `check` and `fit`, and is a study without any accused?

    SCAN2FLEX_DATA=... python -m benchmarks.mistakes      (the folder that holds `practice`, `textile-strip` and `black-wire`)

Every mistake of `mistakes_made` is applied to three simulated studies (the first of the practice studies, by number, that have
centre curves, clamps at both ends, four fitted poses and nothing missing) and to two real ones. A mistake counts as

* *named* if `check_study` refuses the study, `check` warns or `fit` reports it in its first three lines, with the right remedy,
  and the corrected study fits as the one before the mistake (within a fifth);
* *without trace* if the mistaken study, at stiffnesses in proportion to its weight, has the same shapes and residual;
* *warned* if the first three lines doubt the values without naming it; else it is *missed*, and `explain` is run too.

Then all other practice studies, most of them with an undeclared effect, are fitted as they are: any mistake named there is a
false accusation.

Recorded cases are kept, so that an interrupted run continues; `--again` repeats them. The record is
`benchmarks/results/mistakes.json`.
"""

import argparse
import json
import os
import sys
import tomllib
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np

from benchmarks.mistakes_made import KINDS, both_held, rotation
from benchmarks.record import RESULTS, record
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study import load_study, study_warnings

ELEMENTS = 20  # of all fits here: the mesh error stays below 1e-4 of the length
SIMULATED, REAL = 3, ("textile-strip", "black-wire")
FEWEST = 4  # fitted poses of a simulated study
FIRST = 3  # lines that everybody reads
ALIKE = 1.2  # times the residual of the study before the mistake
TRACE = 0.1  # of that residual: modelled shapes that differ by less are the same
NAMED, WARNED, TRACELESS, MISSED = "named", "warned", "without trace", "missed"


def chosen(data: Path) -> dict:
    """The five studies by their names, the real ones first: they are fitted in seconds."""
    some = {name: load_study(data / name) for name in REAL}
    for path in sorted((data / "practice" / "cases").iterdir()):
        study = load_study(path)
        whole = all(p.curve is not None and both_held(p) for p in study.poses)
        right = whole and len(study.fit_poses) >= FEWEST and not answer(data, path.name)["kinds"]
        if len(some) < SIMULATED + len(REAL) and right:
            some[path.name] = study
    return some


def answer(data: Path, name: str) -> dict:
    """The truth of a practice study; nothing of a real one."""
    path = data / "practice" / "answers" / f"{name}.toml"
    return tomllib.loads(path.read_text()) if path.exists() else {}


def fitted(study):
    """The fit, or the sentence of its refusal."""
    from scan2flex_jax.fitting import fit  # noqa: PLC0415

    try:
        return fit(study, elements=ELEMENTS)
    except Scan2FlexError as fault:
        return str(fault)


def judged(study, clean, words, truth) -> dict:
    """The result for a mistaken study; ``clean`` is the fit before the mistake."""
    begin = perf_counter()
    found = fitted(study)
    seconds = round(perf_counter() - begin, 1)
    if isinstance(found, str):
        outcome = NAMED if any(w in found for w in words) else WARNED
        return {"outcome": outcome, "by": "refusal", "says": found[-300:], "seconds": seconds}
    checked = study_warnings(study)[:FIRST]
    lines = found.summary().splitlines()[1:FIRST]
    right = not found.mistakes or found.mistakes[0].after is None or found.mistakes[0].after < ALIKE * clean.rms()
    out = {"seconds": seconds, "says": [*checked[:1], *lines], "believable": found.believable, "valid": found.valid}
    out |= {"excludes the truth": excluded(found, truth), "doubted": bool(found.doubts or not found.believable)}
    by = [who for who, said in (("fit", lines), ("check", checked)) if any(w in line for w in words for line in said)]
    if by and right:
        return out | {"outcome": NAMED, "by": by[0]}
    if found.mistakes and same(found.mistakes[0].study, clean.study):
        return out | {"outcome": NAMED, "by": "fit"}
    if traceless(study, found, clean):
        return out | {"outcome": TRACELESS}
    if found.doubts or not found.believable:
        return out | {"outcome": WARNED}
    return out | {"outcome": MISSED, "explain": explained(study)}


def traceless(study, found, clean) -> bool:
    """Whether the shapes do not reveal the mistake: they fit the mistaken study as well, at the values of its fit or at
    stiffnesses in proportion to its weight."""
    off = [found.poses[p.name].modelled - clean.poses[p.name].modelled for p in clean.study.fit_poses]
    if not found.turned and alike(off, found.rms(), clean.rms()):
        return True
    weights = [s.cable["length_density"] * float(np.linalg.norm(s.gravity)) for s in (clean.study, study)]
    before = evaluated(clean.study, clean.minimum.shared)
    shared = clean.minimum.shared.copy()
    shared[: clean.problem.layout.unknowns] += np.log(weights[1] / weights[0])  # the unknowns of these studies are stiffnesses
    after = evaluated(study, shared, before.configuration)
    off = after.configuration.r - before.configuration.r
    return bool(after.solved and alike(off, *(float(np.sqrt(np.sum(e.residual**2))) for e in (after, before))))


def alike(off, residual, clean) -> bool:
    """Whether shapes and residuals differ by little, compared with the residual of the study without the mistake."""
    apart = float(np.sqrt(np.mean([np.sum(np.square(d), axis=-1) for d in off])))
    return apart < TRACE * clean and abs(residual / clean - 1.0) < TRACE


def evaluated(study, shared, start=None):
    """All poses of a study, validate poses too, at values of its unknowns."""
    from scan2flex_jax.fitting.problem import Problem  # noqa: PLC0415

    every = replace(study, poses=tuple(replace(p, role="fit") for p in study.poses))
    return Problem(every, ELEMENTS).evaluator(shared, start=start)


def same(mended, study) -> bool:
    """Whether a corrected study equals the study before the mistake, up to a roll common to both clamps of a pose."""
    pairs = list(zip(mended.poses, study.poses, strict=True))
    apart = [mended.gravity - study.gravity, mended.cable["length"] - study.cable["length"]]
    for a, b in pairs:
        apart.append(a.curve.points - b.curve.points)
        for one, other in ((a.start, b.start), (a.end, b.end)):
            apart += [] if one is None else [one.position - other.position, one.tangent - other.tangent]
        if both_held(b):
            p, q = (rotation(x.start).inv() * rotation(x.end) for x in (a, b))
            apart.append(np.linalg.norm((_roll(a, b) * p * _roll(a, b).inv() * q.inv()).as_rotvec()))
    return max(float(np.max(np.abs(x))) for x in apart) < 1e-3


def _roll(a, b):
    """The roll between the start clamps of a pose before and after."""
    return rotation(b.start).inv() * rotation(a.start)


def excluded(found, truth) -> bool | None:
    """Whether an interval excludes the truth; None without a truth."""
    known = {n: truth.get(f"true_{n}") for n in found.estimates}
    bars = [(e.low, known[n], e.high) for n, e in found.estimates.items() if known[n] is not None and e.low is not None]
    return any(not low <= true <= high for low, true, high in bars) if bars else None


def explained(study) -> dict:
    """The answer of `explain` to a mistake that nothing else reports."""
    from scan2flex_jax.inference import explain  # noqa: PLC0415

    found = explain(study, elements=ELEMENTS, mesh=False)
    return {"verdict": found.verdict, "chosen": [r.kind for r in found.chosen]}


def accused(study) -> dict:
    """The result for a study without a mistake."""
    found = fitted(study)
    if isinstance(found, str):
        return {"says": found[-200:], "mistakes": []}
    return {"mistakes": [str(m) for m in found.mistakes], "rms over L": found.rms() / found.problem.length}


def summed(cases, silent) -> dict:
    """Counts of named mistakes and of false accusations."""
    rows = [case for study in cases.values() for case in study.values() if case is not None]
    counts = {outcome: sum(r["outcome"] == outcome for r in rows) for outcome in (NAMED, WARNED, TRACELESS, MISSED)}
    wrong = [r for r in rows if r["outcome"] in (TRACELESS, MISSED) and r.get("excludes the truth") and not r.get("doubted")]
    return {
        "kinds": len(KINDS), "made": len(rows), **counts,
        "named of those with a trace": counts[NAMED] / max(1, len(rows) - counts[TRACELESS]),
        "intervals without a warning that exclude the truth, with a trace": sum(r["outcome"] == MISSED for r in wrong),
        "the same without a trace": sum(r["outcome"] == TRACELESS for r in wrong),
        "physics named": sum(bool(r.get("explain", {}).get("chosen")) for r in rows),
        "without a mistake": len(silent), "accused": [n for n, r in silent.items() if r["mistakes"]],
    }  # fmt: skip


def main() -> None:
    """All mistakes of all studies, then the studies without one."""
    from scan2flex_jax.cli.setup import prepare_jax  # noqa: PLC0415

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--again", action="store_true", help="make recorded cases anew")
    again = parser.parse_args().again
    data = Path(os.environ.get("SCAN2FLEX_DATA", ""))
    if not (data / "practice").is_dir():
        sys.exit("name the folder that holds practice, textile-strip and black-wire in SCAN2FLEX_DATA")
    prepare_jax()
    path = RESULTS / "mistakes.json"
    known = json.loads(path.read_text())["results"] if path.exists() and not again else {"cases": {}, "silent": {}}
    cases, silent = known["cases"], known["silent"]
    for name, study in chosen(data).items():
        clean, mine = None, cases.setdefault(name, {})
        for kind, (change, words) in KINDS.items():
            if kind in mine:
                continue
            mistaken = change(study)
            clean = clean or (fitted(study) if mistaken is not None else None)
            mine[kind] = None if mistaken is None else judged(mistaken, clean, words, answer(data, name))
            sys.stdout.write(f"{name} | {kind} | {mine[kind]}\n")
            sys.stdout.flush()
            record("mistakes", {"cases": cases, "silent": silent, "table": summed(cases, silent)})
    for folder in [*sorted((data / "practice" / "cases").iterdir()), *(data / n for n in (*REAL, "red-wire"))]:
        study = load_study(folder)
        if folder.name not in silent and all(p.curve is not None for p in study.poses):
            silent[folder.name] = accused(study)
            sys.stdout.write(f"{folder.name} | nothing mistaken | {silent[folder.name]}\n")
            sys.stdout.flush()
            record("mistakes", {"cases": cases, "silent": silent, "table": summed(cases, silent)})


if __name__ == "__main__":
    main()
