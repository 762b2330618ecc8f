"""What the command line sets before JAX is imported: double precision, and a persistent cache of compiled functions.

The cache lies in ``$SCAN2FLEX_CACHE``, by default ``scan2flex`` under the user's cache folder; ``SCAN2FLEX_CACHE=off`` does
without. It holds nothing but compiled functions and may be deleted at any time.
"""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console
from rich.text import Text

ERRORS = Console(stderr=True, highlight=False)


def prepare_jax() -> None:
    """Switch on float64 and the compilation cache; a cache folder that cannot be made is done without."""
    os.environ.setdefault("JAX_ENABLE_X64", "1")
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # XLA names tuning hints of cached code it does not know as errors
    import jax  # noqa: PLC0415 - the environment must be set first

    jax.config.update("jax_enable_x64", True)
    folder = os.environ.get("SCAN2FLEX_CACHE") or _user_cache()
    if folder == "off":
        return
    with contextlib.suppress(OSError):
        Path(folder).mkdir(parents=True, exist_ok=True)
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.1)
        jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)


def _user_cache() -> str:
    return str(Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "scan2flex")


@contextlib.contextmanager
def progress(what: str) -> Iterator:
    """A status line on standard error while something runs; yields the function that changes its text. Brackets in it (a title
    of a study) are no markup."""
    with ERRORS.status(Text(what)) as status:
        yield lambda message: status.update(Text(f"{what}: {message}"))
