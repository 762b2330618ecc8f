"""The tables of the README are those that the results of the benchmarks make."""

import re

from benchmarks import tables


def test_tables_are_up_to_date():
    text = tables.README.read_text()
    assert re.findall(r"<!-- table:([a-z]+) -->", text) == list(tables.TABLES)
    assert text == tables.filled(text), "run `python -m benchmarks.tables`"


def test_every_table_says_where_its_figures_come_from():
    for make in tables.TABLES.values():
        assert "load average" in make()
        assert make().count("\n|") >= 3
