"""Side effects of a call of `explain`: none."""

import threading

import jax
import jax.numpy as jnp
import pytest

from scan2flex_jax.inference import explain

from . import scenes


@pytest.mark.slow
def test_a_whole_explanation_leaves_threads_and_compiled_functions_as_they_were():
    traced = []

    @jax.jit
    def own(x):
        traced.append(x)
        return 2.0 * x

    own(jnp.ones(3))
    before, said = threading.enumerate(), []
    explain(scenes.case("t001"), elements=40, mesh=False, progress=said.append)
    own(jnp.ones(3))
    assert len(traced) == 1
    assert threading.enumerate() == before
    assert said[0] == "baseline fit" and said[-1] == "before and after"
