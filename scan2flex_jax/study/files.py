"""Files of a study: bounded reading inside the folder only, and atomic writing.

Reading refuses special files, files above the size limit, and every path that leads out of the study's folder. Writing goes to
a new file in the same directory, is flushed to the disk, and replaces the old file in one step; devices, pipes and the
program's own streams are written to directly. `outputs` decides which files may be written.
"""

import contextlib
import errno
import itertools
import os
import secrets
import shutil
import stat
import sys
import time
from collections.abc import Iterator
from pathlib import Path, PureWindowsPath

from scan2flex_jax.errors import Scan2FlexError, StudyError
from scan2flex_jax.study.limits import Limit
from scan2flex_jax.study.values import Where, one_line, shown

STUDY_FILE = "study.toml"
TOML_LIMIT = 10_000_000  # bytes of a study.toml; a thousand poses take well below one million
CSV_LIMIT = 200_000_000  # bytes of a CSV; a curve of a million points takes about 50 million
STANDARD_OUTPUT = Path("-")  # the path that stands for standard output
PATIENCE = 10.0  # seconds to wait for the reader of a pipe
UTF_16 = (b"\xff\xfe", b"\xfe\xff")  # marks at the beginning of a text in UTF-16
_BREAKS = (b"\n", b"\r", b"\v", b"\f", b"\x1c", b"\x1d", b"\x1e", "\x85".encode(), "\u2028".encode(), "\u2029".encode())


def read_text(path: Path, limit: int, where: Where, missing: str, rows: Limit | None = None, foreign: bool = False) -> str:
    """The text of a UTF-8 file of at most `limit` bytes; `missing` is the advice for a missing file.

    For a table, `rows` limits the number of lines. A `foreign` file may be in UTF-16 or Latin-1."""
    advice = "give a smaller one." if rows is None else rows.advice
    try:
        if not path.exists():
            raise where.fail(missing)
        if not path.is_file():
            raise where.fail(f"{one_line(str(path))} is {'a folder' if path.is_dir() else 'no regular file'}: name a file.")
        if path.stat().st_size > limit:
            raise where.fail(f"the file is larger than {limit // 1_000_000} MB: {advice}")
        data = path.read_bytes()
    except (OSError, ValueError) as error:
        raise where.fail(f"{one_line(str(path))} cannot be read ({_reason(error)}): check it.") from error
    if rows is not None and sum(map(data.count, _BREAKS)) - data.count(b"\r\n") > rows.points + 1:  # one more for the header
        raise where.fail(rows.sentence(f"more than {rows.points} lines"))
    try:
        return data.decode("utf-16" if foreign and data[:2] in UTF_16 else "utf-8-sig")
    except UnicodeDecodeError as error:
        if foreign and data.count(0) == 0:
            return data.decode("latin-1")
        raise where.fail(f"byte {error.start} is no UTF-8 text: save the file as plain text in UTF-8.") from error


def _reason(error: Exception) -> str:
    return one_line(getattr(error, "strerror", None) or str(error))


def inside(folder: Path, name: str, where: Where) -> Path:
    """The resolved path of the file `name` of a study; it must lie in `folder`, links followed."""
    advice = "name a file inside the folder of the study, with / between folders."
    windows = PureWindowsPath(name)
    if not name.strip() or "\\" in name or windows.is_absolute() or windows.drive or Path(name).is_absolute():
        raise where.fail(f"got {shown(name)}: {advice}")
    try:
        root = folder.resolve()
        path = (root / name).resolve()
    except (OSError, ValueError, RuntimeError) as error:  # a null byte, a loop of links, a name too long
        raise where.fail(f"got {shown(name)} ({_reason(error)}): {advice}") from error
    if path == root or not path.is_relative_to(root):
        raise where.fail(f"got {shown(name)}, which leads out of the study's folder: {advice}")
    return path


