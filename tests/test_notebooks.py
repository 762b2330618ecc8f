"""Each notebook runs from top to bottom as it is stored, ends in assertions of what it claims, and is small."""

from pathlib import Path

import nbclient
import nbformat
import pytest

NOTEBOOKS = sorted((Path(__file__).parents[1] / "notebooks").glob("*.ipynb"))
HANGS = 600.0  # s for one cell


def test_there_are_notebooks():
    assert {path.stem for path in NOTEBOOKS} >= {"hanging-cable", "fitting-bending-stiffness"}


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
@pytest.mark.slow
def test_runs_and_holds_what_it_claims(path):
    notebook = nbformat.read(path, as_version=4)
    assert path.stat().st_size < 300_000
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert not any(output.output_type == "error" for output in outputs)
    assert "assert" in notebook.cells[-1].source
    nbclient.NotebookClient(notebook, timeout=HANGS, kernel_name="python3").execute()
