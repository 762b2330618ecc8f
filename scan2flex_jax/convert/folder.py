"""The measurements of a new study: one file a pose, in a folder or listed, with what each holds by its name and contents."""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from scan2flex_jax.convert.curves import is_polyline
from scan2flex_jax.convert.frames import holds_frames
from scan2flex_jax.convert.motion_capture import load_array
from scan2flex_jax.errors import Scan2FlexError, StudyError
from scan2flex_jax.study.files import STUDY_FILE
from scan2flex_jax.study.limits import scan_limit
from scan2flex_jax.study.scans import KINDS, load_geometry
from scan2flex_jax.study.values import Where

CURVES = (
    ".csv", ".txt", ".dat", ".asc", ".tsv", ".npy", ".json", ".wkt", ".vtk", ".dxf", ".sldcrv", ".c3d", ".yaml", ".yml", ".swc",
    ".inp", ".cgal",
)  # fmt: skip
SCANS = tuple(kind for name in KINDS if (kind := f".{name}") not in CURVES)
_SCAN = 100_000  # bytes of a table from which it may be a scan
_TANGLED = 10.0  # times the extent of the points: the path through them in the order of the file, where it is a scan


@dataclass(frozen=True)
class MeasuredFile:
    """One pose in a folder: its name, and the files with its centre curve, its scan and its guide points."""

    name: str
    curve: Path | None = None
    scan: Path | None = None
    guides: Path | None = None


def folder_of(given: Path | Sequence[Path]) -> Path:
    """The folder of a new study: the one that is given, or else the deepest that holds all given files."""
    if isinstance(given, Path):
        return given
    return Path(os.path.commonpath([path.resolve().parent for path in given]))


def measured_files(given: Path | Sequence[Path], leave_out: tuple[Path, ...] = ()) -> list[MeasuredFile]:
    """The poses of a folder, in natural order of their names (pose-2 before pose-10), or those of files, in the order given.

    Raises `Scan2FlexError`.
    """
    if (toml := folder_of(given) / STUDY_FILE).exists():
        raise StudyError(toml, None, "there is a study already: edit it, or name another folder.")
    found: dict[str, MeasuredFile] = {}
    for path in _in_folder(given, leave_out) if isinstance(given, Path) else _each_file(given):
        kind, guides = path.suffix.lower(), path.stem.endswith("-guides")
        if kind in CURVES and holds_frames(path):
            raise Scan2FlexError(f"{path} holds frames, not a curve: name it with --clamps, or put it in another folder.")
        name = path.stem.removesuffix("-guides") if guides else path.stem
        slot = "guides" if guides else "scan" if _is_scan(path) else "curve"
        pose = found.get(name, MeasuredFile(name))
        if getattr(pose, slot) is not None:
            raise Scan2FlexError(f"{path.name} and {getattr(pose, slot).name} are two of a kind for one pose: rename one.")
        change: dict[str, Any] = {slot: path}
        found[name] = replace(pose, **change)
    poses = [pose for pose in found.values() if pose.curve or pose.scan]
    if not poses:
        said = f"{folder_of(given)} holds no scans or centre curves ({', '.join(CURVES + SCANS)})"
        raise Scan2FlexError(f"{said}: put them there, one file a pose.")
    return poses


def _in_folder(folder: Path, leave_out) -> list[Path]:
    """The measurements in a folder, in natural order."""
    if not folder.is_dir():
        raise Scan2FlexError(f"{folder} is not a folder: name the one that holds the scans or centre curves.")
    skip = {path.resolve() for path in leave_out}
    files = [p for p in folder.iterdir() if p.is_file() and not p.name.startswith(".") and p.resolve() not in skip]
    measured = [p for p in files if p.suffix.lower() in CURVES + SCANS]
    return sorted(measured, key=lambda p: [int(t) if t.isdecimal() else t for t in re.split(r"(\d+)", p.name.lower())])


def _each_file(paths: Sequence[Path]) -> Sequence[Path]:
    """The files, each of a kind that can be read."""
    for path in paths:
        if not path.is_file():
            raise Scan2FlexError(f"{path} is no file: name the files of the poses, or their folder alone.")
        if path.suffix.lower() not in CURVES + SCANS:
            raise Scan2FlexError(f"{path} is no scan or centre curve: its name ends in none of {', '.join(CURVES + SCANS)}.")
    return paths


def _is_scan(path: Path) -> bool:
    """Whether a file is a cloud or a mesh, or a large table of points in no order along a cable."""
    kind = path.suffix.lower()
    if kind in SCANS or kind.removeprefix(".") not in KINDS or path.stat().st_size < _SCAN:
        return kind in SCANS and not is_polyline(path)
    if kind == ".npy" and load_array(path, scan_limit(), Where(path.name)).ndim == 3:
        return False  # frames
    try:
        points = np.asarray(load_geometry(path).vertices, float)
    except StudyError:
        return False  # no points in space: what it is, the reader of curves says
    points = points[np.isfinite(points).all(axis=1)]
    along = np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1))
    return bool(along > _TANGLED * np.linalg.norm(np.ptp(points, axis=0)))
