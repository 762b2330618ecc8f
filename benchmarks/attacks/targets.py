"""Places that a result must not, cannot or may be written to, made before each try."""

import contextlib
import os
import resource
import socket
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

from benchmarks.attacks.attempt import REFUSED, WORKED, NotRunError, WrongError

OLD = b"old results of somebody"


@dataclass(frozen=True)
class Target:
    """``make(out, study, ending)`` prepares the place and returns its path; ``around`` is entered for the command.

    ``must``: the only right outcome, without and with --force (None: either).
    """

    make: Callable[[Path, Path, str], object]
    must: tuple[str | None, str | None] = (REFUSED, REFUSED)
    around: Callable[[Path], contextlib.AbstractContextManager] = lambda path: contextlib.nullcontext()


def _own(name: str) -> Callable[[Path, Path, str], Path]:
    """A file of the study; "pose-0" stands for its curve or its scan."""
    return lambda out, study, ending: measured(study, name)


def measured(study: Path, name: str = "pose-0") -> Path:
    """A file of the study by its stem, or by its whole name."""
    return next(study.glob(f"{name}.*"), study / name)


def _linked(out: Path, study: Path, ending: str) -> Path:
    (out / f"link{ending}").symlink_to(measured(study))
    return out / f"link{ending}"


def _hard(out: Path, study: Path, ending: str) -> Path:
    os.link(measured(study, "pose-1"), out / f"hard{ending}")
    return out / f"hard{ending}"


def _through_a_folder(out: Path, study: Path, ending: str) -> Path:
    (out / "folder").symlink_to(study)
    return out / "folder" / measured(study).name


def _foreign(out: Path, study: Path, ending: str) -> Path:
    (out / f"mine{ending}").write_bytes(OLD)
    return out / f"mine{ending}"


def _foreign_link(out: Path, study: Path, ending: str) -> Path:
    (out / f"to-mine{ending}").symlink_to(_foreign(out, study, ending))
    return out / f"to-mine{ending}"


def _empty(out: Path, study: Path, ending: str) -> Path:
    (out / f"empty{ending}").touch()
    return out / f"empty{ending}"


def _folder(out: Path, study: Path, ending: str) -> Path:
    (out / f"folder{ending}").mkdir()
    return out / f"folder{ending}"


def _loop(out: Path, study: Path, ending: str) -> Path:
    (out / f"a{ending}").symlink_to(out / f"b{ending}")
    (out / f"b{ending}").symlink_to(out / f"a{ending}")
    return out / f"a{ending}"


def _dangling(out: Path, study: Path, ending: str) -> Path:
    (out / f"to{ending}").symlink_to(out / "not" / f"there{ending}")
    return out / f"to{ending}"


def _pipe(out: Path, study: Path, ending: str) -> Path:
    os.mkfifo(out / f"pipe{ending}")
    return out / f"pipe{ending}"


def _socket(out: Path, study: Path, ending: str) -> Path:
    path = Path(os.path.relpath(out / f"s{ending}"))  # the system takes short names only
    with socket.socket(socket.AF_UNIX) as one, contextlib.chdir(out):
        one.bind(path.name)
    return out / path.name


def _device(name: str) -> Callable[[Path, Path, str], Path]:
    def make(out, study, ending):
        if not Path(name).exists():
            raise NotRunError(f"there is no {name}")
        if not ending or ending == ".json":
            return Path(name)
        (out / f"device{ending}").symlink_to(name)  # a picture's name says its kind
        return out / f"device{ending}"

    return make


def _plain(out: Path, study: Path, ending: str) -> Path:
    return out / f"deep/new{ending}"


@contextlib.contextmanager
def _read(path: Path) -> Iterator[None]:
    """Somebody reads the pipe; something comes out of it, and it stays one."""
    came: list[bytes] = []
    reader = threading.Thread(target=lambda: came.append(path.read_bytes()), daemon=True)
    reader.start()
    yield
    reader.join(30)
    if not came or not came[0] or not path.is_fifo():
        raise WrongError(f"nothing came out of a pipe: {path.name}")


@contextlib.contextmanager
def _unread(path: Path) -> Iterator[None]:
    with mock.patch("scan2flex_jax.study.files.PATIENCE", 0.05):
        yield


