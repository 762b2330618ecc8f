"""One try, watched: what it did to the files around it, what it took, and what came of it."""

import contextlib
import io
import os
import shutil
import signal
import stat
import sys
import time
import traceback
import warnings
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from unittest import mock

from scan2flex_jax.cli import main
from scan2flex_jax.errors import Scan2FlexError

LIMIT_S, LIMIT_MB = 120.0, 1000.0
WORKED, REFUSED, FAILURE, NOT_RUN = "worked", "refused", "failure", "not run"
USAGE = "Usage:"  # typer's own complaint about an option is a box of several lines
_LARGE = 10_000_000  # bytes: larger files are watched by size and time, and not kept
_STATUS, _PEAK = Path("/proc/self/status"), Path("/proc/self/clear_refs")


class WrongError(Exception):
    """What must not come of a try, in one sentence."""


class RefusedError(Exception):
    """A command ended with exit code 2 and one sentence, or with 3."""


class NotRunError(Exception):
    """This machine or this user cannot make the try; says why."""


class Hang(BaseException):
    """More time than one try may take; no `except Exception` of a library stops it."""


@dataclass(frozen=True)
class Try:
    """``prepare()`` puts files there, ``act()`` attacks; ``must`` is the only right outcome, where there is one.

    Files may appear or change below ``writes`` alone; with ``saves`` those that change leave a copy of the old one beside them.
    What ``stays`` meets the next try, temporary files too. A try that takes ``longest`` seconds hangs.
    """

    name: str
    act: Callable[[], object]
    writes: tuple[Path, ...] = ()
    must: str | None = None
    saves: bool = False
    prepare: Callable[[], object] | None = None
    stays: bool = False
    longest: float = LIMIT_S


@dataclass
class Tally:
    """What came of the tries of one class."""

    tries: int = 0
    worked: int = 0
    refused: int = 0
    seconds: float = 0.0
    slowest_s: float = 0.0
    slowest: str = ""
    most_mb: float = 0.0
    failures: dict[str, dict] = field(default_factory=dict)
    not_run: dict[str, int] = field(default_factory=dict)

    def add(self, one: Try, outcome: str, fault: tuple[str, str] | None, took: float, memory: float) -> None:
        """Count a try; ``fault`` is the kind of a failure, and its example."""
        if outcome == NOT_RUN:
            self.not_run[fault[1]] = self.not_run.get(fault[1], 0) + 1
            return
        self.tries += 1
        self.worked += outcome == WORKED
        self.refused += outcome == REFUSED
        self.seconds += took
        self.most_mb = max(self.most_mb, memory)
        if took > self.slowest_s:
            self.slowest_s, self.slowest = took, one.name
        if fault:
            first = {"count": 0, "try": one.name, "example": fault[1]}
            self.failures.setdefault(fault[0], first)["count"] += 1


class Place:
    """A folder, far below one that is watched too, in which a class attacks; nothing of a try stays in it."""

    def __init__(self, folder: Path):
        """``folder`` must be empty."""
        self.watched = folder
        self.root = folder / "home" / "user" / "work"  # what leaves it by ../.. is still seen
        self.root.mkdir(parents=True)

    def attempt(self, one: Try, tally: Tally) -> None:
        """Make a try, judge it, and put everything back."""
        clean = snapshot(self.watched)
        outcome, said, fault = _outcome(one.prepare, one.longest) if one.prepare else (WORKED, "", None)
        if outcome == REFUSED:
            outcome, fault = FAILURE, ("a preparation that is refused", said)
        before = snapshot(self.watched)
        memory, began = reset_memory(), time.monotonic()
        if outcome == WORKED:
            outcome, said, fault = _outcome(one.act, one.longest)
        took, memory = time.monotonic() - began, memory_mb() - memory
        after = snapshot(self.watched)
        if outcome not in (FAILURE, NOT_RUN):
            fault = _harm(one, before, after) or _excess(one, outcome, said, memory)
        if not one.stays:
            restore(clean, after)
        tally.add(one, FAILURE if fault and outcome != NOT_RUN else outcome, fault, took, memory)


def _outcome(act: Callable[[], object], longest: float) -> tuple[str, str, tuple[str, str] | None]:
    """What came of an act, what was said, and what is wrong with it: ``(kind, example)``."""
    outcome, said, fault = FAILURE, "", None
    signal.setitimer(signal.ITIMER_REAL, longest)
    try:
        act()
        outcome = WORKED
    except (Scan2FlexError, RefusedError) as refusal:
        said = str(refusal)
        if said.strip() and "\n" not in said and said.isprintable():
            outcome, said = REFUSED, said[:300]
        else:
            fault = "a refusal that is not one printable line", ascii(said[:300])
    except WrongError as wrong:
        kind, _, example = str(wrong).partition(": ")
        fault = kind, example[:600]
    except NotRunError as why:
        outcome, fault = NOT_RUN, ("not run", str(why))
    except Hang:
        fault = "a hang", f"more than {longest:g} s"
    except Exception as error:
        fault = _fault(error)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
    return outcome, said, fault


