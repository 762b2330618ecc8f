"""Waiting time of a user at the first and the second run of whole commands, compilation included.

    python -m benchmarks.first_use [STUDY ...]

Each command runs in its own process, once with an empty cache of compiled functions and once with the cache of that run.
Further studies given (blind cases of eight poses) are explained likewise, and recorded by their folder's name.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter

from benchmarks.record import conclude
from scan2flex_jax.cli.options import NOT_TO_BELIEVE
from scan2flex_jax.examples import example_path

PROGRAM = (sys.executable, "-c", "from scan2flex_jax.cli import main; main()")


def commands(studies: list[Path], out: Path) -> dict[str, tuple[str, ...]]:
    """Words of the program by the name of the measurement."""
    found = {
        "demo": ("demo", "--out", str(out / "demo")),
        "fit of the simulated cable": ("fit", str(example_path("simulated-cable"))),
        "explain the black wire": ("explain", str(example_path("black-wire"))),
    }
    return found | {f"explain {study.name}": ("explain", str(study)) for study in studies}


def seconds(words: tuple[str, ...], cache: Path) -> float:
    """Seconds of a command with a cache folder."""
    began = perf_counter()
    environment = {**os.environ, "SCAN2FLEX_CACHE": str(cache)}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    ended = subprocess.run([*PROGRAM, *words], env=environment, **quiet, check=False)
    if ended.returncode not in (0, NOT_TO_BELIEVE):
        raise SystemExit(f"{' '.join(words)} ended with {ended.returncode}")
    return perf_counter() - began


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("studies", type=Path, nargs="*", metavar="STUDY")
    args = parser.parse_args()
    results = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, words in commands(args.studies, Path(folder)).items():
            cache = Path(folder) / name.replace(" ", "-")
            first = seconds(words, cache)
            results[name] = {"empty cache": first, "filled cache": seconds(words, cache)}
            sys.stderr.write(f"{name}: {first:.1f} s, then {results[name]['filled cache']:.1f} s\n")
    ratios = {f"{n}, filled over empty cache": r["filled cache"] / r["empty cache"] for n, r in results.items()}
    conclude("first_use", results, ratios)


if __name__ == "__main__":
    main()
