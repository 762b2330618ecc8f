"""Terminal output: text of a study has its control characters escaped, and a closed or full stream is tolerated."""

import contextlib
import os
import sys

import typer
from rich.console import Console

ERRORS = Console(stderr=True, highlight=False)
_TEXT = {"err": False}  # where `say` prints: a result on standard output is alone there


def printable(text: str) -> str:
    """``text`` with control characters escaped."""
    from scan2flex_jax.names import printable as escaped  # noqa: PLC0415  (numpy comes with it, and --help needs none)

    return escaped(text)


def text_to_errors(on: bool) -> None:
    """Print texts to standard error from now on, since a result goes to standard output; or back to standard output."""
    _TEXT["err"] = on


def say(text: str = "", *, err: bool = False) -> None:
    """Print to standard output, or error (`text_to_errors`). If the reader has closed it (``| head``), the command continues
    silently, since it may still have files to write."""
    try:
        typer.echo(printable(text), err=err or _TEXT["err"])
    except BrokenPipeError:
        close_output()


def tell_line(text: str) -> None:
    """Print one line to standard error at once; a closed stream is ignored."""
    with contextlib.suppress(OSError, ValueError):  # ValueError: a stream that was closed
        print(printable(text), file=sys.stderr, flush=True)


def complain(sentence: str) -> None:
    """One sentence on standard error."""
    ERRORS.print(f"scan2flex: {printable(sentence)}", markup=False, soft_wrap=True)


def close_output() -> None:
    """Redirect standard output to the null device: Python would flush it again at exit, and report the error."""
    try:
        handle = sys.stdout.fileno()
    except (AttributeError, ValueError):  # no output at all, or one in memory
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, handle)
    os.close(nowhere)
