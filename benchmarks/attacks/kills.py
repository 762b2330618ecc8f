"""SIGKILL at any moment of the commands that compute long and write much.

Ten processes of each command are killed one after the other in the same folders: four at a random moment of the whole run, six
soon after the first file appears, so that most fall into the writing. After each, every file is the old one or a whole new one,
and the study is what it was; a killed process leaves no file that anybody takes for a result. Each next process meets what the
killed ones left, and the last one, which nobody kills, must work.
"""

import signal
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.attacks import scene
from benchmarks.attacks.attempt import WORKED, NotRunError, Place, Try, WrongError, snapshot
from benchmarks.attacks.names import strict_json, tags, whole_picture
from benchmarks.attacks.process import environment, said, start
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study import load_study

MOMENTS, IN_ALL = 10, 4  # of each command; of them spread over the whole run
WRITING = 0.25  # s after the first file in which the others fall
LONGEST = 240.0  # s until the first file
SMALL = ("--elements", scene.ELEMENTS)
COMMANDS = {
    "fit": lambda study, out: (
        "fit",
        study,
        "--json",
        out / "f.json",
        "--save",
        out / "saved",
        "--figure",
        out / "f.png",
        *SMALL,
    ),
    "explain": lambda study, out: (
        "explain",
        study,
        "--json",
        out / "e.json",
        "--figures",
        out,
        "--save",
        out / "saved",
        *SMALL,
    ),
    "report": lambda study, out: ("report", study, "-o", out / "r.html", "--json", out / "r.json", *SMALL),
    "extract": lambda study, out: ("extract", study, "--figures", out, "--json", out / "x.json", "--save", out / "saved"),
}


def tries(place: Place, rng: np.random.Generator) -> Iterator[Try]:
    """The moments of each command, and the run after them."""
    for name in COMMANDS:
        study, out = place.root / name / "study", place.root / name / "out"
        scene.write(study, scanned=name == "extract")
        took: list[float] = []
        for i in range(MOMENTS):
            writing = i >= IN_ALL
            moment = float(rng.uniform(0.0, WRITING if writing else 1.0))
            act = partial(_killed, name, study, out, took, moment, writing)
            yield Try(
                f"{name}, {'writing, ' if writing else ''}{moment:.3f}", act, (out,), WORKED, stays=True, longest=2 * LONGEST
            )
        yield Try(
            f"{name} after {MOMENTS} kills", partial(_works, name, study, out), (out,), WORKED, stays=True, longest=2 * LONGEST
        )


def _killed(name: str, study: Path, out: Path, took: list[float], moment: float, writing: bool) -> None:
    """Kill the command at a moment of its run, and look at what there is."""
    if not took:
        took.append(_timed(name, study, out))
    loaded, old = load_study(study), snapshot(out) if out.exists() else {}
    process = start(*COMMANDS[name](study, out), env=environment())
    began = time.monotonic()
    if writing:
        until = _first_change(out, old, process, began)
        time.sleep(moment if until else 0.0)
    else:
        _sleep(moment * took[0], process)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    if process.returncode not in (-signal.SIGKILL, 0):
        raise WrongError(f"the run after a killed one ends with code {process.returncode}: {name}")
    whole(out, old)
    if load_study(study) != loaded:
        raise WrongError(f"a killed {name} changes the study")


def _timed(name: str, study: Path, out: Path) -> float:
    """Seconds of a whole run, which also fills the cache."""
    began = time.monotonic()
    said(start(*COMMANDS[name](study, out), env=environment()))
    return time.monotonic() - began


def _first_change(out: Path, old: dict, process, began: float) -> bool:
    """Wait for the first file that is new or another one, temporary ones too; False where the process ended first."""
    while process.poll() is None:
        if time.monotonic() - began > LONGEST:
            process.kill()
            raise NotRunError(f"nothing was written within {LONGEST:g} s")
        if _times(out) != {path: path.lstat().st_mtime_ns for path in old if path.exists() and path.is_file()}:
            return True
        time.sleep(0.002)
    return False


def _times(out: Path) -> dict[Path, int]:
    return {path: path.lstat().st_mtime_ns for path in out.rglob("*") if path.is_file()} if out.exists() else {}


def _sleep(seconds: float, process) -> None:
    until = time.monotonic() + seconds
    while process.poll() is None and time.monotonic() < until:
        time.sleep(0.01)


def whole(out: Path, old: dict) -> None:
    """Every file that has a result's name holds a whole result; a study that was there still loads."""
    for path in sorted(out.rglob("*")) if out.exists() else ():
        if path.name.startswith(".") or not path.is_file():
            continue  # a temporary file, whose name begins with a dot, is nobody's result
        try:
            _read_through(path)
        except WrongError:
            raise
        except (OSError, ValueError, SyntaxError, Scan2FlexError) as error:
            raise WrongError(f"a file that is half written: {path.name} ({type(error).__name__} {str(error)[:100]})") from error
    lost = [path.name for path in old if not path.exists() and not path.name.startswith(".")]
    if lost:
        raise WrongError(f"a result of an earlier run is gone: {lost}")


def _read_through(path: Path) -> None:
    kind = path.name.partition(".bak")[0].rpartition(".")[2]
    if kind == "json":
        strict_json(path)
    elif kind == "png":
        whole_picture(path)
    elif kind == "html":
        text = path.read_text("utf-8")
        if not text.rstrip().endswith("</html>") or not tags(text):
            raise WrongError(f"half a page: {path.name}")
    elif path.name == "study.toml":
        load_study(path)


def _works(name: str, study: Path, out: Path) -> None:
    """The command works, and leaves nothing temporary of its own."""
    said(start(*COMMANDS[name](study, out), env=environment()))
    whole(out, {})
    load_study(study)
