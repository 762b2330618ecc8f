"""A sweep on disk: it goes on from where it was killed, with the same result, and is never taken for another one."""

import random
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study import load_study
from scan2flex_jax.sweep import Output, Task, equilibria, failed, fits, grid, open_sweep, sweep
from tests.fitting import scenes as studies

from . import scenes

CHUNK, COUNT, PAUSE = 4, 40, 0.02
SCRIPT = """
import sys
from pathlib import Path
import jax
jax.config.update("jax_enable_x64", True)
from scan2flex_jax.sweep import sweep
from tests.sweep import scenes
task, samples = scenes.squares(Path(sys.argv[2]), float(sys.argv[3]), int(sys.argv[4]))
sweep(task, samples, store=sys.argv[1], chunk=int(sys.argv[5]))
"""


def same(a, b):
    xr.testing.assert_identical(a.drop_vars("seconds"), b.drop_vars("seconds"))


def lines(note):
    return len(note.read_text().split()) if note.exists() else 0


def start(store, note):
    arguments = [str(x) for x in (store, note, PAUSE, COUNT, CHUNK)]
    return subprocess.Popen([sys.executable, "-c", SCRIPT, *arguments], cwd=Path(__file__).parents[2])


def kill_and_resume(folder, moments):
    """Runs that are killed so many seconds after their first sample, then one that is not."""
    store, note, kept = folder / "store", folder / "note", np.zeros(COUNT, bool)
    for after in moments:
        before, process = lines(note), start(store, note)
        while process.poll() is None and lines(note) == before:
            time.sleep(0.005)
        time.sleep(after)
        process.kill()
        process.wait()
        partial = open_sweep(store)
        done = partial["code"].values == 0
        assert np.all(done[kept])  # nothing that was kept is lost
        assert set(partial["verdict"].values[~done]) <= {"not run yet"} and np.all(np.isnan(partial["square"].values[~done]))
        np.testing.assert_array_equal(partial["square"].values[done], np.arange(COUNT)[done] ** 2.0)
        kept = done
    assert start(store, note).wait() == 0
    same(open_sweep(store), sweep(*scenes.squares(count=COUNT)))
    assert COUNT <= lines(note) <= COUNT + CHUNK * len(moments)  # at most the chunk under way was run again


def test_a_killed_sweep_goes_on(tmp_path):
    kill_and_resume(tmp_path, [random.uniform(0.1, 0.6)])


@pytest.mark.slow
def test_a_sweep_killed_at_ten_moments(tmp_path):
    kill_and_resume(tmp_path, [random.uniform(0.0, 0.2) for _ in range(10)])


def test_stored_and_not_stored_are_the_same(tmp_path):
    store, note = tmp_path / "s", tmp_path / "note"
    whole = sweep(*scenes.squares())
    same(sweep(*scenes.squares(), store=store, chunk=7), whole)
    same(sweep(*scenes.squares(note), store=store), whole)  # in the chunks of the store
    assert not note.exists()  # everything was there: no sample was run
    (store / "code" / "c" / "2").unlink()
    same(sweep(*scenes.squares(note), store=store), whole)
    assert lines(note) == 7
    read = xr.open_zarr(store, consolidated=False).load()  # as any reader of zarr
    np.testing.assert_array_equal(read["powers"], whole["powers"])
    assert read["square"].dims == ("x",) and read["square"].units == "m^2" and read["x"].units == "m"


def test_a_sweep_that_stops_in_time_goes_on_later(tmp_path):
    task, samples = scenes.squares()
    part = sweep(task, samples, store=tmp_path / "s", chunk=7, longest=-1.0)
    assert set(part["verdict"].values[7:]) == {"not run yet"} and len(failed(part)) == 33
    same(open_sweep(tmp_path / "s"), part)
    same(sweep(task, samples, store=tmp_path / "s", chunk=7, longest=60.0), sweep(task, samples))


def test_equilibria_in_a_store_are_the_same_after_resuming(tmp_path):
    task = scenes.hanging_cables()
    whole = sweep(task, scenes.CLAMPS_APART, store=tmp_path / "s", chunk=2)
    chunks = sorted(p for p in (tmp_path / "s" / "code" / "c").rglob("*") if p.is_file())
    for chunk in (chunks[0], chunks[-1]):
        chunk.unlink()
    same(sweep(task, scenes.CLAMPS_APART, store=tmp_path / "s", chunk=2), whole)


def refused(store, task, samples, said):
    with pytest.raises(Scan2FlexError, match=said) as error:
        sweep(task, samples, store=store)
    assert "\n" not in str(error.value)


