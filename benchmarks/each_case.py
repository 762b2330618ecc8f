"""The command line of a benchmark that fits every blind case once, and goes on where an earlier run stopped."""

import argparse
import json
import sys
import tomllib
from collections.abc import Callable
from pathlib import Path

from benchmarks.record import record


def run(
    name: str,
    doc: str | None,
    fitted: Callable[[Path, dict], dict],
    table: Callable[[list[dict]], dict],
    wanted: Callable[[dict], bool] = lambda answer: True,
) -> None:
    """Fit the cases ``wanted`` by their answers with ``fitted(folder, answer)``, and print the ``table`` of their rows."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    parser.add_argument("answers", type=Path)
    parser.add_argument("--json", type=Path, required=True, help="results so far: a run that was stopped goes on from it")
    parser.add_argument("--only", default="", help="names of cases, such as b001,b002")
    parser.add_argument("--record", action="store_true", help=f"write benchmarks/results/{name}.json")
    args = parser.parse_args()
    from scan2flex_jax.cli.setup import prepare_jax  # noqa: PLC0415 - the environment must be set first

    prepare_jax()
    rows = json.loads(args.json.read_text())["rows"] if args.json.exists() else {}
    only = set(filter(None, args.only.split(",")))
    for path in sorted(args.answers.glob("*.toml")):
        answer = tomllib.loads(path.read_text())
        if path.stem in rows or (only and path.stem not in only) or not wanted(answer):
            continue
        rows[path.stem] = fitted(args.cases / path.stem, answer)
        args.json.write_text(json.dumps({"table": table(list(rows.values())), "rows": rows}, indent=1) + "\n")
        sys.stderr.write(f"{path.stem} {rows[path.stem]}\n")
    if args.record:
        record(name, {"table": table(list(rows.values())), "rows": rows})
    sys.stdout.write(json.dumps(table(list(rows.values())), indent=1) + "\n")
