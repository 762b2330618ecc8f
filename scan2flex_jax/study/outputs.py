"""Rules for writing results: a file that is there is replaced by `--force` alone, and a measured one never.

Measured files are those of the study that a command reads (`study.toml` and the files that it names), and those that a
`study.toml` in a folder above the result names. Functions for notebooks (`write_file`, `write_json_atomic`) keep the latter.
"""

import contextlib
import json
import os
import re
import unicodedata
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from scan2flex_jax.errors import StudyError
from scan2flex_jax.study.files import STUDY_FILE, TOML_LIMIT, is_stream, write_atomic, writing, writing_error
from scan2flex_jax.study.model import Study
from scan2flex_jax.study.values import one_line
from scan2flex_jax.version import __version__

_TEXT = re.compile(r'"([^"\n]+)"|\'([^\'\n]+)\'')


class Outputs:
    """The files that one command writes."""

    def __init__(self, study: Study | None = None, *, source: Path | None = None, force: bool = False):
        """`study` was read from `source`; `force` replaces files that are there (measured ones never)."""
        self.force = force
        self.measured = [*(() if study is None else measured_files(study)), *(() if source is None else (source,))]

    def claim(self, *paths: Path | None) -> None:
        """Refuse, before any computation, files that must not be written; None is an output that was not requested."""
        claimed = set[object]()
        for path in filter(None, paths):
            with writing(path):
                if is_stream(path):
                    continue
                if claimed & (own := _known_by(path)):
                    raise StudyError(one_line(str(path), 300), None, "two results would be one file: give each its own.")
                claimed |= own
                keep_measured(path, self.measured)
                if not self.force and path.exists() and path.stat().st_size > 0:
                    said = "it is there already: name another file, or replace it with --force."
                    raise StudyError(one_line(str(path), 300), None, said)

    def write(self, path: Path, data: bytes) -> None:
        """Make `path` contain `data`, in one step; raises `StudyError`."""
        self.claim(path)
        with writing(path):
            write_atomic(path, data)

    def write_json(self, path: Path, obj: dict[str, Any], by_name: bool = False) -> None:
        """Write an object as JSON, with the version of the program, which objects `by_name` have each."""
        version = {"scan2flex_jax": __version__}
        self.write(path, json_bytes(path, {n: version | one for n, one in obj.items()} if by_name else version | obj))


def write_file(path: Path, data: bytes, measured: Iterable[Path] = ()) -> None:
    """Make `path` contain `data`, in one step, unless it is a study's own file; raises `StudyError` or `OSError`."""
    try:
        keep_measured(path, measured)
        write_atomic(path, data)
    except (ValueError, RuntimeError) as error:  # a null byte, a loop of links
        raise writing_error(path, error) from error


def write_json_atomic(path: str | Path, obj: Any) -> None:
    """Write `obj` as JSON in one step; numpy numbers and arrays become lists, NaN and infinity are refused.

    Raises `StudyError`, also for a study's own file."""
    with writing(Path(path)):
        write_file(Path(path), json_bytes(path, obj))


def measured_files(study: Study) -> list[Path]:
    """The files of a study."""
    own = [] if study.folder is None else [study.folder / STUDY_FILE]
    return own + [path for pose in study.poses for path in pose.files.values() if path is not None]


def keep_measured(path: Path, measured: Iterable[Path] = ()) -> None:
    """Refuse a file of `measured`, and one that a study.toml in a folder above it names."""
    own = _known_by(path)
    if any(own & _known_by(other) for other in measured):
        raise _refused(path, "it is what this command reads")
    with writing(path):
        folders = path.resolve().parents
    for folder in folders:
        with contextlib.suppress(OSError), (folder / STUDY_FILE).open("rb") as stream:
            texts = _TEXT.findall(stream.read(TOML_LIMIT).decode("utf-8", errors="replace"))
            named = {os.path.join(folder, "".join(text)) for text in [(STUDY_FILE,), *texts]}
            if any(own & _known_by(Path(name)) for name in named if os.path.isfile(name)):
                raise _refused(path, f"it belongs to the study in {one_line(str(folder), 200)}")


def _refused(path: Path, why: str) -> StudyError:
    said = f"{why}, and no result replaces what was measured"
    return StudyError(one_line(str(path), 300), None, f"{said}: name another file.")


def _known_by(path: Path) -> set[object]:
    """What tells a file from others: its place on the disk (links of both kinds), and its path where case does not count."""
    try:
        resolved = path.resolve()
    except (OSError, ValueError, RuntimeError):
        resolved = path.absolute()
    found: set[object] = {unicodedata.normalize("NFC", str(resolved)).casefold()}
    with contextlib.suppress(OSError, ValueError):
        found.add((path.stat().st_dev, path.stat().st_ino))
    return found


def json_bytes(path: str | Path, obj: Any) -> bytes:
    """`obj` as the text of a JSON file; errors name `path`."""
    try:
        return (json.dumps(obj, indent=2, allow_nan=False, ensure_ascii=False, default=_plain) + "\n").encode("utf-8")
    except (ValueError, TypeError, RecursionError) as error:
        what = _non_finite(obj) or one_line(str(error))
        raise StudyError(path, None, f"the result cannot be written as JSON ({what}): leave that entry out.") from error


def _plain(value: Any) -> Any:
    if not isinstance(value, np.ndarray | np.generic | Path):
        raise TypeError(f"a {type(value).__name__} has no place in JSON")
    return str(value) if isinstance(value, Path) else value.tolist()


def _non_finite(obj: Any, key: str = "") -> str | None:
    """Key of the first NaN or infinity, as in estimates.length.std."""
    below: Iterable[str | None] = ()
    if isinstance(obj, dict):
        below = (_non_finite(entry, f"{key}.{name}" if key else str(name)) for name, entry in obj.items())
    elif isinstance(obj, list | tuple) or np.ndim(obj) > 0:
        below = (_non_finite(entry, f"{key}[{i}]") for i, entry in enumerate(obj))
    elif isinstance(obj, float | np.floating) and not np.isfinite(obj):
        return f"{key or 'it'} is {obj}"
    return next(filter(None, below), None)
