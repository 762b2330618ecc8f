"""What only some users need comes with an extra: imported where it is used, with a sentence that names the extra."""

import ast
import re
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from typer.testing import CliRunner

from scan2flex_jax.errors import Scan2FlexError

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def names(requirements) -> set[str]:
    return {re.split(r"[^\w.-]", r)[0].lower() for r in requirements}


CORE = names(PROJECT["dependencies"])
EXTRAS = {extra: names(requirements) for extra, requirements in PROJECT["optional-dependencies"].items()}


def imports(path: Path):
    """``(library, whether at the top of the module)`` of what a module imports from outside the standard library."""
    tree = ast.parse(path.read_text())
    top = {id(node) for node in tree.body}
    for node in ast.walk(tree):
        modules = []
        if isinstance(node, ast.Import):
            modules = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level:
            modules = [node.module]
        for module in modules:
            library = module.split(".")[0]
            if library not in sys.stdlib_module_names and library != "scan2flex_jax":
                yield library, id(node) in top


def test_modules_import_what_is_declared():
    distributions = packages_distributions()
    lent = set.union(*(EXTRAS[extra] for extra in ("report", "scans", "sweep")))
    for path in sorted((ROOT / "scan2flex_jax").rglob("*.py")):
        for library, at_top in imports(path):
            found = {d.lower() for d in distributions.get(library, [library])}
            assert found & (CORE if at_top else CORE | lent), f"{path.name} imports {library}"


@pytest.mark.parametrize("library", ["xarray", "zarr", "distributed"])
def test_a_sweep_without_a_library_names_the_extra(monkeypatch, tmp_path, library):
    from scan2flex_jax.sweep import Output, Task, grid, sweep

    samples = grid(x=[1.0])
    task = Task(lambda sample: {"y": sample["x"]}, {"y": Output()})
    monkeypatch.setitem(sys.modules, library, None)
    more = {"xarray": {}, "zarr": {"store": tmp_path / "s"}, "distributed": {"client": "tcp://127.0.0.1:8786"}}
    with pytest.raises(Scan2FlexError, match=rf"needs {library}: .*scan2flex_jax\[sweep\]"):
        sweep(task, samples, **more[library])


def test_a_sweep_in_this_process_needs_neither_zarr_nor_dask(monkeypatch):
    from scan2flex_jax.sweep import Output, Task, grid, sweep

    for library in ("zarr", "distributed", "dask"):
        monkeypatch.setitem(sys.modules, library, None)
    assert sweep(Task(lambda sample: {"y": sample["x"]}, {"y": Output()}), grid(x=[1.0]))["y"].values == [1.0]


def test_workers_of_a_command_without_dask_name_the_extra(monkeypatch):
    from scan2flex_jax.cli.app import app

    monkeypatch.setitem(sys.modules, "distributed", None)
    said = CliRunner().invoke(app, ["fit", "a", "b", "--workers", "2"]).exception
    assert isinstance(said, Scan2FlexError) and "scan2flex_jax[sweep]" in str(said)
