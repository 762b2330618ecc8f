"""One peer on all problems and sizes, in a fresh process on one processor: `python -m benchmarks.peers.bench < request`.

The request (JSON) names the peer and the file for the answers, one JSON line each: points for each `Found`, seconds of the
first solve (what is compiled or built included), median and least processor and wall seconds of the repeats after it, and the
largest memory of the process so far. Processor seconds of all threads of the process are what is compared: other jobs on the
machine change them less than the wall clock. `run` starts such a process with this interpreter or another that has the library.
"""

import importlib
import importlib.metadata
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from time import perf_counter, process_time

import numpy as np

from benchmarks.peers.problems import PROBLEMS
from benchmarks.peers.solvers import PEERS

ENOUGH, MOST = 1.0, 25  # processor seconds spent on repeats, and their number
LONGEST = 1800  # wall seconds for a process; what it had done by then counts
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
_LIBRARIES = {"elastica": ("pyelastica", "numba"), "mujoco": ("mujoco",), "casadi": ("casadi",), "scipy": ("scipy",),
              "jax": ("jax", "jaxlib", "optimistix", "equinox")}  # fmt: skip


def run(peer, problems, sizes, interpreter=sys.executable, longest=LONGEST) -> list[dict]:
    """The answers of one process; the last one may say ``missing`` or ``failed`` in a sentence."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "answers.jsonl"
        file.touch()
        request = {"peer": peer, "problems": list(problems), "sizes": list(sizes), "answers": str(file)}
        command, said = [interpreter, "-m", "benchmarks.peers.bench"], None
        options = {"input": json.dumps(request), "env": os.environ | _ONE_THREAD, "capture_output": True, "text": True}
        try:
            done = subprocess.run(command, timeout=longest, check=False, **options)
            if done.returncode:
                said = f"the process ended with code {done.returncode}: {' '.join(done.stderr.strip().splitlines()[-1:])}"
        except subprocess.TimeoutExpired:
            said = f"stopped after {longest} s of wall time"
        answers = [json.loads(line) for line in file.read_text().splitlines()]
        return answers + ([{"failed": said}] if said else [])


def measured(module, peer, problem, size) -> dict:
    """One problem at one size."""
    began = process_time()
    try:
        solve = module.prepare(problem, size, **peer.options)
        prepared, begin = process_time() - began, process_time()
        found = solve()
    except (FloatingPointError, RuntimeError, ValueError) as error:
        return {"failed": str(error)}
    first = process_time() - begin
    times, runs = _repeated(solve, first, found)
    return {
        "prepare_s": prepared,
        "first_s": first,
        **times,
        "found": [
            {"s": f.s.tolist(), "points": f.points.tolist(), "told": f.told, "seconds": seconds or times["median_s"]}
            for f, seconds in zip(found, (_median_of(runs, i) for i in range(len(found))), strict=True)
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


def _median_of(runs, i):
    """Processor seconds until the i-th thing found, None for a solve that finds one at its end."""
    seconds = [run[i].seconds for run in runs if i < len(run)]
    return None if None in seconds or not seconds else float(np.median(seconds))


def _memory():
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1)


def _versions(peer):
    return {"python": platform.python_version()} | {x: importlib.metadata.version(x) for x in _LIBRARIES[peer.needs]}


def answers(request):
    """First a line about the peer, then one for each problem and size."""
    peer = PEERS[request["peer"]]
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
    for size in request["sizes"]:
        for name in request["problems"]:
            yield {"problem": name, "size": size} | measured(module, peer, PROBLEMS[name], size)


def main() -> None:
    request = json.loads(sys.stdin.read())
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    with Path(request["answers"]).open("a") as file:
        for answer in answers(request):
            file.write(json.dumps(answer) + "\n")
            file.flush()


if __name__ == "__main__":
    main()
