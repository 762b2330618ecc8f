"""Python of the README and of docs/python.md and docs/extending.md, run as it stands there, one page in one namespace."""

import shutil

import matplotlib as mpl
import numpy as np
import pytest

from scan2flex_jax.examples import example_path
from tests.documents import DOCS, ROOT, blocks

pytestmark = pytest.mark.slow


@pytest.fixture
def run(tmp_path, monkeypatch):
    """Runs a page's blocks in a folder with the study that they name."""
    mpl.use("Agg")
    monkeypatch.chdir(tmp_path)
    for name in ("my-cable", "scans"):
        shutil.copytree(example_path("simulated-cable"), tmp_path / name)

    def all_of(page, space):
        for block in blocks(page.read_text("utf-8"), "python"):
            exec(compile(block, page.name, "exec"), space)
        return space

    return all_of


def test_the_readme(run):
    assert run(ROOT / "README.md", {})["result"].believable


def test_the_pages_on_python_and_on_extending(run):
    space = run(DOCS / "python.md", {})
    assert space["explanation"].verdict == "no missing effect"
    assert np.isfinite(space["jax"].hessian(space["sag"])(0.1))
    space["boundary"] = space["Boundary"].of(([0, 0, 0], space["along_x"]), ([0.6, 0, 0], space["along_x"]))
    e = run(DOCS / "extending.md", space)["e"]
    assert bool(e.verdict.solved)
