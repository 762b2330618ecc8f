"""Files of a study: read within limits, inside the folder only, and written so that nothing is ever half there.

Reading refuses what is no regular file, what is too large, and every path that leads out of the study's folder.
Writing goes to a new file in the same directory, is flushed to the disk, and takes the place of the old file in one
step; what the old file said is kept in a backup.
"""

import contextlib
import json
import os
import secrets
import shutil
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np

from scan2flex_jax.errors import Scan2FlexError, StudyError
from scan2flex_jax.study.values import Where, one_line, shown

TOML_LIMIT = 10_000_000
"""Bytes of a study.toml; a thousand poses take well below one million."""
CSV_LIMIT = 200_000_000
"""Bytes of a CSV; a curve of a million points takes about 50 million."""


def read_text(path: Path, limit: int, where: Where, missing: str) -> str:
    """The text of a UTF-8 file of at most `limit` bytes; `missing` says what to do when it is not there."""
    try:
        if path.is_dir():
            raise where.fail(f"{one_line(str(path))} is a folder: name a file.")
        if not path.exists():
            raise where.fail(missing)
        if not path.is_file():
            raise where.fail(f"{one_line(str(path))} is no regular file: name one.")
        with path.open("rb") as stream:
            data = stream.read(limit + 1)
    except (OSError, ValueError) as error:
        raise where.fail(f"{one_line(str(path))} cannot be read ({_reason(error)}): check it.") from error
    if len(data) > limit:
        raise where.fail(f"the file is larger than {limit // 1_000_000} MB: give a smaller one.")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
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
    try:
        if not path.is_file():
            found = "is no regular file" if path.exists() else "is not there"
            raise where.fail(f"the file {shown(name)} {found}: put it into the study's folder, or correct the name.")
        if path.stat().st_size == 0:
            raise where.fail(f"the file {shown(name)} is empty: export it again.")
    except (OSError, ValueError) as error:
        raise where.fail(f"the file {shown(name)} cannot be read ({_reason(error)}): check it.") from error
    return path


def backup(path: Path) -> Path | None:
    """Copy a file to NAME.bak, or to NAME.bak.1, .2, ... where that is taken; None where there is no file."""
    if not path.exists():
        return None
    number = 0
    while True:
        copy = path.with_name(f"{path.name}.bak" + (f".{number}" if number else ""))
        try:
            with copy.open("xb") as target, path.open("rb") as source:
                shutil.copyfileobj(source, target)
                target.flush()
                os.fsync(target.fileno())
        except FileExistsError:
            number += 1
            continue
        return copy


def write_atomic(path: Path, data: bytes | Path) -> None:
    """Make `path` hold `data`, or a copy of the file `data`, in one step: a reader sees the old or the new, whole."""
    path = path.resolve()
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name[:100]}.{secrets.token_hex(4)}.tmp")
    try:
        with temporary.open("xb") as target:
            if isinstance(data, Path):
                with data.open("rb") as source:
                    shutil.copyfileobj(source, target)
            else:
                target.write(data)
            target.flush()
            os.fsync(target.fileno())
        if path.exists():
            shutil.copymode(path, temporary)
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    _sync_folder(path.parent)


def _sync_folder(folder: Path) -> None:
    """Put the new name on the disk too, where the system lets a folder be opened."""
    with contextlib.suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def write_json_atomic(path: str | Path, obj: Any) -> None:
    """Write `obj` as JSON in one step; numpy numbers and arrays become lists, NaN and infinity are refused."""
    try:
        text = json.dumps(obj, indent=2, allow_nan=False, ensure_ascii=False, default=_plain)
    except (ValueError, TypeError, RecursionError) as error:
        what = _non_finite(obj) or one_line(str(error))
        raise StudyError(path, None, f"the result cannot be written as JSON ({what}): leave that entry out.") from error
    try:
        write_atomic(Path(path), (text + "\n").encode("utf-8"))
    except (OSError, ValueError) as error:
        raise StudyError(path, None, f"the file cannot be written ({_reason(error)}): choose another place.") from error


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"a {type(value).__name__} has no place in JSON")


def _non_finite(obj: Any, key: str = "") -> str | None:
    """Where the first NaN or infinity stands, as in estimates.length.std."""
    if isinstance(obj, dict):
        found = (_non_finite(entry, f"{key}.{name}" if key else str(name)) for name, entry in obj.items())
    elif isinstance(obj, list | tuple | np.ndarray) and np.ndim(obj) > 0:
        found = (_non_finite(entry, f"{key}[{i}]") for i, entry in enumerate(obj))
    else:
        bad = isinstance(obj, float | np.floating) and not np.isfinite(obj)
        return f"{key or 'it'} is {obj}" if bad else None
    return next((entry for entry in found if entry), None)


def writing_error(path: Path, error: Exception) -> Scan2FlexError:
    """One sentence for a file that the system would not take."""
    return StudyError(path, None, f"the file cannot be written ({_reason(error)}): check the folder and the disk.")
