"""A sweep on disk: it goes on from where it was killed, with the same result, and is never taken for another one."""

import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.sweep import Axis, Calls, Output, equilibria, failed, grid, open_sweep, sweep

from . import scenes

CHUNK, COUNT, PAUSE = 4, 40, 0.02
SCRIPT = """
import sys
from pathlib import Path
import jax
jax.config.update("jax_enable_x64", True)
from scan2flex_jax.sweep import sweep
from tests.sweep import scenes
task, lanes = scenes.squares(Path(sys.argv[2]), float(sys.argv[3]), int(sys.argv[4]))
sweep(task, lanes, store=sys.argv[1], chunk=int(sys.argv[5]))
"""


def same(a, b):
    xr.testing.assert_identical(a.drop_vars("seconds"), b.drop_vars("seconds"))


def start(store, note):
    arguments = [str(x) for x in (store, note, PAUSE, COUNT, CHUNK)]
    return subprocess.Popen([sys.executable, "-c", SCRIPT, *arguments], cwd=Path(__file__).parents[2])


def killed_in_the_middle(store, note, after):
    """A run that is killed ``after`` seconds of its lanes; how many lanes it had begun."""
    before = len(note.read_text().split()) if note.exists() else 0
    process = start(store, note)
    while process.poll() is None and (len(note.read_text().split()) if note.exists() else 0) == before:
        time.sleep(0.005)
    time.sleep(after)
    process.send_signal(signal.SIGKILL)
    process.wait()


def kill_and_resume(folder, moments):
    store, note = folder / "store", folder / "note"
    kept = {}
    for after in moments:
        killed_in_the_middle(store, note, after)
        whole = {path.name: path.read_bytes() for path in store.glob("chunk-*.nc")}
        assert kept.items() <= whole.items()  # nothing that was kept is lost or touched
        kept = whole
        partial = open_sweep(store)
        done = partial["code"].values == 0
        assert done.sum() == len(whole) * CHUNK and set(partial["verdict"].values[~done]) <= {"not run yet"}
        np.testing.assert_array_equal(partial["square"].values[done], np.arange(COUNT)[done] ** 2.0)
    assert start(store, note).wait() == 0
    same(open_sweep(store), sweep(*scenes.squares(count=COUNT), chunk=CHUNK))
    ran = len(note.read_text().split())
    assert COUNT <= ran <= COUNT + CHUNK * len(moments)  # at most the chunk under way was run again
    same(xr.load_dataset(store / "sweep.nc"), open_sweep(store))


def test_a_killed_sweep_goes_on(tmp_path):
    kill_and_resume(tmp_path, [random.uniform(0.1, 0.6)])


def test_stored_and_not_stored_are_the_same(tmp_path):
    task, lanes = scenes.squares()
    stored = sweep(task, lanes, store=tmp_path / "s", chunk=7)
    same(stored, sweep(task, lanes))
    note = tmp_path / "note"
    same(sweep(scenes.squares(note)[0], lanes, store=tmp_path / "s", chunk=7), stored)
    assert not note.exists()  # everything was there: no lane was run
    (tmp_path / "s" / "chunk-00002.nc").unlink()
    same(sweep(scenes.squares(note)[0], lanes, store=tmp_path / "s", chunk=7), stored)
    assert len(note.read_text().split()) == 7


def test_a_sweep_that_stops_in_time_goes_on_later(tmp_path):
    task, lanes = scenes.squares()
    part = sweep(task, lanes, store=tmp_path / "s", chunk=7, longest=-1.0)
    assert set(part["verdict"].values) == {"not run yet"} and len(failed(part)) == lanes.count
    assert not (tmp_path / "s" / "sweep.nc").exists()
    same(sweep(task, lanes, store=tmp_path / "s", chunk=7, longest=60.0), sweep(task, lanes))


def test_equilibria_in_a_store_are_the_same_after_resuming(tmp_path):
    task = scenes.hanging_cables()
    whole = sweep(task, scenes.CLAMPS_APART, store=tmp_path / "s", chunk=2)
    for k in (0, 2):
        (tmp_path / "s" / f"chunk-{k:05d}.nc").unlink()
    same(sweep(task, scenes.CLAMPS_APART, store=tmp_path / "s", chunk=2), whole)


def refused(store, task, lanes, said, **more):
    with pytest.raises(Scan2FlexError, match=said) as error:
        sweep(task, lanes, store=store, **more)
    assert "\n" not in str(error.value)


