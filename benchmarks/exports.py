"""Do the simulators hang an exported cable as we do? The paper's simulated cable, pose `twist-90`, with its true stiffnesses.

    python -m benchmarks.exports [--python PATH]

``--python`` is an interpreter that has the simulators, of another environment if need be: `mujoco`, `pyelastica` and
`newton[importers]`. One that is not installed is left out of the record, with a sentence. Newton needs no GPU; its kernels
compile once. Record: the largest distance of the settled links from our nodes over the length, by target and links.
"""

import argparse
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import jax
import numpy as np

from benchmarks.record import conclude
from benchmarks.settling import MISSING
from scan2flex_jax import load_study
from scan2flex_jax.examples import example_path
from scan2flex_jax.export import TO, hung

jax.config.update("jax_enable_x64", True)
POSE, EI, GJ = "twist-90", 0.1, 0.25  # N m^2
LINKS = {"mujoco": (20, 40, 80), "pyelastica": (20,), "usd": (20,)}
FILES = {"mujoco": "cable.xml", "pyelastica": "cable.py", "usd": "cable.usda"}
SCRIPT = Path(__file__).with_name("settling.py")


def known():
    """The study with its true stiffnesses."""
    study = load_study(example_path("simulated-cable"))
    cable = {**study.cable, "bending_stiffness": EI, "torsional_stiffness": GJ}
    return replace(study, cable=cable, unknowns=())


def settled(python: str, target: str, file: Path) -> dict | None:
    """What `benchmarks.settling` found; nothing, and a sentence, where the simulator is not installed."""
    ran = subprocess.run([python, str(SCRIPT), target, str(file)], capture_output=True, text=True, check=False)
    if ran.returncode == MISSING:
        sys.stdout.write(f"{target}: left out, {ran.stderr.strip()}\n")
        return None
    if ran.returncode != 0:
        raise RuntimeError(f"{target} failed:\n{ran.stderr[-2000:]}")
    return json.loads(ran.stdout.splitlines()[-1])


def compared(python: str) -> dict:
    """By target: the simulator's version, and by links the distance over the length and the motion that is left."""
    results: dict[str, dict] = {}
    with TemporaryDirectory() as folder:
        for links in sorted({n for each in LINKS.values() for n in each}):
            ours = hung(known(), POSE, links)
            for target in (t for t in LINKS if links in LINKS[t]):
                file = Path(folder) / FILES[target]
                file.write_text(TO[target](ours))
                found = settled(python, target, file)
                if found is None:
                    continue
                away = np.linalg.norm(np.array(found["points"]) - ours.position, axis=1).max() / ours.length
                entry = results.setdefault(target, {"version": found["version"], "links": {}})
                entry["links"][str(links)] = {"distance over length": float(away), "fastest": found["speed"]}
                sys.stdout.write(f"{target}, {links} links: {away:.1e} of the length away\n")
    return results


def ratios(results: dict) -> dict[str, float]:
    """The distance with twice the links over that with once as many: a quarter, to second order."""
    of = {target: {n: r["distance over length"] for n, r in entry["links"].items()} for target, entry in results.items()}
    pairs = [(target, n) for target in of for n in of[target] if str(2 * int(n)) in of[target]]
    return {f"{target}: {2 * int(n)} links over {n}": of[target][str(2 * int(n))] / of[target][n] for target, n in pairs}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", default=sys.executable)
    results = compared(parser.parse_args().python)
    conclude("exports", results, ratios(results))


if __name__ == "__main__":
    main()
