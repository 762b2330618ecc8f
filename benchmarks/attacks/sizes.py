"""Files that are large, sparse, packed, deep, or hold other than they say: read, or refused early and in little memory."""

import gzip
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.attacks.attempt import REFUSED, Place, Try
from benchmarks.kinect_picks import read_picks
from scan2flex_jax.convert import read_foreign_curve
from scan2flex_jax.study import describe, load_study
from scan2flex_jax.study.scans import scan_facts
from tests.study.samples import STUDY, curve, write_sample

KINDS = ("ply", "obj", "stl", "off", "glb", "xyz")
Make = Callable[[Path], object]


def tries(place: Place, rng: np.random.Generator) -> Iterator[Try]:
    """Scans, curves and study.toml of every size and of every lie about it."""
    for name, make, must in (*_scans(), *_lies()):
        path = place.root / name
        yield Try(f"scan {name}", partial(scan_facts, path), (), must, prepare=partial(make, path))
    folder = write_sample(place.root / "study")
    for name, make, must in _tables():
        path = folder / "again.csv"
        yield Try(f"curve: {name}", partial(_studied, folder), (), must, prepare=partial(make, path))
        for read in (read_foreign_curve, read_picks):
            yield Try(f"{read.__name__}: {name}", partial(read, path), (), None, prepare=partial(make, path))
    for name, text, must in _tomls():
        path = folder / "study.toml"
        yield Try(f"study.toml: {name}", partial(_studied, folder), (), must, prepare=partial(path.write_bytes, text))


def _studied(folder: Path) -> None:
    describe(load_study(folder))


def _sparse(size: int) -> Make:
    def make(path):
        with path.open("wb") as stream:
            stream.truncate(size)

    return make


def _repeated(begin: bytes, block: bytes, times: int, end: bytes = b"") -> Make:
    def make(path):
        with path.open("wb") as stream:
            stream.write(begin)
            for _ in range(0, times, 1000):
                stream.write(block * min(1000, times))
            stream.write(end)

    return make


def _packed(block: bytes, times: int) -> Make:
    """Gzip of a block, many times."""

    def make(path):
        pack = zlib.compressobj(9, wbits=31)
        with path.open("wb") as stream:
            for _ in range(times):
                stream.write(pack.compress(block))
            stream.write(pack.flush())

    return make


def _zipped(times: int, method: int, members: int = 1, says: int | None = None, name: str = "a.xyz") -> Make:
    """An archive of one block, many times; its directory may say that it holds ``says`` bytes."""

    def make(path):
        block = b"0 0 0\n" * 200_000
        with zipfile.ZipFile(path, "w", method) as archive:
            for i in range(members):
                with archive.open(f"{i}{name}", "w", force_zip64=True) as member:
                    for _ in range(times):
                        member.write(block)
        if says is not None:
            held, told = struct.pack("<I", times * len(block)), struct.pack("<I", says)
            path.write_bytes(path.read_bytes().replace(held, told))

    return make


