"""Places in the code that the documents name are there, and so are the commands and options that they show."""

import ast
import re
from pathlib import Path

import pytest
from typer.main import get_command

from scan2flex_jax.cli.app import app

ROOT = Path(__file__).parents[2]
THEORY = (ROOT / "docs" / "theory.md").read_text("utf-8")
PLACES = re.findall(r"`([a-z_]+/[a-z_]+\.py)`((?:,? `[A-Za-z_]+`)*)", " ".join(THEORY.split()))
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]


@pytest.mark.parametrize(("file", "names"), PLACES, ids=[f for f, _ in PLACES])
def test_every_equation_has_its_place(file, names):
    tree = ast.parse((ROOT / "scan2flex_jax" / file).read_text("utf-8"))
    kinds = (ast.FunctionDef, ast.ClassDef)
    defined = {node.name for node in ast.walk(tree) if isinstance(node, kinds)}
    assert set(re.findall(r"`([A-Za-z_]+)`", names)) <= defined


def test_the_page_names_its_sources():
    assert len(PLACES) > 30
    for equation in range(1, 11):
        assert re.search(rf"Eqs?\. (?:\d+ and )?{equation}\b|Eq\. {equation}\b", THEORY), f"paper's Eq. {equation}"


@pytest.mark.parametrize("document", DOCUMENTS, ids=[d.name for d in DOCUMENTS])
def test_documents_show_commands_that_there_are(document):
    commands = get_command(app).commands
    for line in re.findall(r"^\s*(?:\.venv/bin/)?scan2flex ([a-z].*)$", document.read_text("utf-8"), re.MULTILINE):
        name, *rest = line.split("#")[0].split()
        assert name in commands, line
        known = {option for parameter in commands[name].params for option in parameter.opts}
        assert {word for word in rest if word.startswith("-")} <= known, line


@pytest.mark.parametrize("document", DOCUMENTS, ids=[d.name for d in DOCUMENTS])
def test_links_lead_somewhere(document):
    for target in re.findall(r"\]\(([^)#:]+)\)", document.read_text("utf-8")):
        assert (document.parent / target).exists(), target
