"""Files of scans and meshes as trimesh reads them: the bytes of the one file, and nothing that the file points to.

Given a path, trimesh follows what a file names (materials of an OBJ, buffers of a glTF), out of the study's folder too, and
writes its own faults to the screen. Given bytes it can do neither.
"""

import io
import logging
from pathlib import Path
from typing import Any

from scan2flex_jax.errors import Scan2FlexError

SCAN_LIMIT = 2_000_000_000
"""Bytes of a scan; ten million points take about 200 million."""


def load_geometry(path: Path) -> Any:
    """The trimesh object in a file; raises `Scan2FlexError` for one that is not there, too large or of no known kind."""
    import trimesh  # noqa: PLC0415  (it loads slowly, and studies of curves need none)

    if not path.is_file():
        raise Scan2FlexError(f"the scan {path} does not exist")
    if path.stat().st_size > SCAN_LIMIT:
        raise Scan2FlexError(f"the scan {path} is larger than {SCAN_LIMIT // 1_000_000} MB: give a smaller one")
    log = logging.getLogger("trimesh")
    level = log.level
    log.setLevel(logging.CRITICAL + 1)
    try:
        return trimesh.load(io.BytesIO(path.read_bytes()), file_type=path.suffix.removeprefix(".").lower())
    except Exception as fault:  # each of trimesh's readers fails in its own way
        raise unreadable(path, fault) from fault
    finally:
        log.setLevel(level)


def unreadable(path: Path, fault: Exception) -> Scan2FlexError:
    """One sentence for what trimesh made of a broken file."""
    reason = " ".join(f"{type(fault).__name__} {fault}".split())[:140]
    return Scan2FlexError(f"the scan {path} cannot be read as a point cloud: {reason}")
