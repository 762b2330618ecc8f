"""A part of `benchmarks/attacks`: hostile values, names, outputs, files, stores and caches. There it is thousands."""

from pathlib import Path

import jaxtyping
import numpy as np
import pytest

from benchmarks.attacks import attempt, kills
from benchmarks.attacks.__main__ import CLASSES, summary, tries
from benchmarks.attacks.attempt import FAILURE, REFUSED, WORKED, Place, RefusedError, Tally, Try, WrongError
from scan2flex_jax.errors import Scan2FlexError

MOST = {"values": 60, "names": 16, "outputs": 40, "sizes": 24, "stores": 40, "caches": 20}
SLOW = ("explain", "report", "plan", "fit", "extract", "demo", "simulate", "two processes", "a cache")  # minutes of compiling
LARGE = ("million", "MB", "sparse", "packed", "lying", "rows", "line", "many", "endless", "nested")  # seconds of writing


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder to attack in, as a user without this run's cache and checks of annotations."""
    monkeypatch.setenv("SCAN2FLEX_CACHE", "off")
    jaxtyping.config.update("jaxtyping_disable", True)
    yield Place(tmp_path)
    jaxtyping.config.update("jaxtyping_disable", False)


@pytest.mark.parametrize("name", MOST)
def test_every_try_works_or_is_refused_in_one_sentence(name, place):
    every = [one for one in tries(name, place, seed=1) if not one.name.startswith(SLOW) and not _large(name, one)]
    some = [every[i] for i in np.linspace(0, len(every) - 1, MOST[name]).astype(int)]
    tally = attempt.run(some, place)
    assert tally.failures == {}
    assert tally.tries + sum(tally.not_run.values()) == MOST[name]
    assert tally.worked + tally.refused == tally.tries


def _large(name, one):
    return name == "sizes" and any(word in one.name for word in LARGE)


def test_the_same_seed_gives_the_same_tries(tmp_path):
    first, second = ([one.name for one in tries("stores", Place(tmp_path / str(i)), seed=3)] for i in range(2))
    assert first == second and len(set(first)) > 300


def outcome(place, act, writes=(), **more):
    tally = Tally()
    place.attempt(Try("a try", act, writes, **more), tally)
    return next(iter(tally.failures), WORKED if tally.worked else REFUSED)


def raises(error):
    def act():
        raise error

    return act


def test_what_harms_is_a_failure(place):
    """Each rule of the judge, on a try that breaks it."""
    mine, out = place.root / "mine.csv", place.root / "out"
    mine.write_text("measured")
    two_lines = "a refusal that is not one printable line"
    assert outcome(place, lambda: None) == WORKED
    assert outcome(place, raises(Scan2FlexError("no"))) == outcome(place, raises(RefusedError("no"))) == REFUSED
    assert outcome(place, raises(Scan2FlexError("a\nb"))) == outcome(place, raises(Scan2FlexError("\x1b[2J"))) == two_lines
    assert outcome(place, raises(KeyError("a"))).startswith("KeyError from test_attacks.py")
    assert outcome(place, raises(WrongError("another number: 3 for 4"))) == "another number"
    assert outcome(place, lambda: None, must=REFUSED) == "worked, and not refused"
    assert outcome(place, lambda: mine.write_text("changed")) == "a file that was there has changed"
    assert outcome(place, mine.unlink) == "a file that was there is lost"
    assert mine.read_text() == "measured"
    assert outcome(place, (place.watched / "esc").touch, (out,)) == "a file outside of what may be written"
    assert outcome(place, lambda: _write(out / ".x.tmp"), (out,)) == "a temporary file that stays"
    assert outcome(place, lambda: _write(out / "x.csv"), (out,)) == WORKED
    assert outcome(place, lambda: mine.write_text("changed"), (place.root,), saves=True) == "a file that was there has changed"
    backed = lambda: (mine.rename(f"{mine}.bak"), mine.write_text("changed"))  # noqa: E731
    assert outcome(place, backed, (place.root,), saves=True) == WORKED
    assert sorted(p.name for p in place.root.iterdir()) == ["mine.csv"]


def _write(path: Path):
    path.parent.mkdir()
    path.write_text("x")


def test_a_command_is_judged_by_its_code_and_its_words():
    said = attempt.Said
    assert said(0, "done\n", "").judged()
    for one in (said(2, "", "scan2flex: no: do this.\n"), said(3, "", "")):
        with pytest.raises(RefusedError):
            one.judged()
    for one in (
        said(1, "", ""),
        said(2, "", "scan2flex: a\nb\n"),
        said(2, "", ""),
        said(0, "\x1b[2J", ""),
        said(0, "", "Traceback"),
    ):
        with pytest.raises(WrongError):
            one.judged()


def test_half_a_result_is_found(tmp_path):
    for name, data in {
        "a.json": "{",
        "b.json": '{"a": NaN}',
        "c.html": "<html>",
        "d.png": "\x89PNG",
        "study.toml": "x",
    }.items():
        (tmp_path / name).write_text(data)
        with pytest.raises(WrongError):
            kills.whole(tmp_path, {})
        (tmp_path / name).unlink()
    kills.whole(tmp_path, {})
    with pytest.raises(WrongError, match="is gone"):
        kills.whole(tmp_path, {tmp_path / "old.json": ("file", b"{}")})


def test_the_record_counts_every_class():
    tally = Tally()
    tally.add(Try("a", print), WORKED, None, 1.0, 2.0)
    tally.add(Try("b", print), FAILURE, ("a hang", "too long"), 3.0, 1.0)
    found = summary(dict.fromkeys(CLASSES, tally), 0)
    assert (found["tries"], found["failures"]) == (2 * len(CLASSES), len(CLASSES))
    assert found["classes"]["values"]["failures"] == {"a hang": {"count": 1, "try": "b", "example": "too long"}}
