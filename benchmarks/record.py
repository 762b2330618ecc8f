"""Records of benchmarks: `record` writes the figures with the versions and the machine that made them.

Seconds differ from machine to machine and from hour to hour; ratios of two measurements in one run do not, so ratios are
compared. A benchmark defines its own, such that *smaller is better* (ours over theirs, warm over generic), and `conclude`
compares them with the committed record.
"""

import importlib.metadata
import json
import os
import platform
import subprocess
import sys
from datetime import UTC, datetime
from pathlib import Path
from time import perf_counter

import numpy as np

RESULTS = Path(__file__).parent / "results"
LIBRARIES = ("jax", "jaxlib", "equinox", "optimistix", "numpy")
REGRESSION = 0.3  # by how much a ratio may grow: what repeats of one run on a shared machine differ by, and half again


def record(name: str, results: dict, ratios: dict[str, float] | None = None) -> Path:
    """Write ``results`` to ``benchmarks/results/<name>.json``, in one piece; ``ratios`` (smaller is better) beside them."""
    entry = {
        "benchmark": name,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": machine(),
        "versions": {"python": platform.python_version()} | {x: importlib.metadata.version(x) for x in LIBRARIES},
        **({"ratios": ratios} if ratios is not None else {}),
        "results": results,
    }
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f"{name}.json"
    part = path.with_suffix(".part")
    part.write_text(json.dumps(entry, indent=1) + "\n")
    part.replace(path)
    return path


def one_processor() -> None:
    """Keep this process on one processor, where the system can: with more, small solves take more processor time."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def conclude(name: str, results: dict, ratios: dict[str, float]) -> None:
    """`record` at the end of a run; prints ratios that are worse than the committed ones, and exits with code 1 if any is."""
    before = committed(name).get("ratios", {})
    record(name, results, ratios)
    sentences = worse(before, ratios)
    for sentence in sentences:
        sys.stderr.write(f"REGRESSION: {name}: {sentence}\n")
    if sentences:
        raise SystemExit(1)


def worse(before: dict[str, float], now: dict[str, float], by: float = REGRESSION) -> list[str]:
    """A sentence for each ratio that grew by more than ``by``, or that a run no longer has; new ones have nothing to beat."""
    told = []
    for name, old in before.items():
        new = now.get(name)
        if new is None:
            told.append(f"{name} was {old:.3g} and is not measured any more")
        elif not new <= (1.0 + by) * old:  # so that NaN is worse too
            told.append(f"{name} was {old:.3g} and is {new:.3g}")
    return told


def committed(name: str) -> dict:
    """The record as last committed; without git, the file; empty if there is none."""
    path = RESULTS / f"{name}.json"
    command = ["git", "-C", str(path.parent), "show", f"HEAD:./{path.name}"]
    try:
        return json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    except (OSError, subprocess.CalledProcessError):
        return json.loads(path.read_text()) if path.exists() else {}


def machine() -> dict:
    """Model and number of the processors, and how busy they are at the moment."""
    return {"cpu": _cpu_model(), "cores": os.cpu_count(), "load_average": round(os.getloadavg()[0], 2)}


def _cpu_model():
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    return next((x.split(":", 1)[1].strip() for x in lines if x.startswith("model name")), platform.processor())


def timed(call, repeats: int, clock=perf_counter) -> dict:
    """Seconds of ``call()``, which must wait for its result: least and median of ``repeats``, after one to warm up."""
    return timed_in_turn({"it": call}, repeats, clock)["it"]


def timed_in_turn(calls: dict, repeats: int, clock=perf_counter) -> dict:
    """Likewise for several calls, one after the other in each repeat, so that a slow period of the machine affects all of them.

    Calls that take long are timed by ``process_time``: no slice of a shared machine is long enough for them.
    """
    seconds = {name: [] for name in calls}
    for call in calls.values():
        call()
    for _ in range(repeats):
        for name, call in calls.items():
            begin = clock()
            call()
            seconds[name].append(clock() - begin)
    return {n: {"min_s": min(s), "median_s": float(np.median(s)), "repeats": repeats} for n, s in seconds.items()}
