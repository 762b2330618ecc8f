"""The cache of compiled functions, which no later process compiles again: its folder, and entries with a checksum.

The folder is ``$SCAN2FLEX_CACHE``, by default ``scan2flex`` under the user's cache folder; ``SCAN2FLEX_CACHE=off`` disables
the cache. It holds only compiled functions and may be deleted at any time. They are machine code, so a folder that belongs to
another user (except the administrator) is not used: the cache then lies in the folder for temporary files.

JAX recompiles a function whose entry is damaged, warns, and keeps the damaged entry. Here every entry begins with the SHA-256
of its key and content, is written in one step, and is deleted if the checksum does not match.
"""

import contextlib
import hashlib
import os
import stat
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

from scan2flex_jax.errors import Scan2FlexError

_DIGEST = hashlib.sha256().digest_size


class Entries:
    """Entries by key, with the interface of `jax._src.compilation_cache_interface.CacheInterface`."""

    def __init__(self, folder: Path):
        """`folder` need not exist."""
        self._path = folder

    def get(self, key: str) -> bytes | None:
        """The value stored under a key; None if it is missing or damaged."""
        file = self._file(key)
        with contextlib.suppress(OSError):
            if not file.is_file():  # reading a pipe would block
                return None
            data = file.read_bytes()
            if _digest(key, data[_DIGEST:]) == data[:_DIGEST]:
                return data[_DIGEST:]
            file.unlink()
        return None

    def put(self, key: str, value: bytes) -> None:
        """Store a value in one step; a folder that is read-only or full is ignored."""
        from scan2flex_jax.study.files import write_atomic  # noqa: PLC0415

        with contextlib.suppress(OSError):
            write_atomic(self._file(key), _digest(key, value) + value)

    def _file(self, key: str) -> Path:
        return self._path / f"{key}-checked"


def _digest(key: str, value: bytes) -> bytes:
    return hashlib.sha256(key.encode() + b"\0" + value).digest()


def cache_folder(tell: Callable[[str], object] = warnings.warn) -> Path | None:
    """The folder of the cache, created if missing; None without a cache. ``tell`` is called with a sentence on a fallback."""
    given = os.environ.get("SCAN2FLEX_CACHE")
    if given == "off":
        return None
    try:
        folder = Path(given) if given else Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "scan2flex"
        return _own(folder)
    except (OSError, ValueError, RuntimeError) as error:  # RuntimeError: no home
        why = f"{getattr(error, 'filename', None) or ''}: {getattr(error, 'strerror', None) or error}".removeprefix(": ")
    try:
        folder = _own(Path(tempfile.gettempdir()) / f"scan2flex-cache-{_user()}")
    except (OSError, ValueError):
        tell(f"compiled functions are not kept ({why}): name a folder in SCAN2FLEX_CACHE.")
        return None
    tell(f"compiled functions are kept in {folder} ({why}): name another folder in SCAN2FLEX_CACHE.")
    return folder


def _user() -> int:
    return os.geteuid() if hasattr(os, "geteuid") else 0


def _own(folder: Path) -> Path:
    """The folder, created if missing; raises `OSError` unless it is readable and belongs to this user or the administrator."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    found = folder.stat()
    writable_by_all = stat.S_IMODE(found.st_mode) & stat.S_IWOTH
    if hasattr(os, "geteuid") and (found.st_uid not in (0, _user()) or writable_by_all):
        whose = "everybody may write there" if writable_by_all else "it belongs to another user"
        raise PermissionError(1, whose, str(folder))
    if not os.access(folder, os.R_OK | os.X_OK):
        raise PermissionError(13, "it cannot be read", str(folder))
    return folder


def _entries(path: str) -> tuple[Entries, str]:
    return Entries(Path(path)), path


def keep_compiled(folder: str | Path | None = None, *, tell: Callable[[str], object] = warnings.warn) -> Path | None:
    """Keep compiled functions between processes, as the command line does: a later process loads them in place of compiling.

    For notebooks and scripts; call it before JAX is imported, or XLA logs errors on its tuning hints. JAX keeps there what it
    compiles, through `Entries` where its version has a hook for another storage. A function of the package that is replaced at
    run time is not noticed.

    Args:
        folder: Where they are kept; None: the folder of the command line, ``$SCAN2FLEX_CACHE`` or ``scan2flex`` under the
            user's cache folder.
        tell: Called with one sentence where the folder of the command line cannot be used.

    Returns:
        The folder in use; None if ``SCAN2FLEX_CACHE`` is ``off`` or no folder can be used.

    Raises:
        Scan2FlexError: The given ``folder`` cannot be used.

    Examples:
        >>> keep_compiled()  # doctest: +SKIP
    """
    try:
        used = cache_folder(tell) if folder is None else _own(Path(folder))
    except (OSError, ValueError) as error:
        said = getattr(error, "strerror", None) or error
        raise Scan2FlexError(f"{folder}: compiled functions cannot be kept there ({said}): name another folder.") from error
    if used is not None:
        _store_in(used)
    return used


def _store_in(folder: Path) -> None:
    """Make JAX, and `programs`, store compiled functions in a folder."""
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")  # XLA logs unknown tuning hints of cached code as errors
    import jax  # noqa: PLC0415

    from scan2flex_jax import programs  # noqa: PLC0415

    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)  # reading a small one is still ten times faster
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", 0)
    with contextlib.suppress(ImportError):
        from jax._src import compilation_cache as own  # noqa: PLC0415  (no public way to exchange the storage)

        if hasattr(own, "get_file_cache"):
            own.get_file_cache = _entries  # type: ignore[assignment]  # same interface
    programs.keep(Entries(folder))
