"""Shared by all pages of tables: the record of a benchmark, a table in Markdown, and the line below it."""

import json

from benchmarks.record import RESULTS


def load(name: str) -> dict:
    """The record of one benchmark."""
    return json.loads((RESULTS / f"{name}.json").read_text())


def table(head, rows) -> str:
    """Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join(f"| {' | '.join(str(x) for x in line)} |\n" for line in lines)


def made_on(entry, of: str = "") -> str:
    """Machine and date of the figures, in a sentence below the table; ``of``: the rows that it is about."""
    m = entry["machine"]
    return (
        f"\n{of}{m['cores']} cores ({m['cpu']}), load average {m['load_average']} at the end; jax {entry['versions']['jax']}, "
        f"CPU, float64; {entry['date'][:10]}.\n"
    )
