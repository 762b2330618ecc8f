"""The tables of docs/robustness.md: cables far from everyday ones, and broken files. See `benchmarks.tables`."""

from pathlib import Path

from benchmarks.markdown import load, made_on, table

PAGE = Path(__file__).parents[1] / "docs" / "robustness.md"
WAYS = ("equilibrium", "check", "simulate", "fit")


def extremes() -> str:
    """Every case by what came of it on each way through the package, with the reason where it was refused."""
    entry = load("robustness")
    rows = []
    for name, ways in entry["results"]["cases"].items():
        found = [ways[way]["outcome"] if way in ways else "-" for way in WAYS]
        e = ways["equilibrium"]
        why = f"{e['steps']} steps" if e["outcome"] == "solved" else e.get("says", "-")
        rows.append([name, *found, why])
    counts = ", ".join(f"{n} {outcome}" for outcome, n in entry["results"]["outcomes"].items())
    return table(["cable", *WAYS, "its equilibrium"], rows) + f"\nIn all: {counts}.\n" + made_on(entry)


def fuzz() -> str:
    """Every reader: how many broken inputs it got, how many it refused, the slowest, and what failed."""
    entry = load("fuzz")
    rows = []
    for name, r in entry["results"]["readers"].items():
        failures = sum(f["count"] for f in r["failures"].values())
        rows.append([name, r["inputs"], r["refused in one sentence"], f"{1e3 * r['slowest_s']:.0f} ms", failures])
    r = entry["results"]
    memory = f"{r['memory beyond the start, MB']:.0f} MB"
    said = f"\nIn all {r['inputs']} inputs, {r['failures']} failures, {memory} of memory beyond the start.\n"
    return table(["reader", "inputs", "refused in one sentence", "slowest", "failures"], rows) + said + made_on(entry)


TABLES = {"extremes": extremes, "fuzz": fuzz}
