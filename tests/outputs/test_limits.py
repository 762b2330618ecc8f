"""What is too large is refused before it fills the memory, and what is read takes memory in proportion to its points."""

import bz2
import gzip
import io
import json
import struct
import subprocess
import sys
import zipfile
import zlib
from pathlib import Path

import numpy as np
import pytest
import trimesh

from benchmarks.kinect_wires import read_picks
from scan2flex_jax.convert import read_foreign_curve
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study import load_study
from scan2flex_jax.study.limits import VARIABLE, curve_limit, scan_limit
from scan2flex_jax.study.scans import load_geometry, scan_facts

from . import scenes

MEASURE = """
import sys
from pathlib import Path
import trimesh
from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.study.curves import read_curve
from scan2flex_jax.study.scans import scan_facts
from scan2flex_jax.study.values import Where
path = Path(sys.argv[1])

def peak():  # kB; the figure of getrusage begins with that of the process that started this one
    return next(int(line.split()[1]) for line in open("/proc/self/status") if line.startswith("VmHWM"))

before = peak()
try:
    said = scan_facts(path)[0] if path.suffix != ".csv" else len(read_curve(path, Where(str(path))).points)
except Scan2FlexError as error:
    said = str(error)
print((peak() - before) // 1024, said, sep="|")
"""


def measured(path):
    """``(MB taken, what was said)`` of reading a file, in a process of its own."""
    done = subprocess.run([sys.executable, "-c", MEASURE, str(path)], capture_output=True, text=True, timeout=120, check=True)
    size, _, said = done.stdout.strip().partition("|")
    return int(size), said


def _sparse(path, size):
    with path.open("wb") as stream:
        stream.truncate(size)


def _gz(path, size):
    pack = zlib.compressobj(1, wbits=31)
    block = b"0 0 0\n" * 200_000
    with path.open("wb") as stream:
        for _ in range(size // len(block)):
            stream.write(pack.compress(block))
        stream.write(pack.flush())


SAYS = b"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n"
TOO_LARGE = {
    "sparse.ply": (lambda p: _sparse(p, 2**30), "MB or more"),
    "packed.xyz.gz": (lambda p: _gz(p, 700_000_000), "MB or more"),
    "rows.csv": (lambda p: p.write_bytes(b"x,y,z\n" + b"1,2,3\n" * 8_000_000), "more than 1000000 lines"),
    "says.ply": (lambda p: p.write_bytes(SAYS), "4000000000 points"),
}  # fmt: skip


needs_linux = pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="memory is measured on Linux only")


@needs_linux
@pytest.mark.parametrize("name", TOO_LARGE)
def test_what_is_too_large_is_refused_in_little_memory(tmp_path, name):
    make, words = TOO_LARGE[name]
    make(tmp_path / name)
    size, said = measured(tmp_path / name)
    assert name in said and any(word in said for word in words.split("|")), said
    assert VARIABLE in said or not words
    assert size < 700  # MB: below 1 GB with the program itself


@needs_linux
def test_what_is_read_takes_memory_by_its_points(tmp_path):
    points = np.random.default_rng(0).normal(size=(300_000, 3)).round(5)
    np.savetxt(tmp_path / "a.xyz", points, fmt="%.5f")
    trimesh.PointCloud(points).export(tmp_path / "a.ply")
    for name in ("a.xyz", "a.ply"):
        size, said = measured(tmp_path / name)
        assert said == "300000" and size < 100, (name, size, said)  # 7 MB of coordinates


