"""The tables of the README and of the pages in docs are those that the results of the benchmarks make."""

import re

import pytest

from benchmarks import tables

PAGES = tables.pages()


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_tables_are_up_to_date(page):
    text = page.read_text()
    assert re.findall(r"<!-- table:([a-z]+) -->", text) == list(PAGES[page])
    assert text == tables.filled(text, PAGES[page]), "run `python -m benchmarks.tables`"


def test_every_table_says_where_its_figures_come_from():
    for make in (make for page in PAGES.values() for make in page.values()):
        assert "load average" in make()
        assert make().count("\n|") >= 3
