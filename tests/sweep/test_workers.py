"""A sweep on the workers of a dask client is the sweep of this process, also if workers are lost on the way."""

import logging
import os
import signal

import dask
import numpy as np
import pytest
from distributed import Client, LocalCluster

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.sweep import Output, Task, grid, sweep

from . import scenes
from .test_store import same

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def client():
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 1}),
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=logging.CRITICAL) as cluster,
        Client(cluster) as client,
    ):
        yield client


def test_equilibria_of_workers_are_those_of_this_process(client, tmp_path):
    task = scenes.hanging_cables()
    found = sweep(task, scenes.CLAMPS_APART, client=client, store=tmp_path / "s", chunk=2)
    here = sweep(task, scenes.CLAMPS_APART, chunk=2)
    np.testing.assert_array_equal(found["code"], here["code"])
    for name in scenes.QUANTITIES:  # compiled with other options than in a test
        np.testing.assert_allclose(found[name], here[name], rtol=1e-6, atol=1e-9)


def test_a_worker_that_dies_in_the_middle(client, tmp_path):
    """It is killed at its tenth sample; another worker computes its chunk, and each finished one is there once."""
    task, samples = scenes.squares(tmp_path / "note", 0.02)
    pids = list(client.run(os.getpid).values())

    def kill_one(line):
        if pids and int(line.split()[0]) >= 10:
            os.kill(pids.pop(), signal.SIGKILL)
            pids.clear()

    found = sweep(task, samples, client=client, store=tmp_path / "s", chunk=4, progress=kill_one)
    assert not pids
    same(found, sweep(*scenes.squares()))
    client.wait_for_workers(2, timeout=60)


def test_a_sample_that_ends_every_worker_is_one_sentence(client, tmp_path):
    def deadly(sample):
        if sample["x"] == 3:
            os.kill(os.getpid(), signal.SIGKILL)
        return {"y": sample["x"]}

    with pytest.raises(Scan2FlexError, match="workers were lost again and again"):
        sweep(Task(deadly, {"y": Output()}), grid(x=np.arange(4.0)), client=client, chunk=1)
    client.wait_for_workers(2, timeout=60)


def test_what_no_worker_can_be_given_is_one_sentence(client):
    with pytest.raises(Scan2FlexError, match="cannot be sent to a worker"):
        sweep(Task(lambda sample: {"y": client}, {"y": Output()}), grid(x=[1.0]), client=client)
    with pytest.raises(Scan2FlexError, match="give a dask"):
        sweep(*scenes.squares(), client="tcp://127.0.0.1:8786")
