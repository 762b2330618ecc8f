"""Compiled functions are forgotten before they crash the process, and give the same afterwards."""

from pathlib import Path

import jax.numpy as jnp
import pytest

from scan2flex_jax import compilation

MAPPED = Path("/proc/self/maps")


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
