"""How long `import scan2flex_jax` takes, beside jax and equinox alone, each in processes of its own.

`python -m benchmarks.imports` writes `benchmarks/results/imports.json`. The package's own import loads no JAX (reading a study
needs none), so beside it stand those of the public functions that compute.
"""

import subprocess
import sys
from time import perf_counter

import numpy as np

from benchmarks.record import record

REPEATS = 9
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
}


def main() -> None:
    seconds: dict[str, list[float]] = {name: [] for name in WHAT}
    for _ in range(REPEATS + 1):  # in turns, so that a slow spell of the machine meets all; the first round warms the disk
        for name, code in WHAT.items():
            begin = perf_counter()
            subprocess.run([sys.executable, "-c", code], check=True)
            seconds[name].append(perf_counter() - begin)
    found = {n: {"min_s": min(s[1:]), "median_s": float(np.median(s[1:])), "repeats": REPEATS} for n, s in seconds.items()}
    bare = found["jax and equinox"]["min_s"]
    for row in found.values():
        row["over jax and equinox"] = row["min_s"] / bare
    for name, row in found.items():
        print(f"{name:<22}{row['min_s']:7.3f} s (median {row['median_s']:.3f})  {row['over jax and equinox']:.2f} of those")
    record("imports", {"target": TARGET, "imports": found})


if __name__ == "__main__":
    main()