def existing(folder: Path, name: str, where: Where) -> Path:
    """The resolved path of a regular, non-empty file inside `folder`."""
    path = inside(folder, name, where)
    if path.relative_to(folder.resolve()).as_posix().lower() == STUDY_FILE:
        raise where.fail(f"got {shown(name)}, which is the study itself: name the file of what was measured.")
    try:
        if not path.is_file():
            said = "is no regular file" if path.exists() else "is not there"
            raise where.fail(f"the file {shown(name)} {said}: put it into the study's folder, or correct the name.")
        if path.stat().st_size == 0:
            raise where.fail(f"the file {shown(name)} is empty: export it again.")
    except (OSError, ValueError) as error:
        raise where.fail(f"the file {shown(name)} cannot be read ({_reason(error)}): check it.") from error
    return path


def backup(path: Path) -> Path | None:
    """Copy a file to NAME.bak, or to NAME.bak.1, .2, ... if that exists; None without a file."""
    if not path.exists():
        return None
    for number in itertools.count():
        copy = path.with_name(f"{path.name}.bak" + (f".{number}" if number else ""))
        with contextlib.suppress(FileExistsError):
            _write_new(copy, path)
            return copy
    return None


def _write_new(path: Path, data: bytes | Path) -> None:
    """Write a new file, down to the disk; an incomplete one would pass for a complete one and is removed."""
    target = path.open("xb")
    try:
        with target:
            if isinstance(data, Path):
                with data.open("rb") as source:
                    shutil.copyfileobj(source, target)
            else:
                target.write(data)
            target.flush()
            os.fsync(target.fileno())
    except BaseException:
        path.unlink(missing_ok=True)
        raise


def write_atomic(path: Path, data: bytes | Path) -> None:
    """Make `path` contain `data`, or a copy of the file `data`, in one step: a reader sees the old content or the new one.

    Special files (a device, a pipe) are written to directly; raises `OSError`, `ValueError` or `RuntimeError`."""
    if is_stream(path):
        _write_through(path, data.read_bytes() if isinstance(data, Path) else data)
        return
    path = path.resolve()
    if path.exists() and not os.access(path, os.W_OK):
        raise PermissionError(errno.EACCES, "it is write-protected", str(path))
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name.encode()[:100].decode(errors='ignore')}.{secrets.token_hex(4)}.tmp")
    _write_new(temporary, data)
    try:
        if path.exists():
            shutil.copymode(path, temporary)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    with contextlib.suppress(OSError):  # flush the new name to the disk too, on systems that can open a folder
        handle = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def is_stream(path: Path) -> bool:
    """Whether a path leads to a device, a pipe, or a stream of this process, which must not be replaced by a new file."""
    if path == STANDARD_OUTPUT:
        return True
    try:
        status = path.stat()
    except FileNotFoundError:
        return False
    return not (stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)) or _own_stream(status) is not None


def _own_stream(status: os.stat_result) -> int | None:
    """The descriptor of standard output or error, if this is it: /dev/stdout may refer to a regular file."""
    for handle in (1, 2):
        with contextlib.suppress(OSError):
            if os.path.samestat(status, os.fstat(handle)):
                return handle
    return None


def _write_through(path: Path, data: bytes) -> None:
    """Write to a device, a pipe (its reader is waited for a while) or a stream of this process (its reader may leave)."""
    own = 1 if path == STANDARD_OUTPUT else _own_stream(path.stat())
    if own is not None:
        sys.stdout.flush()
        with contextlib.suppress(BrokenPipeError), open(os.dup(own), "wb") as stream:
            stream.write(data)
        return
    handle, until = None, time.monotonic() + PATIENCE
    while handle is None:
        try:
            handle = os.open(path, os.O_WRONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0))
        except OSError as error:
            if error.errno != errno.ENXIO or time.monotonic() > until:
                raise
            time.sleep(0.05)
    os.set_blocking(handle, True)
    with open(handle, "wb") as stream:
        stream.write(data)


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """Raise what the system refuses inside (also a null byte, or a loop of links) as one sentence about the file."""
    try:
        yield
    except (OSError, ValueError, RuntimeError) as error:
        raise writing_error(path, error) from error


def writing_error(path: Path, error: Exception) -> Scan2FlexError:
    """One sentence for a file that the system could not write."""
    path = Path(one_line(str(path), 300))
    if getattr(error, "errno", None) == errno.ENXIO:
        return StudyError(path, None, f"nobody read this pipe for {PATIENCE:g} s: start its reader first.")
    return StudyError(path, None, f"the file cannot be written ({_reason(error)}): check the folder and the disk.")
