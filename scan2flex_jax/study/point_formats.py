"""Point clouds in the formats of scanners: E57, LAS, LAZ, PCD, PTX, PTS, other text, and arrays of numpy.

Each reader takes the stream of a file, and reads no more points than the limit. Poses of the scanner in an E57 or PTX are
applied; points without a return are left out. E57, LAS and LAZ are read by the libraries of `scan2flex_jax[scans]`.
"""

import io
import itertools
import math
import struct
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np

from scan2flex_jax.study.files import UTF_16
from scan2flex_jax.study.limits import Limit
from scan2flex_jax.study.tables import scanned
from scan2flex_jax.study.values import Where, one_line


class Points(NamedTuple):
    """Points (m, or in the unit of the file if it states none), notes, and the unit and the number of points that it states."""

    points: Annotated[np.ndarray, "n 3"]
    notes: tuple[str, ...] = ()
    unit: str | None = None
    declared: int = 0


_PTX_HEAD = 10  # lines: columns, rows, position and axes of the scanner, and its 4 x 4 matrix (transposed)
_HEADER = 100_000  # bytes of a header in text
_RECORDS = 10_000  # most records before the points of a LAS
_BEFORE = 1000  # lines of a text before its points


def _scans(parts: list[np.ndarray], declared: int = 0) -> Points:
    notes = (f"{len(parts)} scans in one file",) * (len(parts) > 1)
    return Points(np.concatenate([np.zeros((0, 3)), *parts]), notes, declared=declared)


def _e57(stream: Any, path: Path, limit: Limit) -> Points:
    import pye57  # noqa: PLC0415

    with _on_disk(stream) as name, pye57.E57(name) as file:
        limit.check(path, sum(file.get_header(i).point_count for i in range(file.scan_count)))
        scans = [file.read_scan(i, ignore_missing_fields=True) for i in range(file.scan_count)]
    return _scans([np.column_stack([scan[f"cartesian{c}"] for c in "XYZ"]) for scan in scans])


def _las(stream: Any, path: Path, limit: Limit) -> Points:
    import laspy  # noqa: PLC0415
    import lazrs  # noqa: F401, PLC0415  (what laspy unpacks LAZ with)

    if int.from_bytes(stream.read(104)[100:], "little") > _RECORDS:
        raise ValueError("its header is damaged")
    stream.seek(0)
    header = laspy.LasHeader.read_from(stream)
    count = limit.check(path, header.point_count)
    stream.seek(0)
    if header.are_points_compressed:
        with _on_disk(stream) as name:
            return Points(read_apart(_READ_LAZ, name)["points"], declared=count)
    with laspy.open(stream, closefd=False, read_evlrs=False) as file:
        return Points(np.asarray(file.read().xyz, float), declared=count)


_READ_LAZ = """
import sys, laspy, numpy
numpy.savez(sys.argv[2], points=numpy.asarray(laspy.read(sys.argv[1]).xyz, float))
"""
_LONGEST = 600.0  # s


def read_apart(code: str, name: str) -> dict[str, np.ndarray]:
    """The arrays that ``code`` reads from the file ``name`` in a process of its own: on a damaged file some libraries never
    end, or end their process. Raises `ValueError` if it leaves none."""
    with tempfile.TemporaryDirectory() as folder:
        there = Path(folder) / "read.npz"
        with suppress(subprocess.TimeoutExpired):
            command = [sys.executable, "-c", code, name, str(there)]
            subprocess.run(command, capture_output=True, timeout=_LONGEST, check=False)
        if not there.is_file():
            raise ValueError("its library does not read it")
        with np.load(there) as arrays:
            return dict(arrays)