def test_limits_are_raised_in_the_environment(tmp_path, monkeypatch):
    file = tmp_path / "a.xyz"
    np.savetxt(file, scenes.curve(40))
    for most, read in (("39", False), ("40", True), ("", True)):
        monkeypatch.setenv(VARIABLE, most)
        if read:
            assert scan_facts(file)[0] == 40
        else:
            with pytest.raises(Scan2FlexError, match=f"at most 39 points .* set {VARIABLE}"):
                scan_facts(file)
    for wrong in ("many", "-1", "1e6", "0", "\N{SUPERSCRIPT TWO}", "9" * 30):
        monkeypatch.setenv(VARIABLE, wrong)
        for limit in (scan_limit, curve_limit):
            with pytest.raises(Scan2FlexError, match=VARIABLE):
                limit()
    monkeypatch.setenv(VARIABLE, "20")
    study = scenes.write_study(tmp_path / "study")
    with pytest.raises(Scan2FlexError, match=r"pose-0\.csv.*more than 20 lines"):
        load_study(study)
    for read in (read_foreign_curve, read_picks):
        with pytest.raises(Scan2FlexError, match="more than 20 lines"):
            read(study / "pose-0.csv")


def test_packed_scans_are_read(tmp_path):
    points = scenes.curve(50)
    text = io.BytesIO()
    np.savetxt(text, points)
    (tmp_path / "a.xyz.gz").write_bytes(gzip.compress(text.getvalue()))
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("deep/../../a.xyz", text.getvalue())  # a name: nothing is written
        archive.writestr("readme.txt", "a scan")
    for name in ("a.xyz.gz", "a.zip"):
        np.testing.assert_array_equal(load_geometry(tmp_path / name).vertices, points)
    assert {p.name for p in tmp_path.iterdir()} == {"a.xyz.gz", "a.zip"}


def _encrypted(data):
    """The archive with the bit set that says so, in its head and its directory."""
    out = bytearray(data)
    for mark, place in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        out[out.index(mark) + place] |= 1
    return bytes(out)


def test_archives_that_are_no_scan_are_one_sentence(tmp_path):
    with zipfile.ZipFile(tmp_path / "two.zip", "w") as archive:
        for name in ("a.xyz", "b.ply"):
            archive.writestr(name, "0 0 0\n")
    with zipfile.ZipFile(tmp_path / "one.zip", "w") as archive:
        archive.writestr("a.xyz", "0 0 0\n" * 100)
    whole = (tmp_path / "one.zip").read_bytes()
    (tmp_path / "cut.zip").write_bytes(whole[:-30])
    (tmp_path / "secret.zip").write_bytes(_encrypted(whole))
    (tmp_path / "changed.zip").write_bytes(whole.replace(b"0 0 0", b"0 1 0", 1))
    (tmp_path / "cut.xyz.gz").write_bytes(gzip.compress(b"0 0 0\n" * 100)[:-12])
    (tmp_path / "changed.ply.gz").write_bytes(b"\x1f\x8b" + bytes(40))
    (tmp_path / "a.xyz.bz2").write_bytes(bz2.compress(b"0 0 0\n"))
    (tmp_path / "a.gltf").write_text("{}")
    for path in sorted(tmp_path.iterdir()):
        if path.name != "one.zip":
            with pytest.raises(Scan2FlexError, match=path.name.replace(".", r"\.")) as error:
                load_geometry(path)
            assert "\n" not in str(error.value)


def _glb(tree):
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text), len(text), b"JSON") + text


@pytest.mark.parametrize(
    ("tree", "words"),
    [
        ({"accessors": [{"count": 4_000_000_000}], "meshes": []}, "faces"),
        ({"accessors": [{"count": 9000}], "meshes": [{"primitives": 10**3 * [{"attributes": {"POSITION": 0}}]}]}, "9000000 po"),
        ({"extensionsUsed": ["KHR_draco_mesh_compression"]}, "KHR_draco_mesh_compression"),
        ({"extensionsUsed": 3}, "damaged"),
        ([], "damaged"),
        ({"meshes": [{"primitives": [{"attributes": {"POSITION": 7}}]}]}, "damaged"),
    ],
)
def test_a_scene_says_what_it_holds_before_it_is_read(tmp_path, tree, words):
    (tmp_path / "a.glb").write_bytes(_glb(tree))
    with pytest.raises(Scan2FlexError, match=words):
        load_geometry(tmp_path / "a.glb")
