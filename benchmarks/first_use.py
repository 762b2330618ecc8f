"""Seconds that a user waits for whole commands at their first and at their second run, compilation included.

`python -m benchmarks.first_use` runs each command in a process of its own, once with an empty cache of compiled functions and
once with the cache of that run; the record is `first_use`.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

from benchmarks.record import record
from scan2flex_jax.cli.options import NOT_TO_BELIEVE
from scan2flex_jax.examples import example_path

PROGRAM = (sys.executable, "-c", "from scan2flex_jax.cli import main; main()")
COMMANDS = {
    "demo": ("demo", "--out", "demo"),
    "fit of the simulated cable": ("fit", str(example_path("simulated-cable"))),
    "explain the black wire": ("explain", str(example_path("black-wire"))),
}


def seconds(words: tuple[str, ...], folder: Path) -> float:
    """Seconds of a command that runs in ``folder``, which has its cache too."""
    began = perf_counter()
    environment = {**os.environ, "SCAN2FLEX_CACHE": str(folder / "cache")}
    ended = subprocess.run([*PROGRAM, *words], cwd=folder, env=environment, capture_output=True, check=False)
    if ended.returncode not in (0, NOT_TO_BELIEVE):
        raise SystemExit(f"{' '.join(words)} ended with {ended.returncode}")
    return perf_counter() - began


def main() -> None:
    results = {}
    for name, words in COMMANDS.items():
        with tempfile.TemporaryDirectory() as folder:
            results[name] = {way: seconds(words, Path(folder)) for way in ("empty cache", "filled cache")}
        print(name, results[name], flush=True)
    record("first_use", results)


if __name__ == "__main__":
    main()
