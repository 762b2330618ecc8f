"""Files of scans and meshes as trimesh reads them: the bytes of the one file, and nothing that the file points to.

Given a path, trimesh follows what a file names (materials of an OBJ, buffers of a glTF), out of the study's folder too, and
writes its own faults to the screen. Given bytes it can do neither.
"""

import io
import logging
from pathlib import Path
from typing import Any

import numpy as np

from scan2flex_jax.errors import StudyError

SCAN_LIMIT = 2_000_000_000
"""Bytes of a scan; ten million points take about 200 million."""


def load_geometry(path: Path) -> Any:
    """The trimesh object in a file; raises `StudyError` for one that is not there, too large or of no known kind."""
    import trimesh  # noqa: PLC0415  (it loads slowly, and studies of curves need none)

    if not path.is_file():
        raise StudyError(path, None, "the scan is not there: put it back, or correct its name.")
    if path.stat().st_size > SCAN_LIMIT:
        raise StudyError(path, None, f"the scan is larger than {SCAN_LIMIT // 1_000_000} MB: thin it out.")
    log = logging.getLogger("trimesh")
    level = log.level
    log.setLevel(logging.CRITICAL + 1)
    try:
        return trimesh.load(io.BytesIO(path.read_bytes()), file_type=path.suffix.removeprefix(".").lower())
    except Exception as fault:  # each of trimesh's readers fails in its own way
        raise unreadable(path, fault) from fault
    finally:
        log.setLevel(level)


def unreadable(path: Path, fault: Exception) -> StudyError:
    """One sentence for what trimesh made of a broken file."""
    reason = " ".join(f"{type(fault).__name__} {fault}".split())[:140]
    return StudyError(path, None, f"it cannot be read as a point cloud ({reason}): export it again, as PLY or XYZ.")


def scan_facts(path: Path) -> tuple[int, np.ndarray]:
    """``(points, size)`` of a scan: how many it has, and the extents (3,) of their box in the unit of the file."""
    loaded = load_geometry(path)
    try:
        parts = list(loaded.geometry.values()) if hasattr(loaded, "geometry") else [loaded]
        vertices = [np.asarray(part.vertices, float).reshape(-1, 3) for part in parts if hasattr(part, "vertices")]
        points = np.concatenate(vertices) if vertices else np.zeros((0, 3))
    except (ValueError, IndexError, TypeError) as fault:
        raise unreadable(path, fault) from fault
    points = points[np.all(np.isfinite(points), axis=1)]
    return len(points), np.ptp(points, axis=0) if len(points) else np.zeros(3)
