"""What the parts share: sweeps that are kept and gone on with, figures that are recorded as they come, pictures."""

import json
import sys
from datetime import UTC, datetime
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

from benchmarks.record import RESULTS, record
from scan2flex_jax import plot
from scan2flex_jax.sweep import sweep
from scan2flex_jax.sweep.definition import versions
from scan2flex_jax.sweep.task import NOT_RUN

NAME = "sensitivity"
ROOT = Path(__file__).parents[2]
STORES, PICTURES = ROOT / "build" / NAME, ROOT / "docs" / NAME


class Bench:
    """The results of all parts (those of the last run where a part has not run again), and the time that a sweep may take."""

    def __init__(self, longest: float):
        """``longest``: seconds after which a sweep begins no further chunk in this run."""
        path = RESULTS / f"{NAME}.json"
        self.results = json.loads(path.read_text())["results"] if path.exists() else {}
        self.longest = longest

    def sweep(self, name: str, task, lanes, **options):
        """The lanes that there was time for; a change of the package begins anew, in another folder."""
        store = STORES / versions()["scan2flex_jax"] / name.replace(" ", "-").replace(",", "")
        store.parent.mkdir(parents=True, exist_ok=True)

        def tell(line):
            sys.stderr.write(f"\r{name}: {line}   ")

        return sweep(task, lanes, store=store, longest=self.longest, progress=tell, **options)

    def keep(self, part: str, name: str, figures: dict) -> None:
        """Record the figures of one sweep, with the day and the sources that made them."""
        made = {"made": datetime.now(UTC).isoformat(timespec="minutes"), "by": versions()["scan2flex_jax"]}
        self.results.setdefault(part, {})[name] = figures | made
        sys.stderr.write(f"\n{part}, {name}: {json.dumps(figures)}\n")
        record(NAME, self.results)


def run(found) -> np.ndarray:
    """Places of the lanes that were run, as a mask."""
    return found["code"].values != NOT_RUN


def save(figure, name: str) -> None:
    """Write a picture of the docs and forget it."""
    plot.save(figure, PICTURES / f"{name}.png", dpi=80)
    plt.close(figure)
