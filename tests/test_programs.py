"""Programs kept between processes: found by what they were traced from, computing the same, and never another's; and forgotten
before they crash their own."""

import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax import compilation, programs
from scan2flex_jax.examples import example_path
from scan2flex_jax.rod import energy


class Memory(dict):
    """Entries of a dictionary."""

    def put(self, key, value):
        self[key] = value


class Foreign(eqx.Module):
    """A value of a class that the package does not define."""

    by: float = eqx.field(static=True)


TRACED = []
MAPPED = Path("/proc/self/maps")


def scaled(x, by, more=None):
    TRACED.append(by)
    factor = by.by if isinstance(by, Foreign) else by
    return {"scaled": factor * x["a"], "name": "kept", "more": None if more is None else jnp.sum(more)}


def asks_python(x):
    TRACED.append("python")
    return jax.pure_callback(np.sin, x, x)


@pytest.fixture(autouse=True)
def _of_the_package(monkeypatch):
    TRACED.clear()
    for function in (scaled, asks_python):
        monkeypatch.setattr(function, "__module__", "scan2flex_jax.somewhere")


def called(entries, function, *args, version=b"1", **kwargs):
    """The result in a process of its own, as far as programs are concerned."""
    return programs.Programs(entries, version).call(function, {}, args, kwargs)


def test_a_later_process_computes_the_same_without_tracing():
    entries, x = Memory(), {"a": jnp.arange(3.0)}
    results = [called(entries, scaled, x, 2.0, more=np.ones(4)) for _ in range(3)]
    assert TRACED == [2.0] and len(entries) == 1
    for result in results:
        assert result["name"] == "kept" and result["more"] == 4.0
        np.testing.assert_array_equal(result["scaled"], [0.0, 2.0, 4.0])


@pytest.mark.parametrize(
    ("other", "version"),
    [
        (({"a": jnp.ones(3)}, 3.0), b"1"),
        (({"a": jnp.ones(4)}, 2.0), b"1"),
        (({"a": jnp.ones(3, jnp.float32)}, 2.0), b"1"),
        (({"a": jnp.ones(3), "b": None}, 2.0), b"1"),
        (({"a": jnp.ones(3), "b": jnp.ones(())}, 2.0), b"1"),
        (({"a": jnp.ones(3)}, 2.0), b"2"),
    ],
    ids=["value", "shape", "type", "field", "array", "version"],
)
def test_another_value_shape_type_structure_or_version_is_another_program(other, version):
    entries = Memory()
    called(entries, scaled, {"a": jnp.ones(3)}, 2.0)
    called(entries, scaled, *other, version=version)
    assert len(TRACED) == len(entries) == 2


def test_a_custom_call_that_a_process_does_not_have_is_another_program(monkeypatch):
    entries = Memory()
    for name in (None, "of_xla", "another_of_xla", None):
        monkeypatch.setattr(programs, "CUSTOM_CALLS", [lambda name=name: name])
        called(entries, scaled, {"a": jnp.ones(3)}, 2.0)
    assert len(TRACED) == len(entries) == 3


def closing(factor):
    def inner(x):
        return factor * x

    inner.__module__ = "scan2flex_jax.somewhere"
    return inner


@pytest.mark.parametrize(
    ("function", "args"),
    [
        (scaled, ({"a": jnp.ones(3)}, Foreign(2.0))),
        (asks_python, (jnp.ones(3),)),
        (closing(2.0), (jnp.ones(3),)),
        (energy.potential_energy.__get__(1), (jnp.ones(3),)),
        (partial, (jnp.ones(3),)),
    ],
    ids=["a class of the user's", "a call of Python", "a closure", "a bound method", "a function of others"],
)
def test_what_is_not_all_in_the_key_is_not_kept(function, args):
    entries = Memory()
    here = programs.Programs(entries, b"1")
    for _ in range(3):
        with pytest.raises(programs.UnkeptError):
            here.call(function, {}, args, {})
    assert not entries and len(TRACED) <= 1, "refused anew at every call"


@pytest.mark.slow
def test_a_second_command_traces_nothing_and_answers_the_same(tmp_path):
    environment = os.environ | {"SCAN2FLEX_CACHE": str(tmp_path / "cache")}
    command = [sys.executable, "-c", "from scan2flex_jax.cli import main; main()"]
    words = [*command, "fit", str(example_path("simulated-cable")), "--json"]
    answers, kept = [], []
    for k in range(2):
        out = tmp_path / f"{k}.json"
        done = subprocess.run([*words, str(out)], env=environment, capture_output=True, text=True, timeout=300, check=False)
        assert done.returncode == 0, done.stderr
        answers.append([line for line in done.stdout.splitlines() if " s" not in line and "json" not in line])
        kept.append({p.name: p.stat().st_mtime_ns for p in (tmp_path / "cache").glob("program-*")})
    assert answers[0] == answers[1]
    assert len(kept[0]) >= 4 and kept[0] == kept[1]


@pytest.mark.skipif(not MAPPED.exists(), reason="memory mappings are counted on Linux only")
def test_what_is_forgotten_gives_its_mappings_back_and_is_compiled_anew():
    @compilation.compiled
    def power(x, n):
        for _ in range(10):
            x = jnp.sin(x) @ x + n
        return x

    def mappings():
        return len(MAPPED.read_bytes().splitlines())

    before = mappings()
    found = [power(jnp.ones((3, 3)), n) for n in range(6)]
    held = mappings() - before
    assert compilation.make_room(full=0.0)
    assert mappings() - before < 0.2 * held
    assert jnp.array_equal(power(jnp.ones((3, 3)), 5), found[5])
