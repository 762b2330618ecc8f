"""Records of benchmarks: results with the versions and the machine that made them, written whole, and times."""

import importlib.metadata
import json
import os
import platform
from collections.abc import Callable, Hashable, Iterable
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter

import numpy as np

RESULTS = Path(__file__).parent / "results"
LIBRARIES = ("jax", "jaxlib", "equinox", "optimistix", "numpy")


def record(name: str, results: dict) -> None:
    """Write ``results`` to ``benchmarks/results/<name>.json``, in one piece."""
    entry = {
        "benchmark": name,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": {"cpu": _cpu_model(), "cores": os.cpu_count(), "load_average": round(os.getloadavg()[0], 2)},
        "versions": {"python": platform.python_version()} | {x: importlib.metadata.version(x) for x in LIBRARIES},
        "results": results,
    }
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f"{name}.json"
    part = path.with_suffix(".part")
    part.write_text(json.dumps(entry, indent=1) + "\n")
    part.replace(path)


def load(name: str) -> dict:
    """The record of one benchmark."""
    return json.loads((RESULTS / f"{name}.json").read_text())


def recorded(name: str) -> dict:
    """The results of a record; empty where there is none."""
    return load(name)["results"] if (RESULTS / f"{name}.json").exists() else {}


def complete(rows: dict, cases: Iterable[Hashable], one: Callable, keep: Callable[[], None]) -> None:
    """Compute the rows of the cases that ``rows`` lacks, print each and ``keep()`` it: an interrupted run continues."""
    for case in cases:
        if case not in rows:
            rows[case] = one(case)
            print(f"{case}: {str(rows[case])[:500]}", flush=True)
            keep()


def _cpu_model():
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    return next((x.split(":", 1)[1].strip() for x in lines if x.startswith("model name")), platform.processor())


def one_processor() -> None:
    """Keep this process on one processor, where the system can: with more, small solves take more processor time."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def timed(calls: dict[str, Callable], repeats: int, clock=perf_counter) -> dict[str, dict]:
    """Least and median seconds of several calls, which wait for their results, after one call of each to warm up.

    They take turns, so that a slow period of the machine affects all. Long calls are timed by ``process_time``: no slice of a
    shared machine is long enough for them.
    """
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        call()
    for _ in range(repeats):
        for name, call in calls.items():
            begin = clock()
            call()
            seconds[name].append(clock() - begin)
    return {n: {"min_s": min(s), "median_s": float(np.median(s)), "repeats": repeats} for n, s in seconds.items()}
