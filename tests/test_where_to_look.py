"""The answers under "Where to look" in CONTRIBUTING.md name files and functions that exist."""

import re
from functools import reduce
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SECTION = (ROOT / "CONTRIBUTING.md").read_text("utf-8").split("## Where to look\n")[1].split("\n## ")[0]
ROWS = [[cell.strip() for cell in line.strip("|").split("|")] for line in SECTION.splitlines() if line.startswith("|")][2:]


@pytest.mark.parametrize(("question", "answer", "guess"), ROWS, ids=[row[0] for row in ROWS])
def test_every_answer_exists(question, answer, guess):
    for part in answer.split(";"):
        path, *names = re.findall(r"`([^`]+)`", part)
        assert (ROOT / "scan2flex_jax" / path).is_file()
        assert names
        module = import_module("scan2flex_jax." + path.removesuffix(".py").replace("/", "."))
        for name in names:
            assert reduce(getattr, name.split("."), module)
    for path in re.findall(r"`([^`]+)`", guess):
        assert (ROOT / "scan2flex_jax" / path).is_file()


def test_the_guesses_are_counted_as_listed():
    wrong = sum(guess.startswith("wrong") for *_, guess in ROWS)
    assert all(guess == "right" or guess.startswith("wrong: ") for *_, guess in ROWS)
    assert (len(ROWS), wrong) == (26, 7)
    assert "Twenty-six questions" in SECTION
    assert "Seven first guesses" in SECTION
