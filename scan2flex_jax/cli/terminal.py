"""What a user sees: text of a study that cannot move the cursor, and an output that may be closed or full."""

import contextlib
import os
import sys

import typer
from rich.console import Console

ERRORS = Console(stderr=True, highlight=False)


def printable(text: str) -> str:
    """``text`` as a terminal may have it."""
    from scan2flex_jax.study.names import printable as escaped  # noqa: PLC0415  (numpy comes with it, and --help needs none)

    return escaped(text)


def say(text: str = "", *, err: bool = False) -> None:
    """Print to standard output (or error). Where nobody reads on (``| head``), the command goes on in silence: it may still
    have files to write."""
    try:
        typer.echo(printable(text), err=err)
    except BrokenPipeError:
        close_output()


def tell_line(text: str) -> None:
    """One line on standard error that is there at once; where nobody reads it, nothing is lost."""
    with contextlib.suppress(OSError, ValueError):  # ValueError: a stream that was closed
        print(printable(text), file=sys.stderr, flush=True)


def complain(sentence: str) -> None:
    """One sentence on standard error."""
    ERRORS.print(f"scan2flex: {printable(sentence)}", markup=False, soft_wrap=True)


def close_output() -> None:
    """Send what is left of standard output nowhere: Python would try again at its end, and say so."""
    try:
        handle = sys.stdout.fileno()
    except (AttributeError, ValueError):  # no output at all, or one in memory
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, handle)
    os.close(nowhere)
