"""The program in processes of its own, with an environment of its own."""

import os
import subprocess
import sys
from pathlib import Path

from benchmarks.attacks.attempt import Said

ROOT = Path(__file__).parents[2]
PROGRAM = (sys.executable, "-c", "from scan2flex_jax.cli import main; main()")
PATIENCE = 300.0  # s
_OWN = ("SCAN2FLEX_CACHE", "XDG_CACHE_HOME", "JAX_COMPILATION_CACHE_DIR", "PYTHONPATH")


def environment(**changes: object) -> dict[str, str]:
    """This environment with changes (None: without it); the package is the one of this checkout."""
    kept = {k: v for k, v in os.environ.items() if k not in (*_OWN, *changes)}
    return {"PYTHONPATH": str(ROOT), "PYTHONDONTWRITEBYTECODE": "1", **kept} | {
        k: str(v) for k, v in changes.items() if v is not None
    }


def start(*words: object, before: tuple[str, ...] = (), env: dict[str, str] | None = None, **options) -> subprocess.Popen:
    """The program with these words; ``before`` stands in front of it."""
    pipes = {"stdin": subprocess.DEVNULL, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "cwd": "/", **options}
    return subprocess.Popen([*before, *PROGRAM, *map(str, words)], env=env or environment(), **pipes)


def said(process: subprocess.Popen, allowed: tuple[str, ...] = ()) -> Said:
    """What it said, judged; lines on standard error that begin with ``allowed`` are no fault."""
    out, err = process.communicate(timeout=PATIENCE)
    lines = (err or b"").decode(errors="backslashreplace").splitlines(keepends=True)
    kept = "".join(line for line in lines if not line.startswith(allowed)) if allowed else "".join(lines)
    return Said(process.returncode, (out or b"").decode(errors="backslashreplace"), kept).judged()
