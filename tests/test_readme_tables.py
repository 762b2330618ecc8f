"""The tables of the README and of the pages in docs are those that the results of the benchmarks make."""

import re

import pytest

from benchmarks import tables

PAGES = tables.PAGES
LONGEST_README = 150


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_tables_are_up_to_date(page):
    text = page.read_text()
    assert re.findall(r"<!-- table:([a-z]+) -->", text) == list(PAGES[page])
    assert text == tables.filled(text, PAGES[page]), "run `python -m benchmarks.tables`"


def test_the_readme_is_short_and_gives_the_answer_first():
    text = tables.README.read_text()
    assert len(text.splitlines()) <= LONGEST_README
    assert text.index("table:answer") < text.index("## How to take the poses")