def test_another_sweep_is_refused(tmp_path):
    task, lanes = scenes.squares()
    sweep(task, lanes, store=tmp_path / "s")
    refused(tmp_path / "s", task, grid(x=Axis([1.0, 2.0], "m")), "its lanes differ")
    refused(tmp_path / "s", task, grid(x=Axis(np.arange(40.0), "km")), "its lanes differ")
    refused(tmp_path / "s", Calls(lambda lane: {"square": 1.0}, {"square": Output()}), lanes, "its function differ")
    refused(tmp_path / "s", task, lanes, "another sweep", chunk=3)
    refused(tmp_path / "s", task, lanes, "order of lanes differ", cost=np.arange(40.0))


def test_edited_code_is_another_sweep_though_its_call_reads_the_same(tmp_path):
    """The cell of a notebook with another number in it: no key and no array of the call says so."""

    def task(tilt):
        return equilibria(lambda lane: (lane["model"], lane["boundary"], tilt))

    lanes = grid(x=Axis([1.0, 2.0], "m"))
    sweep(task(0.1), lanes, store=tmp_path / "s", longest=-1.0)  # begun: no lane is solved
    sweep(task(0.1), lanes, store=tmp_path / "s", longest=-1.0)
    refused(tmp_path / "s", task(0.2), lanes, "its scene differ")


def test_folders_that_hold_no_sweep(tmp_path):
    task, lanes = scenes.squares()
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.tex").write_text("")
    refused(tmp_path / "other", task, lanes, "thesis.tex and no sweep")
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "definition.json").write_text("{")
    refused(tmp_path / "broken", task, lanes, "cannot be read as the definition")
    (tmp_path / "broken" / "definition.json").write_text('{"format": "x"}')
    refused(tmp_path / "broken", task, lanes, "format is not")
    (tmp_path / "file").write_text("")
    refused(tmp_path / "file", task, lanes, "file")
    with pytest.raises(Scan2FlexError, match="cannot be read"):
        open_sweep(tmp_path / "nowhere")


def test_damaged_and_foreign_chunks(tmp_path):
    task, lanes = scenes.squares()
    sweep(task, lanes, store=tmp_path / "s", chunk=20)
    chunk = tmp_path / "s" / "chunk-00001.nc"
    chunk.write_bytes((tmp_path / "s" / "chunk-00000.nc").read_bytes())
    refused(tmp_path / "s", task, lanes, "belongs to another sweep", chunk=20)


def _flipped(data):
    """Thirty copies, each with one bit turned, spread over the whole file."""
    for place in np.linspace(0, 8 * len(data) - 1, 30).astype(int):
        copy = bytearray(data)
        copy[place // 8] ^= 1 << (place % 8)
        yield bytes(copy)


def _with_nan(data):
    return data.replace(np.array(2.0, ">f8").tobytes(), np.array(np.nan, ">f8").tobytes())


@pytest.mark.parametrize("name", ["definition.json", "lanes.nc", "chunk-00001.nc"])
def test_no_byte_of_a_store_changes_in_silence(tmp_path, name):
    store = tmp_path / "s"
    sweep(*scenes.squares(), store=store, chunk=20)
    whole = (store / name).read_bytes()
    changed = [*_flipped(whole), 2 * whole, b"", whole[: len(whole) // 2]]
    for data in [*changed, *([_with_nan(whole)] if name == "lanes.nc" else [])]:
        assert data != whole
        (store / name).write_bytes(data)
        with pytest.raises(Scan2FlexError, match=name) as error:
            open_sweep(store)
        assert "\n" not in str(error.value)
    (store / name).write_bytes(whole)
    same(open_sweep(store), sweep(*scenes.squares(), chunk=20))


@pytest.mark.parametrize("damage", [lambda data: data[:100], lambda data: b"", lambda data: 2 * data, _with_nan])
def test_a_damaged_chunk_is_said_and_computed_anew(tmp_path, damage):
    store, note = tmp_path / "s", tmp_path / "note"
    whole = sweep(*scenes.squares(), store=store, chunk=4)
    chunk = store / "chunk-00000.nc"
    chunk.write_bytes(damage(chunk.read_bytes()))
    with pytest.warns(UserWarning, match=r"chunk-00000\.nc: it is damaged .* computed anew"):
        same(sweep(*scenes.squares(note), store=store, chunk=4), whole)
    assert len(note.read_text().split()) == 4  # its lanes, and no others
    same(open_sweep(store), whole)


def test_text_where_numbers_belong_and_stores_of_earlier_versions(tmp_path):
    sweep(*scenes.squares(), store=tmp_path / "s")
    file = tmp_path / "s" / "definition.json"
    definition = file.read_text()
    for old, new, said in (('"chunk": 8', '"chunk": "eight"', "damaged"), ("sweep/2", "sweep/1", r"read its sweep\.nc")):
        assert old in definition
        file.write_text(definition.replace(old, new))
        with pytest.raises(Scan2FlexError, match=said) as error:
            open_sweep(tmp_path / "s")
        assert "\n" not in str(error.value)
        refused(tmp_path / "s", *scenes.squares(), said)
