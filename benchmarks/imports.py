"""Time of `import scan2flex_jax`, compared with jax and equinox alone, each in its own processes.

`python -m benchmarks.imports` writes `benchmarks/results/imports.json`. Seconds are processor seconds (user and system), which
other programs on the machine disturb least; the imports alternate, so that a slow period affects all of them. The package's own
import loads no JAX (reading a study needs none), so the imports of the computing functions are timed too.
"""

import argparse
import os
import subprocess
import sys

import numpy as np

from benchmarks.record import conclude

TARGET = 1.5
WHAT = {
    "python alone": "pass",
    "jax and equinox": "import jax, jax.numpy, equinox",
    "scan2flex_jax": "import scan2flex_jax",
    "reading a study": "from scan2flex_jax import load_study",
    "equilibrium": "from scan2flex_jax import Boundary, Cable, CableModel, equilibrium",
    "fit": "from scan2flex_jax import fit, load_study",
    "explain": "from scan2flex_jax import explain, plan",
    "extraction": "from scan2flex_jax.scan import extract",
    "every public name": "import scan2flex_jax as s\nfor n in s.__all__: getattr(s, n)",
    "scan2flex --help": "import sys; sys.argv[1:] = ['--help']; from scan2flex_jax.cli import main; main()",
}


def processor_seconds(code: str) -> float:
    """Processor seconds of the code in a new Python process."""
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise RuntimeError(f"{code!r} ended with exit code {process.returncode}")
    return usage.ru_utime + usage.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=9)
    repeats = parser.parse_args().repeats
    seconds: dict[str, list[float]] = {name: [] for name in WHAT}
    for _ in range(repeats + 1):  # the first round warms the disk
        for name, code in WHAT.items():
            seconds[name].append(processor_seconds(code))
    found = {n: {"min_s": min(s[1:]), "median_s": float(np.median(s[1:])), "repeats": repeats} for n, s in seconds.items()}
    bare = found["jax and equinox"]["min_s"]
    for name, row in found.items():
        row["over jax and equinox"] = row["min_s"] / bare
        print(f"{name:<22}{row['min_s']:7.3f} s (median {row['median_s']:.3f})  {row['over jax and equinox']:.2f} of those")
    ratios = {f"{name} over jax and equinox": found[name]["over jax and equinox"] for name in list(WHAT)[2:]}
    conclude("imports", {"seconds of": "the processor", "target": TARGET, "imports": found}, ratios)


if __name__ == "__main__":
    main()
