"""One peer in a process of its own on one processor, which answers one question at a time, so that two can be asked in turn.

`Process` starts `python -m benchmarks.peers.bench` with this interpreter or another that has the library. The first line that
it reads names the peer, each other line a problem and a size (JSON). Each answer is a line of JSON: points for each `Found`,
seconds of the first solve (what is compiled or built included), least and median processor and wall seconds of the repeats
after it, and the largest memory of the process so far. What is compared are the least processor seconds of all threads of the
process: other jobs on the machine change them less than the wall clock, and what still does meets both of two asked in turn.
"""

import importlib
import importlib.metadata
import json
import os
import platform
import resource
import select
import subprocess
import sys
from pathlib import Path
from time import perf_counter, process_time

import numpy as np

from benchmarks.peers.problems import PROBLEMS
from benchmarks.peers.solvers import PEERS
from benchmarks.record import one_processor

ENOUGH, MOST = 1.0, 25  # processor seconds spent on repeats, and their number
LONGEST = 600.0  # wall seconds for one answer
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
_LIBRARIES = {"elastica": ("pyelastica", "numba"), "mujoco": ("mujoco",), "casadi": ("casadi",), "scipy": ("scipy",),
              "jax": ("jax", "jaxlib", "optimistix", "equinox")}  # fmt: skip


class Process:
    """A peer that is ready to answer; `about` says what it is, or why it is not there (``missing``, ``failed``)."""

    def __init__(self, peer: str, interpreter: str = sys.executable, longest: float = LONGEST):
        """Start it; answers come through a pipe of their own, since libraries print what they like."""
        self.longest = longest
        here, there = os.pipe()
        command = [interpreter, "-m", "benchmarks.peers.bench", str(there)]
        options = {"stdin": subprocess.PIPE, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "text": True}
        self.child = subprocess.Popen(command, env=os.environ | _ONE_THREAD, pass_fds=(there,), **options)
        os.close(there)
        self.answers = os.fdopen(here)
        self.about = self._told({"peer": peer})

    @property
    def ready(self) -> bool:
        """Whether it can be asked."""
        return "missing" not in self.about and self.child.poll() is None

    def ask(self, problem: str, size: float) -> dict:
        """The answer on one problem at one size; ``failed`` in a sentence if there is none."""
        if not self.ready:
            return {"failed": "the process has ended"}
        return {"problem": problem, "size": size} | self._told({"problem": problem, "size": size})

    def close(self) -> None:
        """End it."""
        self.child.stdin.close()
        self.child.wait(10.0)
        self.answers.close()

    def _told(self, question):
        try:
            self.child.stdin.write(json.dumps(question) + "\n")
            self.child.stdin.flush()
        except BrokenPipeError:
            return {"failed": f"the process ended with code {self.child.wait()}"}
        if not select.select([self.answers], [], [], self.longest)[0]:
            self.child.kill()
            self.child.wait()
            return {"failed": f"stopped after {self.longest:g} s of wall time"}
        line = self.answers.readline()
        return json.loads(line) if line else {"failed": f"the process ended with code {self.child.wait()}"}


def measured(module, peer, problem, size, kept) -> dict:
    """One problem at one size; ``kept`` holds what was prepared and solved before, so that asking again only repeats."""
    try:
        if (problem.name, size) not in kept:
            began = process_time()
            solve = module.prepare(problem, size, **peer.options)
            prepared, begin = process_time() - began, process_time()
            found = solve()
            kept[problem.name, size] = solve, found, {"prepare_s": prepared, "first_s": process_time() - begin}
        solve, found, told = kept[problem.name, size]
        times, runs = _repeated(solve, told["first_s"], found)
    except (FloatingPointError, RuntimeError, ValueError) as error:
        return {"failed": str(error)}
    return {
        **told,
        **times,
        "found": [
            {"s": f.s.tolist(), "points": f.points.tolist(), "told": f.told, "seconds": seconds or times["min_s"]}
            for f, seconds in zip(found, (_least_of(runs, i) for i in range(len(found))), strict=True)
        ],
        "memory_MB": _memory(),
    }


def _repeated(solve, first, found):
    """Processor and wall seconds of a solve, and what each repeat found; a long relaxation is taken as it is."""
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


def _least_of(runs, i):
    """Processor seconds until the i-th thing found, None for a solve that finds one at its end."""
    seconds = [run[i].seconds for run in runs if i < len(run)]
    return None if None in seconds or not seconds else min(seconds)


def _memory():
    """Largest resident set so far (MB); what `getrusage` tells begins with that of the process that started this one."""
    status = Path("/proc/self/status")
    if status.exists():
        line = next(x for x in status.read_text().splitlines() if x.startswith("VmHWM"))
        return round(float(line.split()[1]) / 1024, 1)
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1)


def _versions(peer):
    return {"python": platform.python_version()} | {x: importlib.metadata.version(x) for x in _LIBRARIES[peer.needs]}


def answers(questions):
    """First a line about the peer that the first question names, then one for each problem and size."""
    peer = PEERS[next(questions)["peer"]]
    if peer.missing():
        yield {"missing": peer.missing()}
        return
    began = process_time()
    module = importlib.import_module(f"benchmarks.peers.solvers.{peer.module}")
    sentence = module.missing() if hasattr(module, "missing") else None
    if sentence:
        yield {"missing": sentence}
        return
    yield {"import_s": process_time() - began, "memory_after_import_MB": _memory(), "versions": _versions(peer)}
    kept = {}
    for question in questions:
        yield measured(module, peer, PROBLEMS[question["problem"]], question["size"], kept)


def main() -> None:
    one_processor()
    with os.fdopen(int(sys.argv[1]), "w") as pipe:
        for answer in answers(json.loads(line) for line in sys.stdin):
            pipe.write(json.dumps(answer) + "\n")
            pipe.flush()


if __name__ == "__main__":
    main()
