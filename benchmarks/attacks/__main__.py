"""`python -m benchmarks.attacks`: all tries, counted and recorded; see the package."""

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")

import jax
import numpy as np

from benchmarks.attacks.attempt import LIMIT_MB, LIMIT_S, Place, Tally, Try, run
from benchmarks.record import RESULTS, record

CLASSES = ("values", "names", "outputs", "sizes", "stores", "caches", "kills", "surroundings")


def tries(name: str, place: Place, seed: int) -> Iterator[Try]:
    """The tries of one class; the same seed gives the same."""
    rng = np.random.default_rng([seed, CLASSES.index(name)])
    return import_module(f"benchmarks.attacks.{name}").tries(place, rng)


def attacked(name: str, seed: int, most: int | None = None) -> Tally:
    """All tries of one class, or ``most`` of them spread evenly, in a folder of their own."""
    with tempfile.TemporaryDirectory() as folder:
        place = Place(Path(folder))
        every = list(tries(name, place, seed))
        if most is not None and most < len(every):
            every = [every[i] for i in np.linspace(0, len(every) - 1, most).astype(int)]
        return run(every, place)


def summary(tallies: dict[str, Tally], seed: int) -> dict:
    """The figures of the record."""
    rows = {
        name: {
            "tries": t.tries, "worked": t.worked, "refused": t.refused, "failures": t.failures, "not run": t.not_run,
            "seconds": round(t.seconds, 1), "slowest_s": round(t.slowest_s, 2), "slowest": t.slowest,
            "most MB": round(t.most_mb),
        }
        for name, t in tallies.items()
    }  # fmt: skip
    failed = sum(f["count"] for t in tallies.values() for f in t.failures.values())
    limits = {"seconds": LIMIT_S, "MB": LIMIT_MB}
    return {
        "seed": seed,
        "tries": sum(t.tries for t in tallies.values()),
        "failures": failed,
        "limits": limits,
        "classes": rows,
    }


def with_others(found: dict) -> dict:
    """The figures with the classes of the record that were not run again."""
    path = RESULTS / "attacks.json"
    old = json.loads(path.read_text())["results"] if path.exists() else {}
    if old.get("seed") != found["seed"]:
        return found
    rows = {name: row for name in CLASSES for row in [found["classes"].get(name, old["classes"].get(name))] if row}
    failed = sum(f["count"] for row in rows.values() for f in row["failures"].values())
    return found | {"tries": sum(row["tries"] for row in rows.values()), "failures": failed, "classes": rows}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", choices=CLASSES, help="one class; the others of the record stay as they are")
    parser.add_argument("--most", type=int, help="at most so many tries of each class; nothing is recorded then")
    a = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    tallies: dict[str, Tally] = {}
    for name in [a.only] if a.only else CLASSES:
        tallies[name] = t = attacked(name, a.seed, a.most)
        failed = sum(f["count"] for f in t.failures.values())
        counts = f"{t.tries} tries, {t.worked} worked, {t.refused} refused, {failed} failures"
        print(f"{name:<14}{counts}, {t.seconds:.0f} s", flush=True)
        for why, count in t.not_run.items():
            print(f"    {count} not run: {why}", flush=True)
        for kind, f in t.failures.items():
            print(f"    {f['count']} x {kind}, first in {f['try']!r}: {f['example']}", flush=True)
        if not a.most:
            record("attacks", with_others(summary(tallies, a.seed)))
    if summary(tallies, a.seed)["failures"]:
        sys.exit(1)


if __name__ == "__main__":
    main()
