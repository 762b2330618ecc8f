"""Where the processor time of a first command goes, by phase, and how many programs it compiles.

    python -m benchmarks.phases                            # fit and demo, with an empty and a filled cache: into the record
    python -m benchmarks.phases OUT.json explain my-cable  # of any command

Phases of all threads of Python: importing, tracing (Python to jaxpr), lowering (jaxpr to StableHLO), compiling (or
loading from the cache), and the rest: solving, pictures, and what XLA compiles on threads of its own. Processor time hardly
depends on what else a machine does. A phase inside another one counts for the inner one only.
"""

import builtins
import itertools
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter, defaultdict
from pathlib import Path

from benchmarks.record import record
from scan2flex_jax.examples import example_path

PHASES = {
    "/jax/core/compile/jaxpr_trace_duration": "tracing",
    "/jax/core/compile/jaxpr_to_mlir_module_duration": "lowering",
    "/jax/core/compile/backend_compile_duration": "compiling",
}


class Stopwatch:
    """Processor seconds of nested phases (exclusive) of all threads of Python, and the names of the programs."""

    def __init__(self) -> None:
        """Nothing is measured yet."""
        self.seconds: dict[str, float] = defaultdict(float)
        self.programs: Counter[str] = Counter()
        self.hits = 0
        self._own, self._one = threading.local(), threading.Lock()

    def begin(self, phase: str) -> None:
        """Enter a phase in this thread."""
        now = time.thread_time()
        stack = self._own.__dict__.setdefault("stack", [])
        if stack:
            self._spend(stack, now)
        stack.append([phase, now])

    def end(self) -> None:
        """Leave the innermost phase of this thread."""
        now, stack = time.thread_time(), self._own.stack
        self._spend(stack, now)
        stack.pop()
        if stack:
            stack[-1][1] = now

    def _spend(self, stack: list, now: float) -> None:
        with self._one:
            self.seconds[stack[-1][0]] += now - stack[-1][1]

    @property
    def phase(self) -> str | None:
        """The innermost phase of this thread."""
        stack = self._own.__dict__.get("stack")
        return stack[-1][0] if stack else None


def listen(watch: Stopwatch) -> None:
    """Follow JAX's own events, and imports."""
    import jax.monitoring  # noqa: PLC0415 - imported inside the measurement

    def begun(event: str, value: float | int, **kwargs: object) -> None:
        if event in PHASES:
            watch.begin(PHASES[event])

    def ended(event: str, start: float, end: float, **kwargs: object) -> None:
        if event in PHASES:
            watch.end()
            if PHASES[event] == "compiling":
                watch.programs[str(kwargs.get("fun_name"))] += 1

    def happened(event: str, **kwargs: object) -> None:
        watch.hits += event == "/jax/compilation_cache/cache_hits"

    jax.monitoring.register_scalar_listener(begun)
    jax.monitoring.register_event_time_span_listener(ended)
    jax.monitoring.register_event_listener(happened)


def follow_imports(watch: Stopwatch) -> None:
    """Count imports, wherever they happen, as a phase."""
    original = builtins.__import__

    def timed(*args, **kwargs):
        if watch.phase == "importing":
            return original(*args, **kwargs)
        watch.begin("importing")
        try:
            return original(*args, **kwargs)
        finally:
            watch.end()

    builtins.__import__ = timed


def measure(out: Path, words: list[str]) -> None:
    """Run a command in this process and write its phases."""
    watch = Stopwatch()
    follow_imports(watch)
    from scan2flex_jax.cli.setup import prepare_jax  # noqa: PLC0415

    prepare_jax()
    listen(watch)
    from scan2flex_jax.cli.app import app  # noqa: PLC0415

    try:
        app(words, standalone_mode=False)
    finally:
        spent = time.process_time()
        phases = {**watch.seconds, "rest": spent - sum(watch.seconds.values()), "all": spent}
        programs = {"programs": watch.programs.total(), "from the cache": watch.hits}
        out.write_text(json.dumps(phases | programs | {"by name": dict(watch.programs.most_common())}, indent=1) + "\n")


def main() -> None:
    """The fit of the simulated cable and the demo, in a process of its own for each state of the cache."""
    results: dict[str, dict] = {}
    with tempfile.TemporaryDirectory() as folder:
        cable = str(example_path("simulated-cable"))
        commands = {"fit": ["fit", cable], "demo": ["demo", "--force", "--out", f"{folder}/demo"]}
        for name, state in itertools.product(commands, ("empty cache", "filled cache")):
            out = Path(folder) / "phases.json"
            words = [sys.executable, "-m", "benchmarks.phases", str(out), *commands[name]]
            environment = {**os.environ, "SCAN2FLEX_CACHE": str(Path(folder) / f"cache-{name}")}
            subprocess.run(words, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True)
            results.setdefault(name, {})[state] = json.loads(out.read_text())
    record("phases", results)


if __name__ == "__main__":
    if len(sys.argv) > 1:
        measure(Path(sys.argv[1]), sys.argv[2:])
    else:
        main()
