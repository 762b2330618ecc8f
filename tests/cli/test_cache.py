"""The cache of compiled functions: entries are whole or made anew, wherever it lies and whoever shares it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from scan2flex_jax import Scan2FlexError, cache, keep_compiled
from scan2flex_jax.cli.terminal import complain

SCRIPT = """
import sys
from scan2flex_jax.cli.setup import prepare_jax
prepare_jax()
import jax, jax.numpy as jnp
seen = []
jax.monitoring.register_event_listener(lambda name, **more: seen.append(name.rpartition("/")[2]))
print(jax.jit(lambda x: jnp.linalg.inv(x) @ jnp.cos(x))(jnp.eye(3)).trace())
print("found", seen.count("cache_hits"), "of", seen.count("compile_requests_use_cache"), file=sys.stdout)
"""


def start(**environment):
    own = ("SCAN2FLEX_CACHE", "XDG_CACHE_HOME", "TF_CPP_MIN_LOG_LEVEL", *environment)
    kept = {k: v for k, v in os.environ.items() if k not in own}
    environment = kept | {k: str(v) for k, v in environment.items() if v is not None}
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen([sys.executable, "-c", SCRIPT], env=environment, **pipes)


def compiled(process):
    """``(entries found, entries asked for, what was said)``; the answer is always right."""
    out, said = process.communicate(timeout=120)
    assert process.returncode == 0, said
    answer, counts = out.splitlines()
    assert float(answer) == pytest.approx(3 * 0.5403023)
    return int(counts.split()[1]), int(counts.split()[3]), said


DAMAGES = {
    "cut": lambda data: data[: len(data) // 2],
    "empty": lambda data: b"",
    "random": lambda data: os.urandom(len(data)),
    "flipped": lambda data: data[:100] + bytes([data[100] ^ 4]) + data[101:],
    "doubled": lambda data: 2 * data,
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_entry_is_thrown_away(tmp_path, damage):
    entries = cache.Entries(tmp_path)
    assert entries.get("a") is None
    entries.put("a", bytes(range(200)))
    [file] = tmp_path.iterdir()
    assert entries.get("a") == bytes(range(200))
    file.write_bytes(damage(file.read_bytes()))
    assert entries.get("a") is None and not file.exists()
    entries.put("a", b"new")
    assert entries.get("a") == b"new"


def test_an_entry_counts_under_its_own_key_alone(tmp_path):
    """Another function's code in the place of this one's would compute something else."""
    entries = cache.Entries(tmp_path)
    entries.put("a", b"one")
    entries.put("b", b"two")
    (tmp_path / "a-checked").replace(tmp_path / "b-checked")
    assert entries.get("a") is None and entries.get("b") is None


def test_what_is_no_file_is_no_entry(tmp_path):
    entries = cache.Entries(tmp_path)
    os.mkfifo(tmp_path / "pipe-checked")
    (tmp_path / "folder-checked").mkdir()
    (tmp_path / "loop-checked").symlink_to(tmp_path / "loop-checked")
    for key in ("pipe", "folder", "loop"):
        assert entries.get(key) is None


@pytest.mark.slow
def test_two_processes_fill_one_cache_and_damaged_entries_are_made_anew(tmp_path):
    for process in [start(SCAN2FLEX_CACHE=tmp_path) for _ in range(2)]:
        assert compiled(process)[2] == ""
    found, asked, said = compiled(start(SCAN2FLEX_CACHE=tmp_path))
    assert 0 < found == asked and said == ""
    files = sorted(tmp_path.iterdir())
    assert all(path.name.endswith("-checked") for path in files)
    for file, damage in zip(files, 10 * list(DAMAGES.values()), strict=False):
        file.write_bytes(damage(file.read_bytes()))
    assert compiled(start(SCAN2FLEX_CACHE=tmp_path)) == (0, asked, "")


def test_a_cache_that_takes_nothing_is_read(tmp_path, monkeypatch):
    entries = cache.Entries(tmp_path)
    entries.put("a", b"old")

    def full(*_):
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr("scan2flex_jax.study.files.os.fsync", full)
    entries.put("b", b"new")
    assert entries.get("a") == b"old" and entries.get("b") is None
    assert len(list(tmp_path.iterdir())) == 1


@pytest.fixture
def temporary(tmp_path, monkeypatch):
    """A folder for temporary files, and no cache asked for."""
    for name in ("SCAN2FLEX_CACHE", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(cache.tempfile, "gettempdir", lambda: str(tmp_path))
    return tmp_path / f"scan2flex-cache-{os.geteuid()}"


def test_without_a_home_it_lies_in_a_temporary_folder(temporary, monkeypatch, capsys):
    def nobody():
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr(Path, "home", nobody)
    assert cache.cache_folder(complain) == temporary
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and str(temporary) in said and "home" in said
    assert temporary.stat().st_mode & 0o077 == 0


def test_a_home_that_takes_nothing(temporary, monkeypatch, capsys):
    monkeypatch.setenv("HOME", "/proc/none")
    assert cache.cache_folder(complain) == temporary
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.parametrize("whose", ["everybody", "another user"])
def test_a_folder_that_others_fill_is_not_used(temporary, tmp_path, monkeypatch, capsys, whose):
    folder = tmp_path / "shared"
    folder.mkdir()
    monkeypatch.setenv("SCAN2FLEX_CACHE", str(folder))
    if whose == "everybody":
        folder.chmod(0o777)
    elif os.geteuid() == 0:
        os.chown(folder, 54321, 54321)
    else:
        pytest.skip("only the administrator can give a folder to another user")
    assert cache.cache_folder(complain) == temporary
    assert whose in capsys.readouterr().err


def test_no_folder_at_all(tmp_path, monkeypatch, capsys):
    (tmp_path / "file").touch()
    monkeypatch.setenv("SCAN2FLEX_CACHE", str(tmp_path / "file" / "cache"))
    monkeypatch.setattr(cache.tempfile, "gettempdir", lambda: str(tmp_path / "file"))
    assert cache.cache_folder(complain) is None
    assert "not kept" in capsys.readouterr().err
    monkeypatch.setenv("SCAN2FLEX_CACHE", "off")
    assert cache.cache_folder(complain) is None
    assert capsys.readouterr().err == ""


NOTEBOOK = """
import pathlib, sys, warnings
warnings.simplefilter("error")
import scan2flex_jax
folder = pathlib.Path(sys.argv[1])
assert scan2flex_jax.keep_compiled(folder) == folder
import jax
jax.config.update("jax_enable_x64", True)
from scan2flex_jax import Boundary, Cable, CableModel, equilibrium
cable = Cable(length=1.0, length_density=0.2, bending_stiffness=0.1, torsional_stiffness=0.25)
e = equilibrium(CableModel(cable, gravity=[0.0, 0.0, -9.81]), Boundary.of(([0, 0, 0], [1, 0, 0, 0])), elements=8)
print(float(e.points[-1, 2]), len(list(folder.glob("program-*"))))
"""


def test_a_script_keeps_what_it_compiles_for_the_next_by_one_call(tmp_path):
    def run():
        command = [sys.executable, "-c", NOTEBOOK, str(tmp_path / "kept")]
        env = {k: v for k, v in os.environ.items() if k != "TF_CPP_MIN_LOG_LEVEL"}  # JAX sets it in this process
        done = subprocess.run(command, capture_output=True, text=True, env=env, timeout=300, check=False)
        assert (done.returncode, done.stderr) == (0, "")
        return done.stdout.split(), sorted(p.name for p in (tmp_path / "kept").iterdir())

    (first, programs), kept = run()
    assert int(programs) > 0
    assert run() == ([first, programs], kept)  # nothing more to compile, and the same answer


def test_a_folder_that_cannot_keep_them_is_one_sentence(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(Scan2FlexError, match="compiled functions cannot be kept there") as error:
        keep_compiled(tmp_path / "file")
    assert "\n" not in str(error.value)
