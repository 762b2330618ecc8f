"""Size of a mesh, or of a cloud in a format of meshes, before trimesh reads it: from its header, or by counting its lines.

A survey takes one block of memory, independent of the file. `points` is the number for which the file has room, `declared`
the number in its header (the same for formats without a header).
"""

import io
import itertools
import json
import re
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from scan2flex_jax.study.limits import Limit

_SIZES = {
    "char": 1, "uchar": 1, "int8": 1, "uint8": 1, "short": 2, "ushort": 2, "int16": 2, "uint16": 2, "float16": 2, "int": 4,
    "uint": 4, "int32": 4, "uint32": 4, "float": 4, "float32": 4, "int64": 8, "uint64": 8, "double": 8, "float64": 8,
}  # fmt: skip
_HEADER = 100_000  # bytes of a header in text
_LONGEST_LINE = 100_000
_STL_HEAD, _STL_TRIANGLE = 84, 50
_PACKING = ("KHR_draco_mesh_compression", "EXT_meshopt_compression")


@dataclass(frozen=True)
class Survey:
    """Counts; `cut`: there are fewer faces than in the header; `unit`: of the points."""

    points: int = 0
    declared: int = 0
    faces: int = 0
    cut: bool = False
    unit: str = "points"


def survey(kind: str, stream: io.BufferedIOBase, limit: Limit) -> Survey:
    """Survey of a file of a kind among `SURVEYS`; counting stops at the limit.

    Raises `ValueError` with the reason for a damaged one.
    """
    size = stream.seek(0, 2)
    stream.seek(0)
    return SURVEYS[kind](stream, size, limit)


def _lines(stream: io.BufferedIOBase) -> Iterator[bytes]:
    """Non-blank lines; very long ones in pieces."""
    return (line for line in iter(lambda: stream.readline(_LONGEST_LINE), b"") if not line.isspace())


def _count(lines: Iterator[bytes], most: int) -> int:
    """Number of lines, counted slightly beyond `most`."""
    return sum(1 for _ in itertools.islice(lines, most + 1))


def _obj(stream: io.BufferedIOBase, size: int, limit: Limit) -> Survey:
    points = faces = 0
    for line in _lines(stream):
        points += line[:2] in (b"v ", b"v\t")
        faces += line[:2] in (b"f ", b"f\t")
        if max(points, faces) > limit.points:
            break
    return Survey(points, points, faces)


def _off(stream: io.BufferedIOBase, size: int, limit: Limit) -> Survey:
    words: list[bytes] = []
    lines = (text for line in _lines(stream) if (text := line.split(b"#")[0].strip()))
    for line in itertools.islice(lines, 3):
        words += line.split()
        if len(words) >= 3:
            break
    try:
        declared, faces = int(words[1]), int(words[2])
    except (IndexError, ValueError) as fault:
        raise ValueError("it does not begin with OFF and its counts") from fault
    rows = _count(lines, min(declared + faces, 2 * limit.points))
    return Survey(min(declared, rows), declared, faces, cut=rows < declared + faces)


def _stl(stream: io.BufferedIOBase, size: int, limit: Limit) -> Survey:
    head = stream.read(_HEADER)
    if head.lstrip()[:5].lower() == b"solid" and (b"facet" in head or size < _STL_HEAD):
        stream.seek(0)
        corners = _count((line for line in _lines(stream) if line.lstrip().startswith(b"vertex")), 3 * limit.points)
        return Survey(corners // 3, corners // 3, corners // 3, unit="triangles")
    if size < _STL_HEAD:
        raise ValueError("it is too short for an STL")
    (declared,) = struct.unpack("<I", head[80:_STL_HEAD])
    there = (size - _STL_HEAD) // _STL_TRIANGLE
    return Survey(min(there, declared), declared, declared, unit="triangles")


def _glb(stream: io.BufferedIOBase, size: int, limit: Limit) -> Survey:
    head = stream.read(20)
    if len(head) < 20 or head[:4] != b"glTF" or struct.unpack("<I", head[12:16])[0] > min(size, limit.bytes // 10):
        raise ValueError("it is no binary glTF")
    if struct.unpack("<I", head[8:12])[0] > size:
        return Survey(1, 1, cut=True)
    try:
        tree = json.loads(stream.read(struct.unpack("<I", head[12:16])[0]))
        packed = [name for name in _PACKING if name in tree.get("extensionsUsed", ())]
        where = [p["attributes"]["POSITION"] for mesh in tree.get("meshes", ()) for p in mesh["primitives"]]
        counts = [int(accessor["count"]) for accessor in tree.get("accessors", ())]
        points = sum(counts[i] for i in where)
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError) as fault:
        raise ValueError("its description is damaged") from fault
    if packed:
        raise ValueError(f"it is packed with {packed[0]}")
    return Survey(points, points, max(counts, default=0) // 3)


def _ply(stream: io.BufferedIOBase, size: int, limit: Limit) -> Survey:
    ascii_text, elements = _ply_header(stream)
    declared = sum(count for name, count, _ in elements if name == "vertex")
    faces = sum(count for name, count, _ in elements if name != "vertex")
    if max(declared, faces) > limit.points:
        return Survey(declared, declared, faces)
    room = _count(_lines(stream), declared + faces) if ascii_text else size - stream.tell()
    points, cut = declared, False
    for name, count, least in elements:
        there = min(count, room // (1 if ascii_text else max(least, 1)))
        room -= count if ascii_text else there * least
        points = there if name == "vertex" else points
        cut |= there < count and name != "vertex"
    return Survey(max(points, 0), declared, faces, cut)


def _ply_header(stream: io.BufferedIOBase) -> tuple[bool, list[tuple[str, int, int]]]:
    """Whether a PLY is text, and the name, count and least bytes of its elements, in turn."""
    data = stream.read(_HEADER)
    end = re.search(rb"^end_header\b.*\n?", data, re.MULTILINE)
    head = "" if end is None else data[: end.start()].decode("latin-1")
    form = re.search(r"^format[ \t]+(\w+)", head, re.MULTILINE)
    if end is None or form is None:
        raise ValueError("its header has no end, or does not say how it is written")
    stream.seek(end.end())
    elements = []
    for part in re.split(r"^element\b", head, flags=re.MULTILINE)[1:]:
        counted = re.match(r"\s+(\S+)\s+([0-9]{1,15})\s", part)
        if counted is None:
            raise ValueError("an element of its header has no count")
        types = re.findall(r"^property\s+(?:list\s+)?(\S+)", part, re.MULTILINE)  # a list always has at least its count
        elements.append((counted[1], int(counted[2]), sum(_SIZES.get(name, 1) for name in types)))
    return form[1] == "ascii", elements


SURVEYS: dict[str, Callable[[io.BufferedIOBase, int, Limit], Survey]] = {
    "ply": _ply, "obj": _obj, "stl": _stl, "off": _off, "glb": _glb,
}  # fmt: skip
"""The kinds of scans that trimesh reads."""
