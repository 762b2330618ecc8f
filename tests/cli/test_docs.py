"""Places in the code that the documents name are there, and so are the commands, options and links that they show."""

import ast
import functools
import re

import pytest
import typer
from typer.main import get_command
from typer.testing import CliRunner

from scan2flex_jax.cli.app import app
from tests.documents import DOCS, DOCUMENTS, ROOT, anchors, blocks, commands, name_of

THEORY = (DOCS / "theory.md").read_text("utf-8")
PLACES = re.findall(r"`([a-z_]+/[a-z_]+\.py)`((?:,? `[A-Za-z_]+`)*)", " ".join(THEORY.split()))
PROGRAM = get_command(app).commands
each_document = pytest.mark.parametrize("document", DOCUMENTS, ids=name_of)


@pytest.mark.parametrize(("file", "names"), PLACES, ids=[f for f, _ in PLACES])
def test_every_equation_has_its_place(file, names):
    tree = ast.parse((ROOT / "scan2flex_jax" / file).read_text("utf-8"))
    kinds = (ast.FunctionDef, ast.ClassDef)
    defined = {node.name for node in ast.walk(tree) if isinstance(node, kinds)}
    assert set(re.findall(r"`([A-Za-z_]+)`", names)) <= defined


@pytest.fixture
def parser(tmp_path, monkeypatch):
    """The program with commands that parse and do nothing, in an empty folder."""
    monkeypatch.chdir(tmp_path)
    idle = typer.Typer(pretty_exceptions_enable=False)
    for name, command in zip(PROGRAM, app.registered_commands, strict=True):
        idle.command(name)(functools.wraps(command.callback)(lambda **given: None))
    return lambda words: CliRunner().invoke(idle, words)


@each_document
def test_documents_show_commands_that_the_program_accepts(document, parser):
    text = document.read_text("utf-8")
    assert set(re.findall(r"`scan2flex ([a-z]+)", text)) <= set(PROGRAM)
    for words in commands(text):
        found = parser(words)
        assert found.exit_code == 0, (words, found.exception or found.output)


@pytest.mark.parametrize("page", ["first-cable", "taking-poses", "missing-effects", "answers", "export", "scanning"])
def test_options_in_the_text_are_those_of_the_program(page):
    known = {option for command in PROGRAM.values() for p in command.params for option in p.opts}
    named = {words.split()[0] for words in re.findall(r"`(--[a-z][^`\n]*)`", (DOCS / f"{page}.md").read_text("utf-8"))}
    assert named <= known | {"--help"}


@each_document
def test_links_lead_somewhere(document):
    for target, anchor in re.findall(r"\]\(([^)#:\s]*)(?:#([^)\s]*))?\)", document.read_text("utf-8")):
        file = document.parent / target if target else document
        assert file.exists(), target
        assert not anchor or anchor in anchors(file.read_text("utf-8")), f"{target}#{anchor}"


@each_document
def test_python_in_the_documents_imports_names_that_there_are(document):
    for code in blocks(document.read_text("utf-8"), "python"):
        for node in ast.walk(ast.parse(code)):
            if isinstance(node, ast.ImportFrom) and node.module.startswith("scan2flex_jax"):
                exec(compile(ast.Module([node], []), name_of(document), "exec"), {})