def _fault(error: Exception) -> tuple[str, str]:
    """An exception by the line of the package that it comes from."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [f for f in frames if "scan2flex_jax" in f.filename] or frames
    return f"{type(error).__name__} from {Path(own[-1].filename).name}:{own[-1].lineno}", str(error)[:300]


def _harm(one: Try, before: dict, after: dict) -> tuple[str, str] | None:
    """What a try did to files that it must leave alone."""
    for path, was in before.items():
        now = after.get(path)
        if now == was or (one.saves and _copied(path, after, was)):
            continue
        if not any(_below(path, own) for own in one.writes) or one.saves:
            return ("a file that was there is lost" if now is None else "a file that was there has changed"), str(path)
    for path in after.keys() - before.keys():
        if not any(_below(path, own) or _below(own, path) for own in one.writes):
            return "a file outside of what may be written", str(path)
        if path.name.endswith((".tmp", ".part")) and not one.stays:
            return "a temporary file that stays", str(path)
    return None


def _copied(path: Path, after: dict, was: tuple) -> bool:
    """Whether a copy beside a file holds what it held."""
    return any(after[p] == was for p in after if p.parent == path.parent and p.name.startswith(f"{path.name}.bak"))


def _below(path: Path, folder: Path) -> bool:
    return path == folder or folder in path.parents


def _excess(one: Try, outcome: str, said: str, memory: float) -> tuple[str, str] | None:
    if memory > LIMIT_MB:
        return "too much memory", f"{memory:.0f} MB"
    if one.must and outcome != one.must:
        return f"{outcome}, and not {one.must}", said
    return None


def snapshot(folder: Path) -> dict[Path, tuple]:
    """Everything below a folder: ``path: (kind, contents)``."""
    found = {}
    for parent, folders, files in os.walk(folder):
        for name in (*folders, *files):
            path = Path(parent, name)
            held = path.lstat()
            if stat.S_ISLNK(held.st_mode):
                found[path] = ("link", os.readlink(path))
            elif stat.S_ISREG(held.st_mode):
                large = held.st_size > _LARGE
                found[path] = ("file", (held.st_size, held.st_mtime_ns) if large else path.read_bytes())
            else:
                found[path] = ("folder" if stat.S_ISDIR(held.st_mode) else "other", stat.S_IFMT(held.st_mode))
    return found


def restore(before: dict, after: dict) -> None:
    """Remove what is new, and put back the files that have changed."""
    for path in after.keys() - before.keys():
        _remove(path)
    for path, (kind, contents) in before.items():
        if after.get(path) != (kind, contents) and kind == "file" and isinstance(contents, bytes):
            _remove(path)
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(contents)


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path, ignore_errors=True)
    else:
        path.unlink(missing_ok=True)


def reset_memory() -> float:
    """Forget the largest resident size so far, where the system lets it; the resident size (MB)."""
    with contextlib.suppress(OSError):
        _PEAK.write_text("5")
    return memory_mb()


def memory_mb() -> float:
    """Largest resident size since `reset_memory` (MB); zero where the system does not say."""
    if not _STATUS.exists():
        return 0.0
    return next((int(line.split()[1]) / 1024 for line in _STATUS.open() if line.startswith("VmHWM")), 0.0)


@dataclass(frozen=True)
class Said:
    """What a command said, and its exit code."""

    code: int
    out: str
    err: str

    def judged(self) -> "Said":
        """Itself, where it is done; raises `RefusedError`, or `WrongError` for what no command may do."""
        said = f"exit code {self.code}: {self.err[-600:]}"
        if self.code not in (0, 2, 3) or "Traceback" in self.err:
            raise WrongError(f"a command that ends badly: {said}")
        odd = [c for c in self.out + self.err if not (c.isprintable() or c in "\n\t")]
        if odd:
            raise WrongError(f"control characters on the terminal: {odd[:5]!a}")
        if self.code == 2 and not self.err.startswith(USAGE):
            sentence = self.err.removesuffix("\n")
            if "\n" in sentence or not sentence.startswith("scan2flex: "):
                raise WrongError(f"exit code 2 without one sentence: {self.err[:600]}")
        if self.code:
            raise RefusedError(" ".join(self.err.split()) or "not to be believed")
        return self


def command(*words: object) -> Said:
    """A command in this process, as the program runs it."""
    out, err, code = io.StringIO(), io.StringIO(), 0
    called = mock.patch.object(sys, "argv", ["scan2flex", *map(str, words)])
    ended = mock.patch("scan2flex_jax.cli.app.os._exit", sys.exit)  # it does not wait for threads; here they go on
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), called, ended:
        try:
            main()
        except SystemExit as end:
            code = end.code if isinstance(end.code, int) else int(end.code is not None)
        finally:
            if "matplotlib.pyplot" in sys.modules:  # a process of its own ends with its figures
                sys.modules["matplotlib.pyplot"].close("all")
    return Said(code, out.getvalue(), err.getvalue()).judged()


def run(tries: Iterable[Try], place: Place) -> Tally:
    """All tries of a class, one after the other, with warnings about numbers as exceptions."""
    tally = Tally()
    before = signal.signal(signal.SIGALRM, _hung)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)
            for one in tries:
                place.attempt(one, tally)
    finally:
        signal.signal(signal.SIGALRM, before)
    return tally


def _hung(*_):
    raise Hang
