"""The table of docs/export.md: how near exported cables come to rest. See `benchmarks.tables`."""

from pathlib import Path

from benchmarks.markdown import load, made_on, table

PAGE = Path(__file__).parents[1] / "docs" / "export.md"
_NAMES = {"mujoco": "MuJoCo", "pyelastica": "PyElastica", "usd": "Newton"}


def exports() -> str:
    """Distance of the settled links from our nodes, by simulator and number of links."""
    entry = load("exports")
    rows = []
    for target, name in _NAMES.items():
        of = entry["results"].get(target)
        for links, r in {} if of is None else of["links"].items():
            fastest = "-" if r["fastest"] is None else f"{r['fastest']:.0e}"
            rows.append([f"{name} {of['version']}", links, f"{100 * r['distance over length']:.3f} %", fastest])
        if of is None:
            rows.append([name, "-", "-", "-"])
    return table(["simulator", "links", "largest distance, of the length", "motion left (m/s, rad/s)"], rows) + made_on(entry)


TABLES = {"exports": exports}
