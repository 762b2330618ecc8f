"""From a fresh clone to the first stiffness: commands and seconds, for the three starting points of the tutorial.

    python -m benchmarks.newcomer

A clone, an empty environment, no compiled functions; then the very text of docs/first-cable.md and docs/python.md.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

from benchmarks.record import record
from tests.documents import DOCS, ROOT, blocks, commands, printed_files, section

CURVES, MARKERS, ARRAYS = "curves", "markers", "arrays"


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        clone, env = Path(folder) / "clone", Path(folder) / "env"
        took = {"clone": timed(folder, "git", "clone", "-q", "--depth", "1", f"file://{ROOT}", str(clone))}
        took["install"] = timed(folder, sys.executable, "-m", "venv", str(env))
        took["install"] += timed(folder, str(env / "bin" / "pip"), "install", "-q", str(clone))
        starts = {CURVES: of_page("2. Make the study", "3. Fit"), MARKERS: of_page("Markers"), ARRAYS: of_arrays()}
        write_files(clone)
        for name, (count, text) in starts.items():
            surroundings = {"PATH": f"{env / 'bin'}:{os.environ['PATH']}", "SCAN2FLEX_CACHE": f"{folder}/cache-{name}"}
            words = ["python", "-c", text] if name == ARRAYS else ["bash", "-e", "-c", text]
            took[name] = {"commands": count, "seconds": timed(clone, *words, surroundings=surroundings)}
            sys.stdout.write(f"{name}: {took[name]}\n")
    record("newcomer", took)


def of_page(*titles) -> tuple[int, str]:
    """The number of `scan2flex` commands below these headings of the tutorial, and their shell blocks."""
    text = "\n".join(section((DOCS / "first-cable.md").read_text("utf-8"), title) for title in titles)
    return len(commands(text)), "\n".join(blocks(text, "sh"))


def of_arrays() -> tuple[int, str]:
    """One script: the block of docs/python.md that makes a study from arrays."""
    [block] = [b for b in blocks((DOCS / "python.md").read_text("utf-8"), "python") if "from_arrays" in b]
    return 1, block


def write_files(clone: Path) -> None:
    """The files that the tutorial prints in full."""
    for name, text in printed_files((DOCS / "first-cable.md").read_text("utf-8")):
        (clone / name).parent.mkdir(exist_ok=True)
        (clone / name).write_text(text, "utf-8")


def timed(cwd, *words, surroundings=None) -> float:
    """Seconds that a command takes; what it says goes on only where it fails."""
    begin = perf_counter()
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | (surroundings or {})
    ran = subprocess.run(words, cwd=cwd, env=env, capture_output=True, text=True, check=False)
    if ran.returncode:
        sys.exit(f"{' '.join(words)[:200]}: {ran.stderr[-1000:]}")
    return perf_counter() - begin


if __name__ == "__main__":
    main()