def _pcd(stream: Any, path: Path, limit: Limit) -> Points:
    kind, row, count = _pcd_header(stream)
    limit.check(path, count)
    if kind == "ascii":
        start = np.cumsum([0, *(math.prod(row[name].shape) for name in row.names or ())])
        at = [start[list(row.names or ()).index(c)] for c in "xyz"]
        return Points(np.loadtxt(itertools.islice(stream, count), usecols=at, ndmin=2), declared=count)
    if kind == "binary":
        data = stream.read(count * row.itemsize)
        return Points(columns(np.frombuffer(data, row, len(data) // row.itemsize)), declared=count)
    packed = struct.unpack("<II", stream.read(8))[0]
    data, fields = _lzf(stream.read(packed), count * row.itemsize), {}
    for name in row.names or ():  # field after field
        size = count * row[name].itemsize
        fields[name], data = data[:size], data[size:]
    return Points(np.column_stack([np.frombuffer(fields[c], row[c].base) for c in "xyz"]).astype(float))


def _pcd_header(stream: Any) -> tuple[str, np.dtype, int]:
    """How a PCD is written ("ascii", "binary", "binary_compressed"), the type of a row, and the number of rows."""
    said: dict[str, list[str]] = {}
    while "DATA" not in said and stream.tell() < _HEADER and (line := stream.readline(_HEADER)):
        key, *words = line.decode("ascii", errors="replace").split() or ["#"]
        said[key] = words
    try:
        names, types, sizes = said["FIELDS"], said["TYPE"], said["SIZE"]
        counts = said.get("COUNT", ["1"] * len(names))
        fields = list(zip(names, types, sizes, counts, strict=True))
        row = np.dtype([(f"{n}{i}" * (n not in "xyz") or n, f"<{t.lower()}{b}", (int(c),) * (c != "1"))
                        for i, (n, t, b, c) in enumerate(fields)])  # fmt: skip
        kind, declared = said["DATA"][0], int(said["WIDTH"][0]) * int(said["HEIGHT"][0])
    except (KeyError, ValueError, IndexError, TypeError) as fault:
        raise ValueError("its header is damaged") from fault
    if not {"x", "y", "z"} <= set(row.names or ()) or kind not in ("ascii", "binary", "binary_compressed") or declared < 0:
        raise ValueError("its header names no fields x, y, z, or no way of writing")
    return kind, row, declared


def _lzf(packed: bytes, size: int) -> bytes:
    """The content of an LZF block (Marc Lehmann's format): runs of literals, and references to what stands before."""
    out, i = bytearray(), 0
    while i < len(packed) and len(out) <= size:
        control, i = packed[i], i + 1
        if control < 32:
            out += packed[i : i + control + 1]
            i += control + 1
            continue
        long = control >> 5 == 7
        length = (control >> 5) + 2 + (packed[i] if long else 0)
        back, i = ((control & 31) << 8) + packed[i + long] + 1, i + 1 + long
        if back > len(out):
            break
        piece = out[len(out) - back : len(out) - back + length]
        out += (piece * (length // back + 1))[:length]
    if len(out) != size:
        raise ValueError("its packed data are damaged")
    return bytes(out)


def _ptx(stream: Any, path: Path, limit: Limit) -> Points:
    text, parts, declared = io.TextIOWrapper(stream, "ascii", errors="replace"), [], 0
    while head := [line for line in itertools.islice(text, _PTX_HEAD) if line.strip()]:
        count = int(head[0]) * int(head[1])
        declared = limit.check(path, declared + count)
        turn, shift = np.array([line.split() for line in head[6:9]], float)[:, :3], np.array(head[9].split(), float)[:3]
        points = np.array([line.split()[:3] for line in itertools.islice(text, count)], float).reshape(-1, 3)
        seen = np.any(points != 0.0, axis=1)
        declared -= int(np.sum(~seen))
        parts.append(points[seen] @ turn + shift)
    text.detach()
    return _scans(parts, declared)


def _text(stream: Any, path: Path, limit: Limit) -> Points:
    wide = stream.read(2) in UTF_16
    stream.seek(0)
    text = io.TextIOWrapper(stream, "utf-16" if wide else "utf-8-sig", errors="replace")

    def lines() -> Iterator[str]:
        text.seek(0)
        return itertools.islice(text, limit.points + _BEFORE)

    try:
        first = next((line.split() for line in lines() if line.strip() and line.lstrip()[0] not in "#/"), None)
        if first is None:
            return Points(np.zeros((0, 3)))
        points, unit = scanned(lines, Where(one_line(str(path), 300)))
    finally:
        text.detach()
    limit.check(path, len(points))
    declared = int(first[0]) if len(first) == 1 and first[0].isdecimal() else 0
    return Points(points, (f"its lengths were in {unit}",) * (unit not in (None, "m")), unit, declared)


def _npz(stream: Any, path: Path, limit: Limit) -> Points:
    limit.check(path, max((entry.file_size for entry in zipfile.ZipFile(stream).infolist()), default=0) // 24)
    stream.seek(0)
    with np.load(stream, allow_pickle=False) as arrays:
        names = [name for name in arrays.files if _shaped(arrays[name])]
        if len(names) != 1:
            raise ValueError(f"{len(names)} of its arrays have the shape (n, 3)")
        return Points(columns(arrays[names[0]]))


def columns(array: np.ndarray) -> Annotated[np.ndarray, "n 3"]:
    """The points in an array of the shape (n, 3) or wider, or (3, n), or with fields x, y and z."""
    if not _shaped(array):
        raise ValueError(f"an array of the shape {array.shape} and type {array.dtype} is no list of points")
    rows = np.column_stack([array[c] for c in "xyz"]) if array.dtype.names else array.T if len(array) == 3 else array
    return rows[:, :3].astype(float)


def _shaped(array: np.ndarray) -> bool:
    if array.dtype.names:
        return array.ndim == 1 and {"x", "y", "z"} <= set(array.dtype.names)
    return array.ndim == 2 and array.shape[1] >= 3 and array.shape != (3, 3) and array.dtype.kind in "fiu"


@contextmanager
def _on_disk(stream: Any) -> Iterator[str]:
    """The name of a file with this content."""
    if isinstance(name := getattr(stream, "name", None), str):
        yield name
        return
    with tempfile.NamedTemporaryFile(suffix=".e57") as copy:
        copy.write(stream.read())
        copy.flush()
        yield copy.name


READERS: dict[str, Callable[[Any, Path, Limit], Points]] = {
    "e57": _e57, "las": _las, "laz": _las, "pcd": _pcd, "ptx": _ptx, "npz": _npz,
    "npy": lambda stream, *_: Points(columns(np.load(stream, allow_pickle=False))),
    **dict.fromkeys(("xyz", "pts", "asc", "txt", "csv", "tsv", "dat"), _text),
}  # fmt: skip
"""Readers of points by ending; other kinds are read by trimesh."""
