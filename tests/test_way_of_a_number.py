"""The way of a number in CONTRIBUTING.md names functions that are there, and counts its files as it lists them."""

import re
from functools import reduce
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SECTION = (ROOT / "CONTRIBUTING.md").read_text("utf-8").split("## The way of a number\n")[1].split("\n## ")[0]
ROWS = [[cell.strip() for cell in line.strip("|").split("|")] for line in SECTION.splitlines() if line.startswith("|")]
NUMBERS = dict(enumerate(ROWS[0][1:], 1))


@pytest.mark.parametrize("column", NUMBERS, ids=list(NUMBERS.values()))
def test_every_function_on_the_way_is_in_its_file(column):
    files = [row[column] for row in ROWS[2:-1] if row[column]]
    for cell in files:
        path, *names = re.findall(r"`([^`]+)`", cell)
        assert (ROOT / "scan2flex_jax" / path).is_file()
        module = import_module("scan2flex_jax." + path.removesuffix(".py").replace("/", "."))
        for name in names:
            assert callable(reduce(getattr, name.split("."), module))
    assert len({cell.split("`")[1] for cell in files}) == int(re.search(r"\d+", ROWS[-1][column])[0])