def test_another_sweep_is_refused(tmp_path):
    task, samples = scenes.squares()
    sweep(task, samples, store=tmp_path / "s")
    refused(tmp_path / "s", task, grid(x=([1.0, 2.0], "m")), "not the same .*samples")
    refused(tmp_path / "s", task, grid(x=(np.arange(40.0), "km")), "not the same .*samples")
    refused(tmp_path / "s", task, grid(y=(np.arange(40.0), "m")), "not the same .*samples")
    refused(tmp_path / "s", replace(task, outputs={**task.outputs, "more": Output()}), samples, "not the same .*outputs")
    refused(tmp_path / "s", replace(task, about={"function": "cubes"}), samples, "not the same .*function")


def test_another_study_is_refused_and_the_same_one_elsewhere_is_not(tmp_path):
    study, samples = studies.example(), grid(guess_nothing=[1.0])  # a guess for nothing: refused at once
    sweep(fits(study), samples, store=tmp_path / "s")
    shutil.copytree(study.folder, tmp_path / "moved")
    sweep(fits(load_study(tmp_path / "moved")), samples, store=tmp_path / "s")
    refused(tmp_path / "s", fits(replace(study, poses=study.fit_poses)), samples, "not the same .*study")
    refused(tmp_path / "s", fits(study, elements=50), samples, "not the same .*options")


def test_edited_code_is_another_sweep_though_its_call_reads_the_same(tmp_path):
    """The cell of a notebook with another number in it: no key and no array of the call says so."""

    def task(tilt):
        def scene(sample):
            return sample["model"], sample["boundary"], tilt

        return equilibria(scene)

    def begun(task):  # no sample is solved: the scene cannot be
        with pytest.raises(KeyError):
            sweep(task, grid(x=[1.0, 2.0]), store=tmp_path / "s")

    begun(task(0.1))
    begun(task(0.1))
    refused(tmp_path / "s", task(0.2), grid(x=[1.0, 2.0]), "not the same scene")
    refused(tmp_path / "s", Task(lambda sample: {"y": 1.0}, {"y": Output()}), grid(x=[1.0, 2.0]), "another")


def test_folders_that_hold_no_sweep(tmp_path):
    task, samples = scenes.squares()
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "thesis.tex").write_text("")
    refused(tmp_path / "other", task, samples, "thesis.tex and no sweep")
    xr.Dataset({"a": ("x", [1.0])}).to_zarr(tmp_path / "theirs", zarr_format=3, consolidated=False)
    refused(tmp_path / "theirs", task, samples, "no sweep")
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "zarr.json").write_text("{")
    refused(tmp_path / "broken", task, samples, "cannot be read or written")
    (tmp_path / "file").write_text("")
    refused(tmp_path / "file", task, samples, "file")
    with pytest.raises(Scan2FlexError, match="holds no sweep"):
        open_sweep(tmp_path / "nowhere")


def flipped(data):
    at = len(data) // 2
    return data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]


@pytest.mark.parametrize("damage", [flipped, lambda data: data[:20], lambda data: b"", lambda data: 2 * data, None])
def test_a_damaged_chunk_is_said_and_computed_anew(tmp_path, damage):
    """A file with a flipped bit, cut short, empty, doubled, or not there."""
    store, note = tmp_path / "s", tmp_path / "note"
    whole = sweep(*scenes.squares(), store=store, chunk=4)
    chunk = store / "square" / "c" / "3"
    if damage is None:
        chunk.unlink()
    else:
        chunk.write_bytes(damage(chunk.read_bytes()))
    with pytest.raises(Scan2FlexError, match=r"chunk \[3\] is damaged") as error:
        open_sweep(store)
    assert "\n" not in str(error.value)
    with pytest.warns(UserWarning, match=r"chunk \[3\] is damaged .* computed anew"):
        same(sweep(*scenes.squares(note), store=store), whole)
    assert lines(note) == 4  # its samples, and no others
    same(open_sweep(store), whole)


@pytest.mark.parametrize("name", ["zarr.json", "square/zarr.json", "x/zarr.json", "x/c/0"])
def test_damaged_descriptions_are_one_sentence(tmp_path, name):
    sweep(*scenes.squares(), store=tmp_path / "whole", chunk=20)
    for k, damage in enumerate((flipped, lambda data: data[:20], lambda data: b"{}", lambda data: b"")):
        store = tmp_path / str(k)
        shutil.copytree(tmp_path / "whole", store)
        (store / name).write_bytes(damage((store / name).read_bytes()))
        for use in (open_sweep, lambda store: sweep(*scenes.squares(), store=store)):
            try:
                same(use(store), open_sweep(tmp_path / "whole"))
            except Scan2FlexError as error:
                assert str(k) in str(error) and "\n" not in str(error)
