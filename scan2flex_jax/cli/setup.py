"""What the command line sets before JAX is imported: double precision, and a cache of compiled functions (`cache`)."""

import contextlib
import os
from collections.abc import Callable, Iterator

from rich.text import Text

from scan2flex_jax.cli.cache import cache_folder, keep_compiled
from scan2flex_jax.cli.terminal import ERRORS, printable, tell_line

__all__ = ["ERRORS", "prepare_jax", "progress"]


def prepare_jax() -> None:
    """Switch on float64 and the compilation cache; a cache folder that cannot be made is done without."""
    os.environ.setdefault("JAX_ENABLE_X64", "1")
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # XLA names tuning hints of cached code it does not know as errors
    import jax  # noqa: PLC0415 - the environment must be set first

    jax.config.update("jax_enable_x64", True)
    folder = cache_folder()
    if folder is not None:
        keep_compiled(folder)


@contextlib.contextmanager
def progress(what: str, quiet: bool = False) -> Iterator[Callable[[str], None]]:
    """Progress on standard error while something runs; yields the function that tells it.

    On a terminal it is one line that changes, elsewhere (a log, a pipe) a line for each message, without control codes; with
    ``quiet``, nothing. Brackets in it (a title of a study) are no markup.
    """
    if quiet:
        yield lambda message: None
    elif ERRORS.is_terminal:
        with ERRORS.status(Text(printable(what))) as status:
            yield lambda message: status.update(Text(printable(f"{what}: {message}")))
    else:
        yield lambda message: tell_line(f"{what}: {message}")
