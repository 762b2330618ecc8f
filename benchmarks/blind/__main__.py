"""The data set of blind cases: `python -m benchmarks.blind export FOLDER`.

export FOLDER [--cases CASES --answers ANSWERS]    write it (without the two options the cases are generated: ten minutes)
answer FOLDER --by plain|oracle|explain MINE.json  answers of this package; a second run continues the first
score FOLDER MINE.json --record NAME               the rows of the data set's scorer, into benchmarks/results/NAME.json
"""

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.blind import data_set
from benchmarks.record import complete, record, recorded
from scan2flex_jax.cli.setup import prepare_jax
from scan2flex_jax.errors import Scan2FlexError


def rows(folder: Path, mine: Path) -> dict[str, dict]:
    """The rows of the scorer that the data set has, by case."""
    told = subprocess.run([sys.executable, folder / "score.py", mine], check=True, capture_output=True, text=True).stdout
    return {row.pop("case"): row for row in map(json.loads, told.splitlines())}


def export(args) -> None:
    if args.cases:
        return data_set.export(args.folder, args.cases, args.answers)
    with tempfile.TemporaryDirectory() as made:
        cases, answers = Path(made, "cases"), Path(made, "answers")
        of = ["--count", data_set.COUNT, "--seed", data_set.SEED, "--cases", cases, "--answers", answers]
        subprocess.run([sys.executable, "-m", "benchmarks.blind.generate", *map(str, of)], check=True)
        return data_set.export(args.folder, cases, answers)


def answer(args) -> None:
    from benchmarks.blind import answering  # noqa: PLC0415 - JAX must be set up first

    prepare_jax()
    found = json.loads(args.mine.read_text()) if args.mine.exists() else {}
    names = sorted(f.stem for f in (args.folder / "answers").glob("*.json"))
    keep = lambda: args.mine.write_text(json.dumps(found) + "\n")  # noqa: E731
    complete(found, names, lambda name: answering.answer(args.folder, name, args.by), keep)


def score(args) -> None:
    found = rows(args.folder, args.mine)
    print(json.dumps(found, indent=1))
    if args.record:
        by = recorded("blind_others") | {args.record: found}
        record("blind_others", by)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    for what in (export, answer, score):
        command = commands.add_parser(what.__name__)
        command.set_defaults(run=what)
        command.add_argument("folder", type=Path)
        if what is export:
            command.add_argument("--cases", type=Path)
            command.add_argument("--answers", type=Path)
        else:
            command.add_argument("mine", type=Path)
        if what is answer:
            command.add_argument("--by", choices=("plain", "oracle", "explain"), required=True)
        if what is score:
            command.add_argument("--record", help="name under which the rows are kept in benchmarks/results/blind_others.json")
    args = parser.parse_args()
    try:
        args.run(args)
    except Scan2FlexError as fault:
        sys.exit(str(fault))


if __name__ == "__main__":
    main()
