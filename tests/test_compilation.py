"""Compiled functions are forgotten before they crash the process."""

import jax
import jax.numpy as jnp
import pytest

from scan2flex_jax import compilation


@pytest.fixture
def counted():
    """A compiled function, and how often it was traced."""
    traced = []

    @compilation.compiled
    def double(x):
        traced.append(x)
        return 2.0 * x

    return double, traced


def test_nothing_is_forgotten_while_there_is_room(counted, monkeypatch, tmp_path):
    double, traced = counted
    for name, text in (("_MAPPED", "one\ntwo\n"), ("_LIMIT", "10\n")):
        (tmp_path / name).write_text(text)
        monkeypatch.setattr(compilation, name, tmp_path / name)
    double(jnp.ones(3))
    assert not compilation.make_room()
    double(jnp.ones(3))
    assert len(traced) == 1


def test_a_full_process_compiles_anew_and_computes_the_same(counted, monkeypatch, tmp_path):
    double, traced = counted
    for name, text in (("_MAPPED", "mapping\n" * 8), ("_LIMIT", "10\n")):
        (tmp_path / name).write_text(text)
        monkeypatch.setattr(compilation, name, tmp_path / name)
    theirs = jax.jit(lambda x: traced.append("theirs") or x)
    before, _ = double(jnp.ones(3)), theirs(jnp.ones(3))
    assert compilation.make_room()
    assert jnp.array_equal(double(jnp.ones(3)), before)
    theirs(jnp.ones(3))
    assert len(traced) == 3
    assert traced.count("theirs") == 1, "a function of the caller was forgotten"


def test_what_is_forgotten_gives_its_mappings_back():
    if not compilation._MAPPED.exists():
        pytest.skip("memory mappings are counted on Linux only")

    @compilation.compiled
    def power(x, n):
        for _ in range(10):
            x = jnp.sin(x) @ x + n
        return x

    def mappings():
        return len(compilation._MAPPED.read_bytes().splitlines())

    before = mappings()
    for n in range(10):
        power(jnp.ones((3, 3)), n)
    held = mappings() - before
    assert compilation.make_room(full=0.0)
    assert mappings() - before < 0.2 * held


def test_elsewhere_than_on_linux_nothing_is_done(monkeypatch, tmp_path):
    monkeypatch.setattr(compilation, "_MAPPED", tmp_path / "absent")
    assert not compilation.make_room()
