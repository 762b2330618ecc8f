"""Where and by whom the program is run: no home, another user, a read-only installation, closed streams, few resources."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path

import numpy as np

from benchmarks.attacks import scene
from benchmarks.attacks.attempt import REFUSED, WORKED, NotRunError, Place, Try, WrongError
from benchmarks.attacks.names import strict_json
from benchmarks.attacks.process import PROGRAM, ROOT, environment, said, start

NOBODY = 65534
LONG = "x" * 300
NO_ONE = 54321  # a user without an entry in the list of users, and so without a home
SMALL = ("--elements", scene.ELEMENTS)
STARTED = ("--length=1", "--density=0.2", "--units=m", "--clamps-from-curves")  # what `new` must be told
KEPT = "scan2flex: compiled functions are"  # what is said of a cache that lies elsewhere, or nowhere


def tries(place: Place, rng: np.random.Generator) -> Iterator[Try]:
    """Environments, users, streams, and signals."""
    scene.shapes()
    study, out = place.root / "study", place.root / "out"

    def one(name, act, must=WORKED, prepare=None) -> Try:
        def both():
            scene.write(study)
            out.mkdir(mode=0o777)
            if prepare is not None:
                prepare()

        return Try(name, act, (out,), must, prepare=both)

    for name, changes in _environments(out).items():
        yield one(name, partial(_simulated, study, out, changes), prepare=partial(_homes, out))
    yield one("SCAN2FLEX_MAX_POINTS = many", partial(_simulated, study, out, {"SCAN2FLEX_MAX_POINTS": "many"}), REFUSED)
    yield one("no folder to keep settings of pictures in", partial(_drawn, study, out))
    for name, (act, must) in _users(study, out).items():
        yield one(name, act, must, partial(_shared, place, study, out))
    for name, (shell, must) in _streams().items():
        yield one(name, partial(_in_a_shell, shell, study, out), must)
    for i in range(4):
        yield one(f"interrupted, {i}", partial(_interrupted, study, out, float(rng.uniform(1.5, 5.0))))


def _environments(out: Path) -> dict[str, dict[str, object]]:
    none = {"SCAN2FLEX_CACHE": None, "XDG_CACHE_HOME": None, "TMPDIR": out / "temporary"}
    return {
        **{f"HOME = {Path(home).name}": {**none, "HOME": home} for home in ("/proc/none", "/nonexistent", out / "file", out / "loop")},
        "HOME and TMPDIR take nothing": {**none, "HOME": "/proc/none", "TMPDIR": "/proc/none"},
        "XDG_CACHE_HOME is a file": {**none, "XDG_CACHE_HOME": out / "file"},
        **{f"SCAN2FLEX_CACHE = {Path(c).name[:9]}": {**none, "SCAN2FLEX_CACHE": c} for c in (out / "file", out / "loop", "/dev/null", LONG)},
        "SCAN2FLEX_CACHE of everybody": {**none, "SCAN2FLEX_CACHE": out / "everybody"},
        "SCAN2FLEX_CACHE of another user": {**none, "SCAN2FLEX_CACHE": out / "another"},
        "JAX_ENABLE_X64 = 0": {"JAX_ENABLE_X64": "0"},
        "JAX_COMPILATION_CACHE_DIR": {"JAX_COMPILATION_CACHE_DIR": "/proc/none"},
        "LC_ALL = C": {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
        "PYTHONIOENCODING = ascii": {"PYTHONIOENCODING": "ascii"},
        "TERM = dumb, one column": {"TERM": "dumb", "COLUMNS": "1"},
        "no TERM, no PATH, no LANG": {"TERM": None, "PATH": None, "LANG": None},
        "PYTHONOPTIMIZE = 2": {"PYTHONOPTIMIZE": "2"},
        "PYTHONWARNINGS = error::RuntimeWarning": {"PYTHONWARNINGS": "error::RuntimeWarning"},
    }  # fmt: skip


def _homes(out: Path) -> None:
    (out / "file").touch()
    (out / "loop").symlink_to(out / "loop")
    (out / "everybody").mkdir()
    (out / "everybody").chmod(0o777)
    (out / "another").mkdir()
    if os.geteuid() == 0:
        os.chown(out / "another", NOBODY, NOBODY)
    (out / "temporary").mkdir(mode=0o700)


def _simulated(study: Path, out: Path, changes: dict[str, object], before: tuple[str, ...] = (), **options) -> None:
    """A simulation into ``out``, which says at most that its cache lies elsewhere."""
    words = ("simulate", study, "--out", out / "s", "--json", out / "s.json", *SMALL)
    env = environment(**{"SCAN2FLEX_CACHE": os.environ.get("SCAN2FLEX_CACHE"), **changes})
    found = said(start(*words, before=before, env=env, **options), (KEPT,))
    if found.err.strip():
        raise WrongError(f"a command that has nothing to complain of says: {found.err[-400:]}")
    if set(strict_json(out / "s.json")) != {"one", "two"}:
        raise WrongError("a result without its poses")


def _drawn(study: Path, out: Path) -> None:
    env = environment(
        HOME="/proc/none", MPLCONFIGDIR="/proc/none", SCAN2FLEX_CACHE=os.environ.get("SCAN2FLEX_CACHE"), TMPDIR=out
    )
    said(start("fit", study, "--figure", out / "f.png", *SMALL, env=env), (KEPT,))
    if not (out / "f.png").stat().st_size:
        raise WrongError("an empty picture")


@cache
def _another(user: int) -> tuple[str, ...]:
    """What runs a program as another user; raises `NotRunError` where that cannot be."""
    if os.geteuid() != 0 or not shutil.which("setpriv"):
        raise NotRunError("only the administrator can run a program as another user (setpriv)")
    before = ("setpriv", f"--reuid={user}", f"--regid={user}", "--clear-groups")
    test = [*before, sys.executable, "-c", "import jax"]
    if subprocess.run(test, capture_output=True, check=False, cwd="/", env=environment(HOME="/")).returncode:
        raise NotRunError("another user cannot read this installation of Python")
    return before


def _shared(place: Place, study: Path, out: Path) -> None:
    """Others may read the study and write the results; a copy of the package that nobody may write to lies beside them."""
    for folder in (study, *study.parents):
        if place.watched in (folder, *folder.parents):
            folder.chmod(0o755)
    out.chmod(0o777)
    shutil.copytree(ROOT / "scan2flex_jax", out / "installed" / "scan2flex_jax", ignore=shutil.ignore_patterns("__pycache__"))
    for path in (out / "installed").rglob("*"):
        path.chmod(0o555 if path.is_dir() else 0o444)
    (out / "installed").chmod(0o555)
    for name in ("secret", "taken"):
        (out / name).mkdir()
        scene.write(out / name / "study")
    (out / "secret" / "study" / "study.toml").chmod(0o600)


def _users(study: Path, out: Path) -> dict[str, tuple[Callable[[], None], str]]:
    """Other users, with their own cache, and an installation that they cannot change."""
    installed = {"PYTHONPATH": out / "installed", "PYTHONDONTWRITEBYTECODE": None}

    def act(user: int, changes: dict | None = None):
        env = {"HOME": "/nonexistent", "SCAN2FLEX_CACHE": None, "TMPDIR": out / f"of-{user}", **(changes or {})}

        def simulated():
            (out / f"of-{user}").mkdir(mode=0o700)
            os.chown(out / f"of-{user}", user, user)
            _simulated(study, out, env, _another(user))

        return simulated

    def words(*given: object):
        env = environment(HOME="/nonexistent", SCAN2FLEX_CACHE="off")
        return lambda: said(start(*given, before=_another(NOBODY), env=env))

    taken = out / "taken" / "study"
    return {
        "read-only installation": (partial(_simulated, study, out, installed), WORKED),
        "another user": (act(NOBODY), WORKED),
        "another user, read-only installation": (act(NOBODY, installed), WORKED),
        "a user without an entry and without HOME": (act(NO_ONE, {"HOME": None}), WORKED),
        "another user's study that is secret": (words("check", out / "secret" / "study"), REFUSED),
        "another user's folder": (words("check", study, "--json", taken / "x.json"), REFUSED),
        "another user's curve": (words("check", study, "--json", taken / "pose-0.csv", "--force"), REFUSED),
        "save into another user's study": (words("new", study, *STARTED, "--out", taken), REFUSED),
    }  # fmt: skip


def _streams() -> dict[str, tuple[str, str | None]]:
    """Shell lines around the program ("$@")."""
    return {
        "standard input closed": ('"$@" <&-', WORKED),
        "standard output closed": ('"$@" >&-', None),
        "standard error closed": ('"$@" 2>&-', WORKED),
        "all streams closed": ('"$@" <&- >&- 2>&-', None),
        "standard output is full": ('"$@" > /dev/full', REFUSED),
        "standard error is full": ('"$@" 2> /dev/full', WORKED),
        "nobody reads on": ('"$@" | true', WORKED),
        "in a folder that is gone": ('d=$(mktemp -d) && cd "$d" && rmdir "$d" && "$@"', WORKED),
        "20 open files": ('ulimit -n 20; "$@"', None),
        "no core, little stack": ('ulimit -c 0; ulimit -s 1024; "$@"', WORKED),
        "umask 077": ('umask 077; "$@"', WORKED),
        "files of 100 kB at most": ('ulimit -f 100; "$@"', WORKED),
    }


def _in_a_shell(shell: str, study: Path, out: Path) -> None:
    process = subprocess.Popen(
        ["sh", "-c", shell, "sh", *PROGRAM, "check", str(study), "--json", str(out / "c.json")],
        env=environment(TMPDIR=out), stdout=subprocess.PIPE, stderr=subprocess.PIPE, cwd="/",
    )  # fmt: skip
    said(process)
    strict_json(out / "c.json")


def _interrupted(study: Path, out: Path, after: float) -> None:
    """Ctrl-C ends the program with exit code 130 and without a traceback."""
    env = environment(SCAN2FLEX_CACHE=os.environ.get("SCAN2FLEX_CACHE"))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a signal that is ignored here would be ignored there
    process = start("explain", study, "--json", out / "e.json", *SMALL, env=env)
    signal.signal(signal.SIGINT, before)
    time.sleep(after)
    process.send_signal(signal.SIGINT)
    _, err = process.communicate(timeout=60)
    if process.returncode != 130 or b"Traceback" in err:
        raise WrongError(f"an interrupted command: exit code {process.returncode}, {err.decode()[-400:]}")
