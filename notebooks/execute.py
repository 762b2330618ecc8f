"""Run notebooks and store their outputs, without the time of day: ``python -m notebooks.execute [NAME ...]``.

Compiled functions are kept in the folder that ``JAX_COMPILATION_CACHE_DIR`` names; how long each notebook took is printed.
"""

import sys
import time
from pathlib import Path

import nbclient
import nbformat

FOLDER = Path(__file__).parent
HANGS = 600.0  # s for one cell
KERNEL = {
    "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
    "language_info": {"name": "python"},
}


def execute(notebook: nbformat.NotebookNode) -> None:
    """Run every cell in a new kernel, in place; raises `nbclient.exceptions.CellExecutionError` at the first that fails."""
    nbclient.NotebookClient(notebook, timeout=HANGS, kernel_name="python3", record_timing=False).execute()


def store(path: Path) -> None:
    """Run a notebook file and write it with its outputs; a notebook that fails is left as it was."""
    notebook = nbformat.read(path, as_version=4)
    execute(notebook)
    notebook.metadata = nbformat.from_dict(KERNEL)  # not of the Python that ran it
    for cell in notebook.cells:
        if cell.cell_type == "code":  # warnings of a library on one machine are not the notebook's
            cell.outputs = [output for output in cell.outputs if output.get("name") != "stderr"]
    nbformat.write(notebook, path)


def main(names: list[str]) -> None:
    """Store the notebooks of these names, or all."""
    for path in sorted(FOLDER.glob("*.ipynb")):
        if not names or path.stem in names:
            began = time.perf_counter()
            store(path)
            print(f"{path.stem}: {time.perf_counter() - began:.0f} s")


if __name__ == "__main__":
    main(sys.argv[1:])
