"""Sweep stores whose files were changed: they read as what was computed, or are refused; a sweep that goes on mends them."""

import json
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from benchmarks.attacks.attempt import REFUSED, Place, Try, WrongError
from scan2flex_jax.sweep import Axis, Calls, Output, grid, open_sweep, sweep

LANES, CHUNK = 24, 8
FILES = ("definition.json", "lanes.nc", "chunk-00000.nc", "chunk-00001.nc", "chunk-00002.nc")
FLIPS, CUTS = 60, 12  # of each file


def task() -> tuple[Calls, object]:
    """Squares and powers of numbers."""
    outputs = {"square": Output("m^2"), "powers": Output("-", ("power",))}

    def squares(lane):
        return {"square": lane["x"] ** 2, "powers": lane["x"] ** np.arange(3)}

    return Calls(squares, outputs, {"function": "squares"}), grid(x=Axis(np.arange(float(LANES)), "m"))


def tries(place: Place, rng: np.random.Generator) -> Iterator[Try]:
    """Bits, cuts, copies and exchanges of each file, read and gone on with."""
    store = place.root / "store"
    whole = sweep(*task(), store=store, chunk=CHUNK).drop_vars("seconds")
    original = {name: (store / name).read_bytes() for name in FILES}
    for name in FILES:
        for said, data in damaged(original[name], rng):
            for way in (_read, _gone_on):
                yield _try(place, store, whole, f"{name}: {said}", name, data, way)
        for other in FILES:
            if other != name:
                for way in (_read, _gone_on):
                    yield _try(place, store, whole, f"{name}: holds {other}", name, original[other], way)
        yield from _no_file(place, store, whole, name)
    yield from _texts(place, store, whole, original["definition.json"])


def damaged(data: bytes, rng: np.random.Generator) -> Iterator[tuple[str, bytes]]:
    """A file with one bit turned, cut, doubled, emptied, and with other numbers in it."""
    for place in np.unique(rng.integers(0, 8 * len(data), FLIPS)):
        copy = bytearray(data)
        copy[place // 8] ^= 1 << (place % 8)
        yield f"bit {place} turned", bytes(copy)
    for end in np.unique(rng.integers(0, len(data), CUTS)):
        yield f"cut after {end} bytes", data[:end]
    low, high = sorted(rng.integers(0, len(data), 2))
    changes = {
        "doubled": 2 * data, "empty": b"", "a piece doubled": data[:high] + data[low:],
        "a piece missing": data[:low] + data[high + 1 :],
        "zeros": bytes(len(data)), "random": rng.bytes(len(data)), "longer": data + b"\0", "text": b"text\n" * 50,
        "NaN": data.replace(np.array(4.0, ">f8").tobytes(), np.array(np.nan, ">f8").tobytes()),
        "reversed": data[::-1], "checksum alone": data[-64:],
    }  # fmt: skip
    yield from ((said, changed) for said, changed in changes.items() if changed != data)


def _try(place, store, whole, said, name, data, way) -> Try:
    return Try(
        f"{way.__name__.strip('_')} {said}",
        lambda: way(store, whole),
        (store,),
        prepare=lambda: (store / name).write_bytes(data),
    )


def _read(store: Path, whole) -> None:
    """A store that is read says what was computed."""
    if not open_sweep(store).drop_vars("seconds").identical(whole):
        raise WrongError("a damaged store is read as another one")


def _gone_on(store: Path, whole) -> None:
    """A sweep that goes on from it ends with what was computed."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        found = sweep(*task(), store=store, chunk=CHUNK)
    if not found.drop_vars("seconds").identical(whole):
        raise WrongError("a sweep that went on from a damaged store is another one")
    _read(store, whole)


def _no_file(place, store, whole, name) -> Iterator[Try]:
    """Something else than a file in the place of one."""

    def gone():
        (store / name).unlink()

    def folder():
        gone()
        (store / name).mkdir()

    def link():
        gone()
        (store / name).symlink_to(store / name)

    for make in (gone, folder, link):
        for way in (_read, _gone_on):
            partly = way is _read and make is gone and name.startswith("chunk")  # it is told apart as not run yet
            act = _partly if partly else way
            yield Try(
                f"{way.__name__.strip('_')} {name}: {make.__name__}", lambda act=act: act(store, whole), (store,), prepare=make
            )


def _partly(store: Path, whole) -> None:
    found = open_sweep(store)
    there = found["verdict"].values != "not run yet"
    if there.sum() != LANES - CHUNK or not np.array_equal(found["square"].values[there], whole["square"].values[there]):
        raise WrongError("a store without a chunk is read as another one")


def _texts(place, store, whole, definition: bytes) -> Iterator[Try]:
    """Every entry of the definition with a value of another kind."""
    tree = json.loads(definition)
    for path in _paths(tree):
        for value in ("text", None, -1, 1e400, [], {}, True, "9" * 5000, [[[[]]]]):
            data = json.dumps(_changed(tree, path, value)).encode()
            if data != json.dumps(tree).encode():
                said = f"definition {'.'.join(map(str, path))} = {str(value)[:20]}"
                yield Try(
                    said, lambda: _read(store, whole), (store,), REFUSED, prepare=_writes(store / "definition.json", data)
                )


def _writes(path: Path, data: bytes) -> Callable[[], object]:
    return lambda: path.write_bytes(data)


def _paths(tree, path=()) -> Iterator[tuple]:
    entries = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in entries:
        yield (*path, key)
        yield from _paths(value, (*path, key))


def _changed(tree, path, value):
    key, *rest = path
    copy = dict(tree) if isinstance(tree, dict) else list(tree)
    copy[key] = _changed(tree[key], rest, value) if rest else value
    return copy
