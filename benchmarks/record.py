"""Benchmarks are data: `record` writes the figures of one with the versions and the machine that made them."""

import importlib.metadata
import json
import os
import platform
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter

import numpy as np

RESULTS = Path(__file__).parent / "results"
LIBRARIES = ("jax", "jaxlib", "equinox", "optimistix", "numpy")


def record(name: str, results: dict) -> Path:
    """Write ``results`` to ``benchmarks/results/<name>.json``, in one piece."""
    entry = {
        "benchmark": name,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": machine(),
        "versions": {"python": platform.python_version()} | {x: importlib.metadata.version(x) for x in LIBRARIES},
        "results": results,
    }
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f"{name}.json"
    part = path.with_suffix(".part")
    part.write_text(json.dumps(entry, indent=1) + "\n")
    part.replace(path)
    return path


def machine() -> dict:
    """Model and number of the processors, and how busy they are at the moment."""
    return {"cpu": _cpu_model(), "cores": os.cpu_count(), "load_average": round(os.getloadavg()[0], 2)}


def _cpu_model():
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    return next((x.split(":", 1)[1].strip() for x in lines if x.startswith("model name")), platform.processor())


def timed(call, repeats: int) -> dict:
    """Seconds of ``call()``, which must wait for its result: least and median of ``repeats``, after one to warm up."""
    return timed_in_turn({"it": call}, repeats)["it"]


def timed_in_turn(calls: dict, repeats: int) -> dict:
    """The same of several calls, one after the other in each repeat, so that a slow spell of the machine meets all of them."""
    seconds = {name: [] for name in calls}
    for call in calls.values():
        call()
    for _ in range(repeats):
        for name, call in calls.items():
            begin = perf_counter()
            call()
            seconds[name].append(perf_counter() - begin)
    return {n: {"min_s": min(s), "median_s": float(np.median(s)), "repeats": repeats} for n, s in seconds.items()}
