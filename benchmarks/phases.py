"""Processor time of one command by phase, and the programs that it compiled.

    python -m benchmarks.phases OUT.json fit my-cable --quiet

Importing, tracing (Python to jaxpr), lowering (jaxpr to StableHLO), the backend in Python's own threads (reading the cache), the
whole main thread, and the process; what the process has beyond the main thread is XLA, which compiles on its own threads.
Processor time hardly depends on what else a machine does. A phase inside another one counts for the inner one only.
"""

import builtins
import json
import sys
import threading
import time
from collections import Counter, defaultdict
from pathlib import Path

PHASES = {
    "/jax/core/compile/jaxpr_trace_duration": "tracing",
    "/jax/core/compile/jaxpr_to_mlir_module_duration": "lowering",
    "/jax/core/compile/backend_compile_duration": "backend",
}


class Stopwatch:
    """Processor seconds of nested phases, per thread (exclusive), and the names of what was traced and compiled."""

    def __init__(self) -> None:
        """Nothing is measured yet."""
        self.seconds: dict[str, float] = defaultdict(float)
        self.programs: Counter[str] = Counter()
        self.hits = 0
        self._own = threading.local()

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
            if PHASES[event] == "backend":
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


def main(out: Path, words: list[str]) -> None:
    watch, began = Stopwatch(), time.perf_counter()
    follow_imports(watch)
    from scan2flex_jax.cli.setup import prepare_jax  # noqa: PLC0415

    prepare_jax()
    listen(watch)
    from scan2flex_jax.cli.app import app  # noqa: PLC0415

    threads = time.thread_time()
    try:
        app(words, standalone_mode=False)
    finally:
        said = {
            "wall": time.perf_counter() - began,
            "processor": time.process_time(),
            "main thread": time.thread_time() - threads,
            **watch.seconds,
            "programs": watch.programs.total(),
            "from the cache": watch.hits,
            "by name": dict(watch.programs.most_common(60)),
        }
        out.write_text(json.dumps(said, indent=1) + "\n")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
