"""Poses on several threads: the same numbers as on one, and the caller's settings of JAX."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from scan2flex_jax import fit
from scan2flex_jax.fitting import threads
from scan2flex_jax.fitting.threads import each_pose, threaded
from tests.fitting.scenes import example


@pytest.fixture(params=[1, 4], ids=["one core", "four cores"])
def cores(request, monkeypatch):
    monkeypatch.setattr(threads, "_cores", lambda: request.param)
    return request.param


def test_order_and_exceptions_are_those_of_a_loop(cores):
    def work(i):
        if i in (5, 7):
            raise ValueError(f"pose {i}")
        return i

    assert threaded(lambda: each_pose(work, 5))() == each_pose(work, 5) == [0, 1, 2, 3, 4]
    with pytest.raises(ValueError, match="pose 5"):
        threaded(lambda: each_pose(work, 9))()


@pytest.mark.parametrize("precise", [True, False])
def test_threads_have_the_precision_that_the_caller_chose_for_his_own(monkeypatch, precise):
    monkeypatch.setattr(threads, "_cores", lambda: 4)
    with jax.enable_x64(precise):
        found = threaded(lambda: each_pose(lambda i: jnp.zeros(1).dtype, 4))()
    assert set(found) == {jnp.dtype(jnp.float64 if precise else jnp.float32)}


def test_a_fit_is_the_same_on_one_core_and_on_four(monkeypatch):
    answers = []
    for count in (1, 4):
        monkeypatch.setattr(threads, "_cores", lambda count=count: count)
        found = fit(example())
        answers.append((found.estimates, found.minimum.evaluation.residual))
    assert answers[0][0] == answers[1][0]
    np.testing.assert_array_equal(answers[0][1], answers[1][1])
