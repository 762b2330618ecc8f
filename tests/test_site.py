"""The site and the README: contents, tables of benchmarks, reference of public names and citation are those of the package."""

import ast
import importlib.util
import re
import tomllib

import pytest

import scan2flex_jax
from benchmarks import tables
from tests.documents import DOCS, PAGES, ROOT

CONTENTS = (ROOT / "mkdocs.yml").read_text("utf-8").partition("\nnav:\n")[2]
CITATION = (ROOT / "CITATION.cff").read_text("utf-8")
HOOKS = DOCS / "hooks.py"


def constant(name):
    """A constant of the hooks, which cannot be imported without the libraries of the extra `[docs]`."""
    tree = ast.parse(HOOKS.read_text("utf-8"))
    [value] = [n.value for n in tree.body if isinstance(n, ast.Assign) and getattr(n.targets[0], "id", "") == name]
    return ast.literal_eval(value)


@pytest.fixture(scope="module")
def hooks():
    """The functions that mkdocs calls."""
    for library in ("mkdocs", "latex2mathml"):
        pytest.importorskip(library, reason="the site's libraries come with the extra [docs]")
    spec = importlib.util.spec_from_file_location("site_hooks", HOOKS)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_page_is_in_the_contents():
    listed = re.findall(r"[\w/-]+\.md", CONTENTS)
    made = {*constant("PAGES").values(), *(f"api/{page}.md" for page in constant("API")), "api/index.md", "notebooks/index.md"}
    assert sorted(listed) == sorted(made | {p.relative_to(DOCS).as_posix() for p in PAGES})


def test_every_public_name_has_its_place_in_the_reference(hooks):
    made = hooks._api()
    for name in set(scan2flex_jax.__all__) - {"plot"}:
        assert any(f".{name}\n" in text for text in made.values()), name
    text = made["api/index.md"]
    assert set(re.findall(r"`scan2flex_jax\.(\w+)`", text)) == set(scan2flex_jax.__all__) - {"plot"}


def test_a_page_that_loads_from_the_network_is_refused(hooks, tmp_path):
    class Config:
        site_dir = str(tmp_path)

    page = tmp_path / "page.html"
    page.write_text('<a href="https://example.org">a link is no load</a><img src="a.png">')
    hooks.on_post_build(Config)
    for tag in ('<script src="https://example.org/a.js">', '<link rel="stylesheet" href="//example.org/a.css">'):
        page.write_text(tag)
        with pytest.raises(Exception, match=r"page.html loads from the network"):
            hooks.on_post_build(Config)


def test_the_citation_is_of_this_version():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    told = dict(re.findall(r"^(\w[\w-]*): (.+)$", CITATION, re.MULTILINE))
    assert (told["version"], told["license"]) == (project["version"], project["license"])
    assert told["version"] == scan2flex_jax.__version__
    assert "name: scan2flex_jax developers" in CITATION
    assert f"## {told['version']}" in (ROOT / "CHANGELOG.md").read_text("utf-8")


@pytest.mark.parametrize("page", tables.PAGES, ids=lambda page: page.name)
def test_tables_are_up_to_date(page):
    text = page.read_text()
    assert re.findall(r"<!-- table:([a-z]+) -->", text) == list(tables.PAGES[page])
    assert text == tables.filled(text, tables.PAGES[page]), "run `python -m benchmarks.tables`"


def test_the_readme_is_short_and_gives_the_answer_first():
    text = tables.README.read_text()
    assert len(text.splitlines()) <= 150
    assert text.index("table:answer") < text.index("## How to take the poses")
