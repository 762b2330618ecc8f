"""The tables of docs/robustness.md: cables far from everyday ones, branches, broken files. See `benchmarks.tables`."""

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


def branches() -> str:
    """Random twisted studies: how many were believed, and how their estimates lie about the truth."""
    entry = load("branches")
    r, rows = entry["results"]["summary"], []
    for letters in ("EI", "GJ"):
        e = r[letters]
        covered = f"{e['covered']} of {e['determined']}"
        rows.append([letters, covered, f"{e['largest']:.1f}", e["beyond"]])
    doubted = r["studies"] - r["believed"] - r["refused"]
    counts = f"{r['studies']} studies: {r['believed']} believed, {doubted} not believed, {r['refused']} refused"
    said = f"\n{counts}; turns other than the stated ones in {r['turned']}.\n"
    head = ["of the believed studies", "95 % intervals that hold the truth", "largest abs(z)", "abs(z) above 4"]
    return table(head, rows) + said + made_on(entry)


TABLES = {"extremes": extremes, "branches": branches, "fuzz": fuzz}
