"""Every command's results onto places where they must not, cannot or may go; the answers are computed once."""

import itertools
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.attacks import scene
from benchmarks.attacks.attempt import REFUSED, Place, Try, WrongError, command
from benchmarks.attacks.names import strict_json, tags, whole_picture
from benchmarks.attacks.targets import FILES, FOLDERS, Target

SMALL = ("--elements", scene.ELEMENTS)
STARTED = ("--length=1", "--density=0.2", "--radius=5 mm", "--units=m", "--clamps-from-curves")  # what `new` must be told
MATRIX = "--matrix=1,0,0,0,0,1,0,0,0,0,1,0"
Words = Callable[[Path, object], tuple]
SINKS: dict[str, tuple[str, Words]] = {  # the ending of the file, and the command's words for a study and a target
    "check --json": (".json", lambda study, to: ("check", study, "--json", to)),
    "pose --json": (".json", lambda study, to: ("pose", MATRIX, "--json", to)),
    "curve -o": (".csv", lambda study, to: ("curve", study / "pose-0.csv", "-o", to)),
    "curve --json": (".json", lambda study, to: ("curve", study / "pose-0.csv", "--json", to)),
    "simulate --json": (".json", lambda study, to: ("simulate", study, "--out", _beside(study, "s"), "--json", to, *SMALL)),
    "fit --json": (".json", lambda study, to: ("fit", study, "--json", to, *SMALL)),
    "fit --figure": (".png", lambda study, to: ("fit", study, "--figure", to, *SMALL)),
    "explain --json": (".json", lambda study, to: ("explain", study, "--json", to, *SMALL)),
    "plan --json": (".json", lambda study, to: ("plan", study, "--json", to, *SMALL)),
    "report -o": (".html", lambda study, to: ("report", study, "-o", to, *SMALL)),
    "report --json": (".json", lambda study, to: ("report", study, "-o", _beside(study, "r.html"), "--json", to, *SMALL)),
    "export -o": (".xml", lambda study, to: ("export", study, "--to", "mujoco", "-o", to, *SMALL)),
    "extract --json": (".json", lambda study, to: ("extract", study, "--save", _beside(study, "e"), "--json", to)),
}
FOLDER_SINKS: dict[str, Words] = {
    "simulate --out": lambda study, to: ("simulate", study, "--out", to, *SMALL),
    "fit --save": lambda study, to: ("fit", study, "--save", to, *SMALL),
    "explain --figures": lambda study, to: ("explain", study, "--figures", to, *SMALL),
    "explain --save": lambda study, to: ("explain", study, "--save", to, *SMALL),
    "extract --save": lambda study, to: ("extract", study, "--save", to),
    "extract --figures": lambda study, to: ("extract", study, "--save", _beside(study, "e"), "--figures", to),
    "new --out": lambda study, to: ("new", study, *STARTED, "--out", to),
    "demo --out": lambda study, to: ("demo", "--out", to),
}
NO_FORCE = ("fit --save", "explain --save", "extract --save", "new --out")  # old files are kept in backups
_BACKED = {"the study itself", "the study by a link"}


def _beside(study: Path, name: str) -> Path:
    """Where a command writes what is not attacked."""
    return study.parent / "out" / name


def tries(place: Place, rng: np.random.Generator) -> Iterator[Try]:
    """Each way to write onto each target, without and with --force."""
    for (sink, (ending, words)), (name, target), force in itertools.product(SINKS.items(), FILES.items(), (False, True)):
        yield _try(place, sink, name, target, ending, words, force, saves=False)
    for (sink, words), (name, target), force in itertools.product(FOLDER_SINKS.items(), FOLDERS.items(), (False, True)):
        if force and sink in NO_FORCE:
            continue
        if sink == "demo --out" and target.must != (REFUSED, REFUSED):
            continue  # what it writes takes a minute
        yield _try(place, sink, name, target, "", words, force, saves=name in _BACKED)
    yield from _onto_its_own(place)


def _try(place, sink, name, target: Target, ending, words, force, saves) -> Try:
    study, out = place.root / "study", place.root / "out"
    made: dict[str, object] = {}

    def prepare():
        _study(study, sink)
        out.mkdir()
        made["to"] = target.make(out, study, ending)

    def act():
        to = made["to"]
        with scene.answers_kept(), target.around(Path(str(to))):
            command(*words(study, to), *(("--force",) if force else ()))
        if not saves:
            _whole(Path(str(to)), ending)

    must = target.must[force]
    refused_first = must == REFUSED and target.around is Target.around
    writes = () if refused_first else (study, out) if saves else (out,)
    return Try(f"{sink}: {name}{' --force' if force else ''}", act, writes, must, saves=saves, prepare=prepare)


def _study(study: Path, sink: str) -> None:
    """A study whose poses are called as their files are."""
    scene.write(study, ["pose-0", "pose-1"], scanned=sink.startswith("extract"))


def _whole(path: Path, ending: str) -> None:
    """What was written reads as what it is."""
    if not path.is_file():
        return
    if ending == ".json":
        strict_json(path)
    elif ending == ".png":
        whole_picture(path)
    elif ending == ".html" and ("html", ()) not in {(tag, ()) for tag, _ in tags(path.read_text("utf-8"))}:
        raise WrongError(f"no page: {path.name}")
    elif not path.stat().st_size:
        raise WrongError(f"an empty result: {path.name}")


def _onto_its_own(place: Place) -> Iterator[Try]:
    """A result is replaced by the same command again, and is the user's once it was changed."""
    study, out = place.root / "study", place.root / "out"
    for sink, (ending, words) in SINKS.items():
        to = out / f"result{ending}"

        def prepare(sink=sink, words=words, to=to, changed=b""):
            _study(study, sink)
            with scene.answers_kept():
                command(*words(study, to))
            if changed:
                to.write_bytes(to.read_bytes() + changed)

        def act(words=words, to=to, more=()):
            with scene.answers_kept():
                command(*words(study, to), *more)

        yield Try(f"{sink}: its own result", act, (out,), "worked", prepare=prepare)
        changed = partial(prepare, changed=b" ")
        yield Try(f"{sink}: its own result, changed since", act, (), REFUSED, prepare=changed)
        yield Try(
            f"{sink}: its own result, changed since --force", partial(act, more=("--force",)), (out,), "worked", prepare=changed
        )
