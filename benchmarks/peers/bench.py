"""A peer that answers one question at a time, so that two can be asked in turn, on one processor and one thread.

An answer holds the `Found` of a problem at one size, the seconds of the first solve (compiling and building included), and the
least and median processor and wall seconds of the repeats after it. The least processor seconds are compared: other jobs on the
machine change them less than the wall clock, and affect both of two that are asked in turn.
"""

import importlib
import importlib.metadata
import os
from time import perf_counter, process_time

os.environ |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")

import numpy as np

from benchmarks.peers.problems import PROBLEMS
from benchmarks.peers.solvers import PEERS

ENOUGH, MOST = 1.0, 25  # processor seconds spent on repeats, and their number


class Asked:
    """One peer; ``about`` says what it is, or why it cannot be run (``missing``)."""

    def __init__(self, name: str):
        """Import its module, if its library is there."""
        self.peer, self.kept = PEERS[name], {}
        self.about = {"what": self.peer.what}
        if missing := self.peer.missing():
            self.about["missing"] = missing
        else:
            self.module = importlib.import_module(f"benchmarks.peers.solvers.{self.peer.module}")
            self.about["version"] = importlib.metadata.version(self.peer.library)

    def __call__(self, problem: str, size: float) -> dict:
        """The answer on one problem at one size; ``failed`` in a sentence if there is none. Asked again, it only repeats."""
        shared = {"problem": problem, "size": size}
        try:
            if (problem, size) not in self.kept:
                begin = process_time()
                solve = self.module.prepare(PROBLEMS[problem], size, **self.peer.options)
                prepared = process_time()
                found = solve()
                times = {"prepare_s": prepared - begin, "first_s": process_time() - prepared}
                self.kept[problem, size] = solve, found, times
            solve, found, first = self.kept[problem, size]
            times, runs = _repeated(solve, first["first_s"], found)
        except (FloatingPointError, RuntimeError, ValueError) as error:
            return shared | {"failed": str(error)}
        least = [min((r[i].seconds for r in runs if i < len(r) and r[i].seconds), default=None) for i in range(len(found))]
        seen = [f._replace(seconds=s or times["min_s"])._asdict() for f, s in zip(found, least, strict=True)]
        return shared | first | times | {"found": seen}


def _repeated(solve, first, found):
    """Processor and wall seconds of a solve, and the results of the repeats; a long relaxation is not repeated."""
    if first > ENOUGH and found[0].seconds is not None:
        return {"median_s": first, "min_s": first, "repeats": 0}, [found]
    busy, wall, runs = [], [], []
    while len(busy) < MOST and (sum(busy) < ENOUGH or len(busy) < 3):
        begins = process_time(), perf_counter()
        runs.append(solve())
        busy.append(process_time() - begins[0])
        wall.append(perf_counter() - begins[1])
    medians = {"median_s": float(np.median(busy)), "min_s": min(busy), "wall_median_s": float(np.median(wall))}
    return medians | {"repeats": len(busy)}, runs
