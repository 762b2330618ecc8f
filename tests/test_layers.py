"""Imports between sub-packages point downward only, and no modules import each other in a circle.

Imports inside functions count like those at the head of a module, and so do those that only a type checker sees.
"""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "scan2flex_jax"
NAME = PACKAGE.name
# for each sub-package, the others that it may import from
ALLOWED = {
    "errors": set(),
    "version": set(),
    "names": set(),
    "examples": {"errors"},
    "programs": set(),
    "compilation": {"programs", "errors"},
    "geometry": {"errors"},
    "study": {"names", "errors", "version"},
    "scan": {"geometry", "study", "names", "errors"},
    "rod": {"geometry", "compilation", "errors"},
    "effects": {"geometry", "rod", "study", "compilation", "errors"},
    "statics": {"geometry", "rod", "compilation", "programs", "errors"},
}
ALLOWED["fitting"] = set(ALLOWED)
ALLOWED["cache"] = {"programs", "study", "errors"}
ALLOWED["prediction"] = {*ALLOWED["fitting"], "fitting"}
ALLOWED["posterior"] = {*ALLOWED["prediction"], "prediction"}
ALLOWED["results"] = {*ALLOWED["posterior"], "posterior"}
ALLOWED["inference"] = {*ALLOWED["results"], "results"}
ALLOWED["sweep"] = {*ALLOWED["inference"], "inference"}
ALLOWED["plot"] = {*ALLOWED["inference"], "inference"}
ALLOWED["convert"] = {"study", "errors"}
ALLOWED["export"] = {*ALLOWED["prediction"], "prediction"}
ALLOWED["reporting"] = {*ALLOWED["plot"], "plot"}
ALLOWED["cli"] = {*ALLOWED["plot"], "plot", "cache", "convert", "export", "reporting"}
ALLOWED["__main__"] = {"cli"}
NO_JAX = ("study", "convert", "errors")


def files(part):
    """The modules of a sub-package, or of a module of that name."""
    return sorted((PACKAGE / part).rglob("*.py")) + [p for p in [PACKAGE / f"{part}.py"] if p.exists()]


def imported(path, root=ROOT):
    """Absolute dotted names that the module imports, wherever in the file."""
    base = list(path.relative_to(root).parts[:-1])
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            stem = base[: len(base) - node.level + 1] if node.level else []
            name = ".".join([*stem, *([node.module] if node.module else [])])
            yield from (f"{name}.{alias.name}" for alias in node.names)


def parts_of(path):
    """Sub-packages of this package that the module imports; the package's own face is above all of them."""
    names = [name.split(".") for name in imported(path)]
    return {name[1] if len(name) > 1 else "__init__" for name in names if name[0] == NAME}


def test_every_part_of_the_package_has_its_layer():
    parts = {p.relative_to(PACKAGE).with_suffix("").parts[0] for p in PACKAGE.rglob("*.py")} - {"__init__"}
    assert parts == set(ALLOWED)


def test_the_layers_themselves_have_an_order():
    """Each may import from lower ones only, so that no two can import each other."""
    TopologicalSorter(ALLOWED).prepare()


def test_imports_point_downward():
    wrong = {str(p.relative_to(PACKAGE)): parts_of(p) - ALLOWED[part] - {part} for part in ALLOWED for p in files(part)}
    assert {path: names for path, names in wrong.items() if names} == {}


@pytest.mark.parametrize("part", NO_JAX)
def test_reading_a_study_needs_no_jax(part):
    libraries = {name.split(".")[0] for path in files(part) for name in imported(path)}
    assert not libraries & {"jax", "jaxlib", "equinox", "optimistix", "lineax", "jaxtyping"}


def circle(root, package):
    """The names of modules of a package below a folder that import each other in a circle; empty if there are none."""
    paths = sorted((root / package).rglob("*.py"))
    modules = {".".join(p.relative_to(root).with_suffix("").parts).removesuffix(".__init__"): p for p in paths}

    def module_of(name):
        while name and name not in modules:
            name = name.rpartition(".")[0]
        return name

    graph = {module: {module_of(name) for name in imported(path, root)} - {""} for module, path in modules.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as fault:
        return fault.args[1]
    return []


def test_no_modules_import_each_other_in_a_circle():
    assert circle(ROOT, NAME) == []