def _scans() -> Iterator[tuple[str, Make, str | None]]:
    block = b"0 0 0\n" * 200_000
    for kind in KINDS:
        for size in (1, 100, 1_000_000, 2**30, 2**33):
            yield f"sparse-{size}.{kind}", _sparse(size), REFUSED
        yield f"packed-zeros.{kind}.gz", _packed(bytes(10_000_000), 70), REFUSED
        yield f"packed-nested.{kind}.gz", _nested, REFUSED
        yield f"long-line.{kind}", _repeated(b"", b"1 " * 1000, 40_000), REFUSED
        yield f"line-breaks.{kind}", _repeated(b"", b"\n", 60_000_000), REFUSED
    yield "packed-points.xyz.gz", _packed(block, 600), REFUSED
    yield "rows.xyz", _repeated(b"", b"1 2 3\n", 6_000_000), REFUSED
    yield "rows.obj", _repeated(b"", b"v 1 2 3\n", 6_000_000), REFUSED
    yield "many-columns.xyz", _repeated(b"", b"1 ", 10_000_000), None
    yield "ragged.xyz", _repeated(b"", b"1 2 3\n4 5\n", 100_000), REFUSED
    for method in (zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        yield f"packed-{method}.zip", _zipped(100 if method != zipfile.ZIP_DEFLATED else 600, method), None
    for says in (0, 10, 2**31, 2**32 - 2):
        yield f"lying-{says}.zip", _zipped(600, zipfile.ZIP_DEFLATED, says=says), REFUSED
    yield "two.zip", _zipped(1, zipfile.ZIP_DEFLATED, members=2), REFUSED
    yield "many.zip", _zipped(0, zipfile.ZIP_STORED, members=20_000, name=".txt"), REFUSED
    yield "outside.zip", _zipped(0, zipfile.ZIP_STORED, name="/../../../a.xyz"), REFUSED


def _nested(path: Path) -> None:
    data = bytes(50_000_000)
    for _ in range(3):
        data = gzip.compress(data)
    path.write_bytes(data)


COUNTS = ("4000000000", "-1", "0", "21", "1e9", "nan", "9" * 40, "", "x", str(2**31), str(2**64), "5000001", "0x14")
PLY = b"ply\nformat ascii 1.0\nelement vertex %s\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
FACES = b"element face %s\nproperty list uchar int v\nend_header"


def _lies() -> Iterator[tuple[str, Make, str | None]]:
    """Headers that declare other counts than there are."""
    points = "\n".join(" ".join(map("{:g}".format, p)) for p in curve(20)).encode() + b"\n"
    raw = curve(20).astype("<f4").tobytes()
    for count in COUNTS:
        n, name, must = count.encode(), count[:12] or "none", None if count in ("0", "") else REFUSED
        faces = (PLY % b"20").replace(b"end_header", FACES % n)
        yield f"says-{name}-ascii.ply", _holding(PLY % n + points), must
        yield f"says-{name}.ply", _holding((PLY % n).replace(b"ascii", b"binary_little_endian") + raw), must
        yield f"says-{name}-faces.ply", _holding(faces + points), None
        yield f"says-{name}.off", _holding(b"OFF\n" + n + b" 1 0\n" + points), must
        yield f"says-{name}-faces.off", _holding(b"OFF\n20 " + n + b" 0\n" + points), None
        if count.isdecimal() and int(count) < 2**32:
            number = struct.pack("<I", int(count))
            yield f"says-{name}.stl", _holding(bytes(80) + number + bytes(50)), REFUSED
            yield f"says-{name}.glb", _holding(b"glTF" + struct.pack("<I", 2) + 2 * number + b"JSON"), REFUSED
    many = b"".join(b"property float p%d\n" % i for i in range(50_000))
    yield "many-properties.ply", _holding(b"ply\nformat ascii 1.0\nelement vertex 1\n" + many + b"end_header\n1\n"), REFUSED
    yield "endless-header.ply", _repeated(b"ply\nformat ascii 1.0\n", b"comment x\n", 2_000_000), REFUSED


def _holding(data: bytes) -> Make:
    return lambda path: path.write_bytes(data)


def _tables() -> Iterator[tuple[str, Make, str | None]]:
    head = b"x,y,z\n"
    yield "sparse", _sparse(2**30), REFUSED
    yield "8 million short lines", _repeated(head, b"1,2,3\n", 8_000_000), REFUSED
    yield "60 million empty lines", _repeated(head, b"\n", 60_000_000), REFUSED
    yield "60 million other line ends", _repeated(head, b"\r", 60_000_000), REFUSED
    yield "one line of 80 MB", _repeated(head, b"1," * 20, 2_000_000), REFUSED
    yield "one cell of 80 MB", _repeated(head, b"1" * 40, 2_000_000), REFUSED
    yield "a header of 80 MB", _repeated(b"", b"x,y,z," * 8, 2_000_000), REFUSED
    yield "10,000 columns", _repeated(b"", b"1,", 10_000, b"\n"), REFUSED
    yield "quotes", _repeated(head, b'"' * 10, 100_000), REFUSED
    yield "commas", _repeated(head, b",,\n", 500_000), REFUSED
    yield "no numbers", _repeated(head, b"a,b,c\n", 900_000), REFUSED


def _tomls() -> Iterator[tuple[str, bytes, str | None]]:
    start = STUDY.encode()
    for n in (10, 1000, 100_000):
        for name, text in {
            "keys with dots": b"a" + b".a" * n + b" = 1\n", "tables with dots": b"[" + b"a." * n + b"a]\n",
            "lists": b"a = " + b"[" * n + b"]" * n + b"\n", "inline tables": b"a = " + b"{a=" * n + b"1" + b"}" * n + b"\n",
            "open lists": b"a = " + b"[" * n + b"\n", "a long list": b"a = [" + b"1," * n + b"]\n",
            "a long text": b'a = "' + b"x" * n + b'"\n', "a long number": b"a = " + b"9" * n + b"\n",
            "a long key": b"x" * n + b" = 1\n", "many keys": b"".join(b"k%d = 1\n" % i for i in range(n)),
            "many tables": b"".join(b"[t%d]\n" % i for i in range(n)), "many poses": b"[[pose]]\n" * n,
            "many effects": b"[[effect]]\n" * n, "a quoted key": b'"' + b"\\u0041" * n + b'" = 1\n', "comments": b"#\n" * n,
            "blanks": b" " * n, "a long title": b'title = "' + b"t" * n + b'"\n',
        }.items():  # fmt: skip
            yield f"{n} {name}", text + start, None
            yield f"{n} {name} at the end", start + text, None
    yield "12 MB of comments", b"#" * 12_000_000, REFUSED
    yield "zeros", bytes(1_000_000), REFUSED
    yield "UTF-16", STUDY.encode("utf-16"), REFUSED
    yield "a mark in front", b"\xef\xbb\xbf" + start, None
    yield "texts that open", b'"""' * 300_001, REFUSED