def full(size: int) -> Callable[[Path], contextlib.AbstractContextManager]:
    """A disk that takes ``size`` bytes of each file: a limit of the process stands for it."""

    @contextlib.contextmanager
    def around(path):
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))

    return around


def failing(name: str, number: int) -> Callable[[Path], contextlib.AbstractContextManager]:
    """A function of the system that always fails while the files of a study or results are written."""

    def fail(*arguments, **_):
        raise OSError(number, os.strerror(number))

    return lambda path: mock.patch(f"scan2flex_jax.study.files.{name}", fail)


FILES: dict[str, Target] = {
    "own study.toml": Target(_own("study.toml")),
    "own curve": Target(_own("pose-0")),
    "own curve by ..": Target(lambda out, study, ending: study / ".." / study.name / measured(study).name),
    "own curve, other case": Target(lambda out, study, ending: study / measured(study).name.upper()),
    "own study.toml, other case": Target(_own("Study.Toml")),
    "link to own curve": Target(_linked),
    "hard link to own curve": Target(_hard),
    "link to own folder": Target(_through_a_folder),
    "foreign file": Target(_foreign, (REFUSED, WORKED)),
    "link to a foreign file": Target(_foreign_link, (REFUSED, WORKED)),
    "empty file": Target(_empty, (WORKED, WORKED)),
    "new file in a new folder": Target(_plain, (WORKED, WORKED)),
    "folder": Target(_folder),
    "out folder itself": Target(lambda out, study, ending: out),
    "loop of links": Target(_loop),
    "below a loop of links": Target(lambda out, study, ending: _loop(out, study, ending) / f"x{ending}"),
    "link to nowhere": Target(_dangling, (WORKED, WORKED)),
    "below a file": Target(lambda out, study, ending: _foreign(out, study, ending) / f"x{ending}"),
    "below own curve": Target(lambda out, study, ending: measured(study) / f"x{ending}"),
    "name of 300 bytes": Target(lambda out, study, ending: out / f"{'x' * 300}{ending}"),
    "path of 5000 bytes": Target(lambda out, study, ending: f"{out}{('/' + 'd' * 99) * 50}/x{ending}"),
    "name with a line break": Target(lambda out, study, ending: out / f"a\nb\x1b[2J{ending}", (None, None)),
    "name that is no UTF-8": Target(lambda out, study, ending: out / os.fsdecode(b"caf\xe9" + ending.encode()), (None, None)),
    "name with a null byte": Target(lambda out, study, ending: f"{out}/a\0b{ending}"),
    "/proc": Target(lambda out, study, ending: f"/proc/none/x{ending}"),
    "/dev/null": Target(_device("/dev/null"), (WORKED, WORKED)),
    "/dev/full": Target(_device("/dev/full")),
    "pipe that is read": Target(_pipe, (WORKED, WORKED), _read),
    "pipe that nobody reads": Target(_pipe, (REFUSED, REFUSED), _unread),
    "socket": Target(_socket, (REFUSED, REFUSED), _unread),
    "full disk": Target(_plain, (REFUSED, REFUSED), full(0)),
    "disk full after 40 bytes": Target(_plain, (REFUSED, REFUSED), full(40)),
    "full disk, old result": Target(_empty, (REFUSED, REFUSED), full(10)),
    "fsync fails": Target(_plain, (REFUSED, REFUSED), failing("os.fsync", 5)),
    "fsync fails, foreign file": Target(_foreign, (REFUSED, REFUSED), failing("os.fsync", 28)),
}  # fmt: skip
FOLDERS: dict[str, Target] = {
    "the study itself": Target(lambda out, study, ending: study, (None, None)),
    "the study by a link": Target(lambda out, study, ending: _through_a_folder(out, study, ending).parent, (None, None)),
    **{name: FILES[name] for name in ("own curve", "own study.toml", "loop of links", "below a file", "below own curve",
       "name of 300 bytes", "path of 5000 bytes", "name with a line break", "name that is no UTF-8", "name with a null byte",
       "/proc",
       "pipe that nobody reads", "full disk", "disk full after 40 bytes", "fsync fails")},
    "new folder": Target(_plain, (WORKED, WORKED)),
    "/dev/null": Target(_device("/dev/null")),
    "foreign file as a folder": Target(_foreign),
}  # fmt: skip
