"""The tables of docs/robustness.md: cables far from everyday ones, branches, broken files, attacks. See `benchmarks.tables`."""

from pathlib import Path

from benchmarks.markdown import load, made_on, table

PAGE = Path(__file__).parents[1] / "docs" / "robustness.md"
WAYS = ("equilibrium", "check", "simulate", "fit")


def extremes() -> str:
    """Outcome of every case in each step of the package, with the reason of a refusal."""
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
    """Every reader: number of broken inputs and of refusals, the slowest, and failures."""
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
    """Random twisted studies: number of believed fits, and the errors of their estimates."""
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


_ATTACKED = {
    "values": "fields of study.toml, of studies in memory and of the rod; options",
    "names": "names of poses, through seven commands",
    "outputs": "results onto own and foreign files, links, devices, pipes, full disks",
    "sizes": "files that are large, sparse, packed, deep, or other than they say",
    "stores": "files of a sweep: bits, cuts, copies, exchanges, text",
    "caches": "entries of the compilation cache; two processes on one cache",
    "kills": "SIGKILL of fit, explain, report and extract, and the run after it",
    "surroundings": "no home, another user, a read-only installation, closed streams, few resources",
}


def attacks() -> str:
    """Every class of attacks: number of tries, their outcomes, and the first failure."""
    entry = load("attacks")
    r, rows = entry["results"], []
    for name, c in r["classes"].items():
        failures = sum(f["count"] for f in c["failures"].values())
        slowest = f"{c['slowest_s']:.1f} s"
        rows.append([name, _ATTACKED[name], c["tries"], c["worked"], c["refused"], failures, slowest, f"{c['most MB']} MB"])
    said = f"\nIn all {r['tries']} tries, {r['failures']} failures"
    not_run = [f"{count} not run ({why})" for c in r["classes"].values() for why, count in c["not run"].items()]
    said += f"; {', '.join(not_run)}.\n" if not_run else ".\n"
    for name, c in r["classes"].items():
        said += "".join(f"\n* {name}: {f['count']} times {kind}, first in `{f['try']}`.\n" for kind, f in c["failures"].items())
    head = ["class", "what is attacked", "tries", "worked", "refused", "failures", "slowest", "most memory"]
    return table(head, rows) + said + made_on(entry)


TABLES = {"extremes": extremes, "branches": branches, "fuzz": fuzz, "attacks": attacks}
