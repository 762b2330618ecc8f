"""Ablations of the loop: the same blind cases diagnosed with one part left out at a time.

    python -m benchmarks.ablations CASES ANSWERS --json FILE [--first 40] [--jobs 2]

A part that no setting disables is replaced by a simpler one defined here. Each variant runs in its own processes.
``as it is`` is run on the same cases, and writes to `results/ablations.json` with the others.
"""

import argparse
import json
import multiprocessing
import sys
import tomllib
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor, as_completed
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np

from benchmarks.blind_score import diagnose, prepare, score, table
from benchmarks.record import record

COARSE = 8  # elements of the two variants on a coarse mesh, with and without the gate


def _module(name):
    return import_module(f"scan2flex_jax.{name}")


def white_noise() -> None:
    """Residuals are taken to be independent from point to point."""
    residual, Noise = _module("diagnosis.residual"), _module("fitting.noise").Noise
    small = 1e-4  # of the white part: the remaining correlated part

    def only_white(negative, size, length, alike=0.0):
        from scipy import optimize  # noqa: PLC0415

        def at(u):
            noise = Noise(float(np.exp(u)), small * float(np.exp(u)), 0.07 * length)
            return negative(noise, np.log([noise.white, noise.white, noise.correlation_length]))

        u = optimize.minimize_scalar(at, bounds=(np.log(0.02 * size), np.log(2.0 * size)), method="bounded").x
        return Noise(float(np.exp(u)), small * float(np.exp(u)), 0.07 * length)

    residual.most_likely = only_white
    residual.Complement.draws = lambda self, noise, count, rng: [noise] * count


def no_sizes() -> None:
    """BIC in place of the evidence: without prior sizes of effects."""
    evidence, pairs, search = (_module(f"diagnosis.{name}") for name in ("evidence", "pairs", "search"))
    points = {}

    def log_evidence(A, b, one_sided=()):
        return float(0.5 * b @ np.linalg.lstsq(A, b, rcond=1e-9)[0] - 0.5 * len(b) * np.log(max(points.get("n", 2), 2)))

    relative, one_step = search._relative, search.one_step

    def by_bic(stage, components, *rest):
        found = relative(stage, components, *rest)
        free = sum(len(c.entry.amplitudes) + len(c.moving) for c in components)
        found.log_evidence = 0.5 * (stage.base.chi2 - found.chi2) - 0.5 * free * np.log(len(stage.y))
        return found

    def counted(stage):
        points["n"] = len(stage.y)
        return one_step(stage)

    evidence.log_evidence = pairs.log_evidence = log_evidence
    search._relative, search.one_step = by_bic, counted


def no_ties() -> None:
    """The first effect type is named whatever its lead."""
    verdict = _module("diagnosis.verdict")
    verdict.ties = lambda candidates, settings: [max(range(len(candidates)), key=lambda i: candidates[i].log_evidence)]
    verdict.leading = lambda candidates, field=0.0, settings=None: verdict.NAMED


def _as_it_is() -> None:
    """No replacement."""


def _one_effect() -> dict:
    return {"settings": _module("diagnosis").DiagnosisSettings(most_effects=1)}


VARIANTS: dict[str, tuple[Callable[[], None], Callable[[], dict]]] = {
    "as it is": (_as_it_is, dict),
    "white noise assumed": (white_noise, dict),
    "no prior sizes": (no_sizes, dict),
    "no tie rule": (no_ties, dict),
    "no pairs": (_as_it_is, _one_effect),
    f"{COARSE} elements": (_as_it_is, lambda: {"elements": COARSE}),
    f"{COARSE} elements, no mesh gate": (_as_it_is, lambda: {"elements": COARSE, "mesh": False}),
}


def _prepare(variant):
    prepare()
    VARIANTS[variant][0]()


def run(variant: str, folders: list[Path], jobs: int) -> dict:
    """Results by case."""
    out, context = {}, multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(jobs, context, partial(_prepare, variant)) as pool:
        running = {pool.submit(diagnose, f, VARIANTS[variant][1]()): f.name for f in folders}
        for finished in as_completed(running):
            out[running[finished]] = finished.result()
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("cases", type=Path)
    parser.add_argument("answers", type=Path)
    parser.add_argument("--json", type=Path, required=True, help="results so far: a run that was stopped goes on from it")
    parser.add_argument("--first", type=int, default=40)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--table", action="store_true", help="only the table of what was run to the end")
    args = parser.parse_args()
    folders = [f for f in sorted(args.cases.iterdir()) if f.is_dir()][: args.first]
    results = json.loads(args.json.read_text()) if args.json.exists() else {}
    for variant in VARIANTS if not args.table else ():
        todo = [f for f in folders if f.name not in results.setdefault(variant, {})]
        if todo:
            results[variant] |= run(variant, todo, args.jobs)
            args.json.write_text(json.dumps(results))
            sys.stderr.write(f"{variant}: done\n")
    answers = {f.name: tomllib.loads((args.answers / f"{f.name}.toml").read_text()) for f in folders}
    loose = {f.name: "tolerance" in tomllib.loads((f / "study.toml").read_text()) for f in folders}
    tables = {}
    for variant, found in results.items():
        if not found:
            continue
        known = [n for n in answers if n in found and "skipped" not in found[n]]
        tables[variant] = table([score(found[n], answers[n], loose[n]) for n in known])
    record("ablations", {"cases": len(folders), "variants": tables})
    sys.stdout.write(json.dumps(tables, indent=1) + "\n")


if __name__ == "__main__":
    main()
