"""The same sweep over several processes that share a store."""

import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from scan2flex_jax.sweep import open_sweep, sweep

from . import scenes

ROOT = Path(__file__).parents[2]
HEAD = """
import sys
from pathlib import Path
import jax
jax.config.update("jax_enable_x64", True)
from scan2flex_jax.sweep import sweep
from tests.sweep import scenes
"""
PROCESS = (
    HEAD
    + """
store, note, address, me = sys.argv[1:]
jax.distributed.initialize(address, num_processes=2, process_id=int(me), heartbeat_timeout_seconds=20)
assert jax.process_count() == 2
task, lanes = scenes.squares(Path(note), 0.05)
found = sweep(task, lanes, store=store, chunk=2)
assert int((found["code"] == 0).sum()) == lanes.count
"""
)


def run(code, *arguments):
    return subprocess.Popen([sys.executable, "-c", code, *map(str, arguments)], cwd=ROOT)


def free_address():
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{s.getsockname()[1]}"


def test_two_shares_make_the_whole(tmp_path):
    """Shares without a runtime between them: each does its own chunks, the one that is done goes on with what is missing."""
    lanes = scenes.squares()[1]
    notes = [tmp_path / "0", tmp_path / "1"]
    found = sweep(scenes.squares(notes[0])[0], lanes, store=tmp_path / "s", chunk=4, share=(0, 2))
    assert int((found["code"] == 0).sum()) == lanes.count  # nobody else came
    order = [float(x) for x in notes[0].read_text().split()]
    assert order[4:8] == [8.0, 9.0, 10.0, 11.0]  # its second chunk is the third
    sweep(scenes.squares(notes[1])[0], lanes, store=tmp_path / "s", chunk=4, share=(1, 2))
    assert not notes[1].exists()


@pytest.mark.slow
def test_two_processes_and_one_that_is_lost(tmp_path):
    """`jax.distributed` on the loopback address; after one is killed the other, or the next start, finishes."""
    store, notes = tmp_path / "s", [tmp_path / "0", tmp_path / "1"]
    address = free_address()
    both = [run(PROCESS, store, note, address, i) for i, note in enumerate(notes)]
    while not (notes[1].exists() and len(notes[1].read_text().split()) > 4):
        assert all(p.poll() is None for p in both)
        time.sleep(0.02)
    both[1].send_signal(signal.SIGKILL)
    kept = {path.name: path.read_bytes() for path in store.glob("chunk-*.nc")}
    assert len(kept) >= 2
    both[1].wait()
    both[0].wait(timeout=300)  # it finishes alone, or the runtime ends it when it misses the other
    assert kept.items() <= {path.name: path.read_bytes() for path in store.glob("chunk-*.nc")}.items()
    address = free_address()
    both = [run(PROCESS, store, note, address, i) for i, note in enumerate(notes)]
    assert [p.wait(timeout=300) for p in both] == [0, 0]
    assert kept.items() <= {path.name: path.read_bytes() for path in store.glob("chunk-*.nc")}.items()
    found, lanes = open_sweep(store), scenes.squares()[1]
    assert int((found["code"] == 0).sum()) == lanes.count
    np.testing.assert_array_equal(found["square"], found["x"] ** 2)
    assert (store / "sweep.nc").exists()
