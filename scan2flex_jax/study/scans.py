"""Files of scans and meshes: read by a reader of `point_formats`, or by trimesh after a survey.

A file that is too large, truncated or empty is refused in one sentence without using memory. A packed file (.gz, or a .zip of
one scan) is unpacked and counted here, since an archive's own size entry may be wrong. trimesh gets the bytes of the one file:
given a path, it follows references to other files (materials of an OBJ), also out of the study's folder, and prints its own
errors.
"""

import gzip
import io
import logging
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from scan2flex_jax.errors import Scan2FlexError, StudyError
from scan2flex_jax.study.limits import Limit, scan_limit
from scan2flex_jax.study.point_formats import READERS
from scan2flex_jax.study.survey import SURVEYS, Survey

KINDS = (*SURVEYS, *READERS)
"""The kinds of scans that are read, by ending."""
_BLOCK = 1 << 20
_ADVICE = "export it again, as PLY or XYZ."
_NOTES = {"txt", "csv", "dat", "tsv"}
"""Kinds that an archive may hold beside its scan."""
_NAMES = ", ".join(f".{kind}" for kind in KINDS)


def load_geometry(path: Path) -> Any:
    """The trimesh object in a file; raises `StudyError` for a missing, too large, truncated or empty one."""
    limit = scan_limit()
    try:
        if not path.is_file():
            raise StudyError(path, None, "the scan is not there: put it back, or correct its name.")
        with path.open("rb") as stream:
            kind, data = _unpacked(path, stream, limit)
            return _read_points(path, kind, data, limit) if kind in READERS else _read_mesh(path, kind, data.read(), limit)
    except Scan2FlexError:
        raise
    except ImportError as fault:
        advice = "install it with: pip install 'scan2flex_jax[scans]', or export the scan as PLY."
        raise StudyError(path, None, f"it needs a library that is not installed ({fault.name}): {advice}") from fault
    except Exception as fault:  # each library fails in its own way
        raise unreadable(path, fault) from fault


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


def _read_points(path: Path, kind: str, data: io.BufferedIOBase, limit: Limit) -> Any:
    import trimesh  # noqa: PLC0415  (it loads slowly, and studies of curves need none)

    cloud = READERS[kind](data, path, limit)
    _check(path, Survey(len(cloud.points), max(len(cloud.points), cloud.declared)), limit)
    return trimesh.PointCloud(cloud.points, metadata={"notes": cloud.notes, "unit": cloud.unit})


def _read_mesh(path: Path, kind: str, data: bytes, limit: Limit) -> Any:
    import trimesh  # noqa: PLC0415

    _check(path, SURVEYS[kind](data, limit), limit)
    log = logging.getLogger("trimesh")
    level = log.level
    log.setLevel(logging.CRITICAL + 1)
    try:
        return trimesh.load(io.BytesIO(data), file_type=kind)
    finally:
        log.setLevel(level)


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
        points = np.concatenate(vertices) if vertices else np.zeros((0, 3))
    except (ValueError, IndexError, TypeError) as fault:
        raise unreadable(path, fault) from fault
    points = points[np.all(np.isfinite(points), axis=1)]
    if not len(points):
        raise StudyError(path, None, f"the scan holds no points: {_ADVICE}")
    return len(points), np.ptp(points, axis=0)
