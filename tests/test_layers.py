"""Imports between sub-packages point downward only."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "scan2flex_jax"
NAME = PACKAGE.name
# for each sub-package, the others that it may import from
ALLOWED = {
    "errors": set(),
    "compilation": {"errors"},
    "geometry": {"errors"},
    "study": {"errors"},
    "scan": {"geometry", "study", "errors"},
    "rod": {"geometry", "compilation", "errors"},
    "effects": {"geometry", "rod", "study", "compilation", "errors"},
    "statics": {"geometry", "rod", "compilation", "errors"},
}
ALLOWED["fitting"] = {*ALLOWED, "examples"}
ALLOWED["sweep"] = {*ALLOWED["fitting"], "fitting"}
ALLOWED["diagnosis"] = {*ALLOWED["fitting"], "fitting"}
ALLOWED["prediction"] = ALLOWED["diagnosis"]
ALLOWED["plot"] = {*ALLOWED["prediction"], "prediction", "diagnosis"}
ALLOWED["convert"] = {"study", "errors"}
ALLOWED["export"] = {*ALLOWED["prediction"], "prediction"}
ALLOWED["reporting"] = {*ALLOWED["prediction"], "diagnosis", "prediction"}
ALLOWED["cli"] = {*ALLOWED["plot"], "plot", "convert", "export", "reporting"}
NO_JAX = ("study", "convert", "errors")


def files(part):
    """The modules of a sub-package, or of a module of that name."""
    return sorted((PACKAGE / part).rglob("*.py")) + [p for p in [PACKAGE / f"{part}.py"] if p.exists()]


def imported(path):
    """Absolute dotted names that the module imports, wherever in the file."""
    base = [NAME, *path.relative_to(PACKAGE).parts[:-1]]
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            stem = base[: len(base) - node.level + 1] if node.level else []
            name = ".".join([*stem, *([node.module] if node.module else [])])
            yield from (f"{name}.{alias.name}" for alias in node.names)


def parts_of(path):
    """Sub-packages of this package that the module imports."""
    return {name.split(".")[1] for name in imported(path) if name.startswith(f"{NAME}.")}


@pytest.mark.parametrize("part", ALLOWED)
def test_imports_point_downward(part):
    if not files(part):
        pytest.skip("not there yet")
    wrong = {str(p.relative_to(PACKAGE)): parts_of(p) - ALLOWED[part] - {part} for p in files(part)}
    assert {path: names for path, names in wrong.items() if names} == {}


@pytest.mark.parametrize("part", NO_JAX)
def test_reading_a_study_needs_no_jax(part):
    libraries = {name.split(".")[0] for path in files(part) for name in imported(path)}
    assert not libraries & {"jax", "jaxlib", "equinox", "optimistix", "lineax", "jaxtyping"}
