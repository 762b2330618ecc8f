"""Entries of the cache of compiled functions, damaged and exchanged; several processes on one cache."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.attacks import scene
from benchmarks.attacks.attempt import WORKED, Place, Try, WrongError
from benchmarks.attacks.process import PATIENCE, environment, said, start
from benchmarks.attacks.stores import damaged
from scan2flex_jax.cli.cache import Entries

KEYS = ("one", "two")
SCRIPT = """
from scan2flex_jax.cli.setup import prepare_jax
prepare_jax()
import jax, jax.numpy as jnp
jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
print(float(jax.jit(lambda x: jnp.linalg.inv(x) @ jnp.cos(x))(jnp.eye(3)).trace()))
"""
RIGHT = 3.0 * np.cos(1.0)


def tries(place: Place, rng: np.random.Generator) -> Iterator[Try]:
    """Entries by themselves, then processes that find a whole cache damaged, or share one."""
    folder = place.root / "cache"
    values = {key: rng.bytes(3000) for key in KEYS}
    for key, value in values.items():
        Entries(folder).put(key, value)
    original = {path.name: path.read_bytes() for path in folder.iterdir()}
    for key in KEYS:
        file = folder / f"{key}-checked"
        changes = [
            *damaged(original[file.name], rng),
            *((f"entry {other}", data) for other, data in original.items() if other != file.name),
        ]
        for name, data in changes:
            yield Try(
                f"{key}: {name}",
                partial(_own_or_none, folder, values, key),
                (folder,),
                WORKED,
                prepare=partial(file.write_bytes, data),
            )
        for make in (_folder, _pipe, _loop, _elsewhere):
            yield Try(
                f"{key}: {make.__name__}",
                partial(_own_or_none, folder, values, key),
                (folder,),
                WORKED,
                prepare=partial(make, file),
            )
    yield from _processes(place, rng)


def _own_or_none(folder: Path, values: dict[str, bytes], key: str) -> None:
    """A key finds its own value or none, and a new one is kept; no other key is touched."""
    entries = Entries(folder)
    if entries.get(key) not in (None, values[key]):
        raise WrongError(f"another value than was put: {key}")
    entries.put(key, b"new")
    if (folder / f"{key}-checked").is_file() and entries.get(key) != b"new":
        raise WrongError(f"a value that was put is not found: {key}")
    if any(entries.get(other) != values[other] for other in KEYS if other != key):
        raise WrongError(f"another entry was lost: {key}")


def _folder(file: Path) -> None:
    file.unlink()
    file.mkdir()


def _pipe(file: Path) -> None:
    file.unlink()
    os.mkfifo(file)


def _loop(file: Path) -> None:
    file.unlink()
    file.symlink_to(file)


def _elsewhere(file: Path) -> None:
    file.unlink()
    file.symlink_to("/dev/zero")


def _processes(place: Place, rng: np.random.Generator) -> Iterator[Try]:
    cache = place.root / "whole"
    ways: dict[str, Callable[[bytes], bytes]] = {
        "as it is": lambda data: data,
        "cut": lambda data: data[: len(data) // 2],
        "empty": lambda data: b"",
        "random": lambda data: rng.bytes(len(data)),
        "one bit turned": lambda data: data[:200] + bytes([data[200] ^ 4]) + data[201:],
        "doubled": lambda data: 2 * data,
        "text": lambda data: b"text",
    }
    for name, way in ways.items():
        yield Try(
            f"a cache whose entries are {name}",
            partial(_computed, cache),
            (cache,),
            WORKED,
            prepare=partial(_filled, cache, way),
        )
    yield Try(
        "a cache whose entries are exchanged", partial(_computed, cache), (cache,), WORKED, prepare=partial(_exchanged, cache)
    )
    study, out = place.root / "study", place.root / "out"
    for name in ("cold", "damaged"):
        prepare = partial(_shared, study, cache, name == "damaged")
        yield Try(f"two processes on one {name} cache", partial(_two, study, cache, out), (cache, out), WORKED, prepare=prepare)


def _computed(cache: Path) -> None:
    """The right answer, and not a word."""
    command, env = [sys.executable, "-c", SCRIPT], environment(SCAN2FLEX_CACHE=cache)
    found = subprocess.run(command, env=env, capture_output=True, text=True, timeout=PATIENCE, check=False)
    if found.returncode or found.stderr or not np.isclose(float(found.stdout), RIGHT):
        raise WrongError(f"a damaged cache is noticed: {found.returncode}, {found.stdout[-100:]}, {found.stderr[-400:]}")


def _filled(cache: Path, way: Callable[[bytes], bytes]) -> None:
    _computed(cache)
    for path in sorted(cache.iterdir()):
        path.write_bytes(way(path.read_bytes()))


def _exchanged(cache: Path) -> None:
    """Every entry holds what was put under the next key."""
    _computed(cache)
    files = sorted(cache.iterdir())
    contents = [path.read_bytes() for path in files]
    for path, data in zip(files, [*contents[1:], contents[0]], strict=True):
        path.write_bytes(data)


def _shared(study: Path, cache: Path, harmed: bool) -> None:
    scene.write(study)
    if harmed:
        _filled(cache, lambda data: data[: len(data) // 2])


def _two(study: Path, cache: Path, out: Path) -> None:
    """Two simulations at the same time say the same."""
    env = environment(SCAN2FLEX_CACHE=cache)
    both = [start("simulate", study, "--out", out / str(i), "--elements", scene.ELEMENTS, env=env) for i in range(2)]
    for process in both:
        said(process)
    files = [{path.name: path.read_bytes() for path in (out / str(i)).glob("*.csv")} for i in range(2)]
    if files[0] != files[1] or len(files[0]) != 4:
        raise WrongError("two processes on one cache compute different things")
