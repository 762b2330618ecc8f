"""Size of a mesh, or of a cloud in a format of meshes, before trimesh reads it: from its header, or by counting its lines.

`points` is the number for which the file has room, `declared` the number in its header (the same for formats without a header).
"""

import io
import itertools
import json
import re
import struct
from collections.abc import Callable
from typing import NamedTuple

from scan2flex_jax.study.limits import Limit

_SIZES = {
    "char": 1, "uchar": 1, "int8": 1, "uint8": 1, "short": 2, "ushort": 2, "int16": 2, "uint16": 2, "float16": 2, "int": 4,
    "uint": 4, "int32": 4, "uint32": 4, "float": 4, "float32": 4, "int64": 8, "uint64": 8, "double": 8, "float64": 8,
}  # fmt: skip
_HEADER = 100_000  # bytes of a header in text
_STL_HEAD, _STL_TRIANGLE = 84, 50
_PACKING = ("KHR_draco_mesh_compression", "EXT_meshopt_compression")


class Survey(NamedTuple):
    """Counts; `cut`: there are fewer faces than in the header; `unit`: of the points."""

    points: int = 0
    declared: int = 0
    faces: int = 0
    cut: bool = False
    unit: str = "points"


def _count(pattern: bytes, data: bytes) -> int:
    return sum(1 for _ in re.finditer(pattern, data, re.MULTILINE))


def _obj(data: bytes, limit: Limit) -> Survey:
    points = _count(rb"^v[ \t]", data)
    return Survey(points, points, _count(rb"^f[ \t]", data))


def _off(data: bytes, limit: Limit) -> Survey:
    lines = (text for line in io.BytesIO(data) if (text := line.split(b"#")[0].strip()))
    words: list[bytes] = []
    while len(words) < 3 and (line := next(lines, b"")):
        words += line.split()
    try:
        declared, faces = int(words[1]), int(words[2])
    except (IndexError, ValueError) as fault:
        raise ValueError("it does not begin with OFF and its counts") from fault
    rows = sum(1 for _ in itertools.islice(lines, min(declared + faces, 2 * limit.points)))
    return Survey(min(declared, rows), declared, faces, cut=rows < declared + faces)


def _stl(data: bytes, limit: Limit) -> Survey:
    head = data[:_HEADER]
    if head.lstrip()[:5].lower() == b"solid" and (b"facet" in head or len(data) < _STL_HEAD):
        triangles = _count(rb"^[ \t]*vertex", data) // 3
        return Survey(triangles, triangles, triangles, unit="triangles")
    if len(data) < _STL_HEAD:
        raise ValueError("it is too short for an STL")
    (declared,) = struct.unpack_from("<I", data, 80)
    there = (len(data) - _STL_HEAD) // _STL_TRIANGLE
    return Survey(min(there, declared), declared, declared, unit="triangles")


def _glb(data: bytes, limit: Limit) -> Survey:
    whole, length = struct.unpack_from("<II", data, 8) if len(data) >= 20 and data[:4] == b"glTF" else (0, len(data) + 1)
    if length > min(len(data), limit.bytes // 10):
        raise ValueError("it is no binary glTF")
    if whole > len(data):
        return Survey(1, 1, cut=True)
    try:
        tree = json.loads(data[20 : 20 + length])
        packed = [name for name in _PACKING if name in tree.get("extensionsUsed", ())]
        where = [p["attributes"]["POSITION"] for mesh in tree.get("meshes", ()) for p in mesh["primitives"]]
        counts = [int(accessor["count"]) for accessor in tree.get("accessors", ())]
        points = sum(counts[i] for i in where)
    except (ValueError, KeyError, IndexError, TypeError, AttributeError, RecursionError) as fault:
        raise ValueError("its description is damaged") from fault
    if packed:
        raise ValueError(f"it is packed with {packed[0]}")
    return Survey(points, points, max(counts, default=0) // 3)


def _ply(data: bytes, limit: Limit) -> Survey:
    end = re.search(rb"^end_header\b.*\n?", data[:_HEADER], re.MULTILINE)
    head = "" if end is None else data[: end.start()].decode("latin-1")
    form = re.search(r"^format[ \t]+(\w+)", head, re.MULTILINE)
    if end is None or form is None:
        raise ValueError("its header has no end, or does not say how it is written")
    elements = []  # name, count, and fewest lines or bytes of one
    for part in re.split(r"^element\b", head, flags=re.MULTILINE)[1:]:
        counted = re.match(r"\s+(\S+)\s+([0-9]{1,15})\s", part)
        if counted is None:
            raise ValueError("an element of its header has no count")
        types = re.findall(r"^property\s+(?:list\s+)?(\S+)", part, re.MULTILINE)  # a list always has at least its count
        least = 1 if form[1] == "ascii" else sum(_SIZES.get(name, 1) for name in types)
        elements.append((counted[1], int(counted[2]), least))
    declared = sum(count for name, count, _ in elements if name == "vertex")
    faces = sum(count for name, count, _ in elements if name != "vertex")
    if max(declared, faces) > limit.points:
        return Survey(declared, declared, faces)
    room = len(data) - end.end()
    if form[1] == "ascii":
        rows = (line for line in io.BytesIO(data[end.end() :]) if not line.isspace())
        room = sum(1 for _ in itertools.islice(rows, declared + faces))
    points, cut = declared, False
    for name, count, least in elements:
        there = min(count, room // max(least, 1))
        room -= there * least
        points = there if name == "vertex" else points
        cut |= there < count and name != "vertex"
    return Survey(points, declared, faces, cut)


SURVEYS: dict[str, Callable[[bytes, Limit], Survey]] = {"ply": _ply, "obj": _obj, "stl": _stl, "off": _off, "glb": _glb}
"""The survey of each kind of scan that trimesh reads; counting stops at the limit, and `ValueError` names what is damaged."""
