"""The tables of docs/sweeps.md: samples in a loop and in batches. See `benchmarks.tables`."""

from pathlib import Path

from benchmarks.markdown import load, made_on, table

PAGE = Path(__file__).parents[1] / "docs" / "sweeps.md"


def batches() -> str:
    """Milliseconds of a sample, by the number of samples in one compiled call and their evaluation."""
    entry = load("sensitivity")
    ms = entry["results"]["batches"]["a loop and vmap"]["ms per lane"]
    first = next(iter(ms.values()))
    rows = [[way, f"{x:.1f}", f"{x / first:.2g}"] for way, x in ms.items()]
    return table(["way", "ms for a lane", "over the first"], rows) + made_on(entry)


def order() -> str:
    """Steps of batches of 16 over the steps that their samples need."""
    entry = load("sensitivity")
    b = entry["results"]["batches"]["a loop and vmap"]
    rows = [[name, f"{x:.2f}"] for name, x in b["steps of batches of 16 over steps of the lanes"].items()]
    return table(["order of the lanes", "steps run over steps needed"], rows) + made_on(entry)


def minima() -> str:
    """Milliseconds of the minimum from one guess, in a loop and as one compiled program."""
    entry = load("minima")
    results = entry["results"]
    rows = []
    for words, key, name in (("both starts", "minimise: ms", "both"), ("the guess alone", "guess alone: ms", "guess")):
        loop, batch = results["loop"], results[f"batched, from {name}"]
        said = f"{batch['converged']} of {batch['guesses']}", str(batch["converged elsewhere"]), f"{batch['compilation_s']:.0f}"
        rows.append([words, f"{loop[key]:.0f}", f"{batch['ms']:.0f}", f"{batch['ms'] / loop[key]:.2f}", *said])
    head = ["from", "loop, ms", "one program, ms", "ratio", "converged", "elsewhere", "compilation, s"]
    return table(head, rows) + made_on(entry)


TABLES = {"batches": batches, "order": order, "minima": minima}
