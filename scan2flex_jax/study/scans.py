"""Files of scans and meshes: read by a reader of `point_formats`, or by trimesh after a survey.

A survey counts what a mesh, or a cloud in a format of meshes, holds: from its header, or by counting its lines, so that a file
that is too large, truncated or empty is refused without using memory. A packed file (.gz, or a .zip of one scan) is counted as
it is unpacked, since an archive's own size entry may be wrong. trimesh gets the bytes of the one file: given a path, it follows
references to other files (materials of an OBJ), also out of the study's folder, and prints its own errors.
"""

import gzip
import io
import itertools
import json
import logging
import re
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from scan2flex_jax.errors import Scan2FlexError, StudyError
from scan2flex_jax.study.limits import Limit, scan_limit
from scan2flex_jax.study.point_formats import READERS

_SIZES = {
    "char": 1, "uchar": 1, "int8": 1, "uint8": 1, "short": 2, "ushort": 2, "int16": 2, "uint16": 2, "float16": 2, "int": 4,
    "uint": 4, "int32": 4, "uint32": 4, "float": 4, "float32": 4, "int64": 8, "uint64": 8, "double": 8, "float64": 8,
}  # fmt: skip
_HEADER = 100_000  # bytes of a header in text
_STL_HEAD, _STL_TRIANGLE = 84, 50
_PACKING = ("KHR_draco_mesh_compression", "EXT_meshopt_compression")


class Survey(NamedTuple):
    """`points` is the number for which a file has room, `declared` the number in its header (the same for formats without one);
    `cut`: there are fewer faces than in the header; `unit`: of the points."""

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
        there = declared = _count(rb"^[ \t]*vertex", data) // 3
    elif len(data) < _STL_HEAD:
        raise ValueError("it is too short for an STL")
    else:
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
        stream = io.BytesIO(data)  # shares them
        stream.seek(end.end())
        room = sum(1 for _ in itertools.islice((line for line in stream if not line.isspace()), declared + faces))
    points, cut = declared, False
    for name, count, least in elements:
        there = min(count, room // max(least, 1))
        room -= there * least
        points = there if name == "vertex" else points
        cut |= there < count and name != "vertex"
    return Survey(points, declared, faces, cut)


SURVEYS: dict[str, Callable[[bytes, Limit], Survey]] = {"ply": _ply, "obj": _obj, "stl": _stl, "off": _off, "glb": _glb}
"""The survey of each kind of scan that trimesh reads; counting stops at the limit, and `ValueError` names what is damaged."""
KINDS = (*SURVEYS, *READERS)  # the kinds of scans that are read, by ending
_BLOCK = 1 << 20
_ADVICE = "export it again, as PLY or XYZ."
_NOTES = {"txt", "csv", "dat", "tsv"}  # kinds that an archive may hold beside its scan
_NAMES = ", ".join(f".{kind}" for kind in KINDS)


def load_geometry(path: Path) -> Any:
    """The trimesh object in a file; raises `StudyError` for a missing, too large, truncated or empty one."""
    import trimesh  # noqa: PLC0415  (it loads slowly, and studies of curves need none)

    limit, log = scan_limit(), logging.getLogger("trimesh")
    level = log.level
    try:
        if not path.is_file():
            raise StudyError(path, None, "the scan is not there: put it back, or correct its name.")
        with path.open("rb") as stream:
            kind, data = _unpacked(path, stream, limit)
            if kind in READERS:
                cloud = READERS[kind](data, path, limit)
                _check(path, Survey(len(cloud.points), max(len(cloud.points), cloud.declared)), limit)
                return trimesh.PointCloud(cloud.points, metadata={"notes": cloud.notes, "unit": cloud.unit})
            content = data.read()
        _check(path, SURVEYS[kind](content, limit), limit)
        log.setLevel(logging.CRITICAL + 1)
        return trimesh.load(io.BytesIO(content), file_type=kind)
    except Scan2FlexError:
        raise
    except ImportError as fault:
        advice = "install it with: pip install 'scan2flex_jax[scans]', or export the scan as PLY."
        raise StudyError(path, None, f"it needs a library that is not installed ({fault.name}): {advice}") from fault
    except Exception as fault:  # each library fails in its own way
        raise unreadable(path, fault) from fault
    finally:
        log.setLevel(level)


def _unpacked(path: Path, stream: Any, limit: Limit) -> tuple[str, io.BufferedIOBase]:
    """The kind of a scan, and its bytes as a stream; those of an archive are counted up to the limit."""
    name, ending, size = path.name, path.suffix.lower(), path.stat().st_size
    if ending == ".zip":
        archive = zipfile.ZipFile(stream)
        kinds = {m: _kind(m.filename) for m in archive.infolist()}
        scans = [m for m, kind in kinds.items() if kind in set(KINDS) - _NOTES] or [m for m in kinds if kinds[m] in KINDS]
        if len(scans) != 1:
            raise StudyError(path, None, f"the archive holds {len(scans)} scans ({_NAMES}): pack one.")
        name, size, stream = scans[0].filename, scans[0].file_size, archive.open(scans[0])
    elif ending == ".gz":
        name, size, stream = path.stem, 0, gzip.GzipFile(fileobj=stream)
    limit.check_bytes(path, size)
    if (kind := _kind(name)) not in KINDS:
        raise StudyError(path, None, f"it is none of the kinds of scans that are read ({_NAMES}): {_ADVICE}")
    if ending not in (".zip", ".gz"):
        return kind, stream
    data = io.BytesIO()
    while block := stream.read(_BLOCK):
        data.write(block)
        limit.check_bytes(path, data.tell())
    data.seek(0)
    return kind, data


def _kind(name: str) -> str:
    return Path(name).suffix.lower().removeprefix(".")


def _check(path: Path, counts: Survey, limit: Limit) -> None:
    """Refuse a file that is too large, empty, or shorter than its own header states."""
    limit.check(path, max(counts.points, counts.declared), counts.unit)
    limit.check(path, counts.faces, "faces")
    if counts.points < counts.declared:
        said = f"its header says {counts.declared} {counts.unit}, and there are {counts.points}"
        raise StudyError(path, None, f"{said}: it was cut short; {_ADVICE}")
    if counts.points == 0:
        raise StudyError(path, None, f"the scan holds no points: {_ADVICE}")
    if counts.cut:
        raise StudyError(path, None, f"it ends before its {counts.faces} faces do: it was cut short; {_ADVICE}")


def unreadable(path: Path, fault: Exception) -> StudyError:
    """One sentence for a reader's exception on a broken file."""
    kind = "" if isinstance(fault, ValueError) and str(fault) else type(fault).__name__
    reason = " ".join(f"{kind} {fault}".split())[:140]
    return StudyError(path, None, f"it cannot be read as a point cloud ({reason}): {_ADVICE}")


def scan_facts(path: Path) -> tuple[int, np.ndarray]:
    """``(points, size)`` of a scan: the number of points, and the extents (3,) of their box in the unit of the file."""
    loaded = load_geometry(path)
    try:
        parts = list(loaded.geometry.values()) if hasattr(loaded, "geometry") else [loaded]
        vertices = [np.asarray(part.vertices, float).reshape(-1, 3) for part in parts if hasattr(part, "vertices")]
        points = np.concatenate([np.zeros((0, 3)), *vertices])
    except (ValueError, IndexError, TypeError) as fault:
        raise unreadable(path, fault) from fault
    points = points[np.all(np.isfinite(points), axis=1)]
    if not len(points):
        raise StudyError(path, None, f"the scan holds no points: {_ADVICE}")
    return len(points), np.ptp(points, axis=0)
