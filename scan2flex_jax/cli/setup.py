"""Set-up of a command: double precision and the compilation cache, before JAX is imported, and progress messages."""

import contextlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path

from rich.text import Text

from scan2flex_jax.cache import keep_compiled
from scan2flex_jax.cli.terminal import ERRORS, complain, printable, tell_line


def prepare_jax() -> Path | None:
    """Enable float64, and the compilation cache, whose folder is returned where one can be used."""
    os.environ.setdefault("JAX_ENABLE_X64", "1")
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # XLA logs unknown tuning hints of cached code as errors
    import jax  # noqa: PLC0415 - the environment must be set first

    jax.config.update("jax_enable_x64", True)
    return keep_compiled(tell=complain)


@contextlib.contextmanager
def progress(what: str, quiet: bool = False) -> Iterator[Callable[[str], None]]:
    """Report progress on standard error; yields the function that takes a message.

    On a terminal it is one line that changes, elsewhere (a log, a pipe) a line for each message, without control codes; with
    ``quiet``, nothing. Brackets in messages (in a study's title) are not markup.
    """
    if quiet:
        yield lambda message: None
    elif ERRORS.is_terminal:
        with ERRORS.status(Text(printable(what))) as status:
            yield lambda message: status.update(Text(printable(f"{what}: {message}")))
    else:
        yield lambda message: tell_line(f"{what}: {message}")
