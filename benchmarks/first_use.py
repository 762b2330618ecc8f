"""Seconds that a user waits for whole commands at their first and at their second run, and what compilation takes of them.

`python -m benchmarks.first_use` runs each command in a process of its own, once with an empty cache of compiled functions and
once with the cache of that run; the record is `first_use`. Of each compiled function of the first run it keeps how often it was
compiled, and the seconds of tracing, lowering and XLA that JAX reports.
"""

import json
import os
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path
from time import perf_counter

from benchmarks.record import record
from scan2flex_jax.cli.options import NOT_TO_BELIEVE
from scan2flex_jax.examples import example_path

COMMANDS = {
    "demo": ("demo", "--out", "demo", "--force"),
    "fit of the simulated cable": ("fit", str(example_path("simulated-cable"))),
    "explain the black wire": ("explain", str(example_path("black-wire"))),
    "fit of the black wire after that": ("fit", str(example_path("black-wire"))),
}
AFTER = {"fit of the black wire after that": "explain the black wire"}  # whose cache a command finds at its first run
LISTED = "compiled.json"


def listened() -> None:
    """The command that the arguments of this process give, which leaves what was compiled in the working folder."""
    from scan2flex_jax.cli import main as command  # noqa: PLC0415 - sets up the cache before JAX is imported
    from scan2flex_jax.cli.setup import prepare_jax  # noqa: PLC0415

    prepare_jax()
    import jax.monitoring  # noqa: PLC0415

    found: dict = defaultdict(lambda: {"compilations": 0, "seconds": 0.0})

    def listen(event, seconds, fun_name="", **_):
        if "/compile/" in event and fun_name:
            own = found[fun_name.removeprefix("jit(").removesuffix(")")]
            own["seconds"] += seconds
            own["compilations"] += "backend_compile" in event

    jax.monitoring.register_event_duration_secs_listener(listen)
    try:
        command()
    finally:
        Path(LISTED).write_text(json.dumps(found))


def run(words: tuple[str, ...], folder: Path) -> dict:
    """A command that runs in ``folder``, which has its cache too."""
    root = str(Path(__file__).parents[1])
    environment = {**os.environ, "SCAN2FLEX_CACHE": str(folder / "cache"), "PYTHONPATH": root}
    began, used = perf_counter(), os.times()
    program = [sys.executable, "-m", "benchmarks.first_use", *words]
    ended = subprocess.run(program, cwd=folder, env=environment, capture_output=True, check=False)
    if ended.returncode not in (0, NOT_TO_BELIEVE):
        raise SystemExit(f"{' '.join(words)} ended with {ended.returncode}")
    seconds, now = perf_counter() - began, os.times()
    processor = now.children_user + now.children_system - used.children_user - used.children_system
    return {"seconds": seconds, "processor": processor, "compiled": json.loads((folder / LISTED).read_text())}


def main() -> None:
    results = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, words in COMMANDS.items():
            own = Path(folder, AFTER.get(name, name).replace(" ", "-"))
            own.mkdir(exist_ok=True)
            results[name] = {way: run(words, own) for way in ("empty cache", "filled cache")}
            results[name]["filled cache"].pop("compiled")
            print(name, {way: round(r["processor"]) for way, r in results[name].items()}, flush=True)
    record("first_use", results)


if __name__ == "__main__":
    listened() if sys.argv[1:] else main()
