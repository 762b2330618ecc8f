"""Markers of motion-capture systems: wide tables of OptiTrack Motive and Vicon (CSV), and C3D.

A file holds one pose at rest, of many frames; a marker is its mean over them, or its place in one of them. Markers that were
lost throughout are left out. Rigid bodies of Motive that are called "start" and "end" are the frames of the clamps.
"""

import csv
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import numpy as np
from scipy.spatial.transform import Rotation

from scan2flex_jax.errors import StudyError
from scan2flex_jax.study.point_formats import read_apart
from scan2flex_jax.study.tables import LENGTHS
from scan2flex_jax.study.values import Where

_UNITS = {"millimeters": "mm", "centimeters": "cm", "meters": "m", "inches": "in", "feet": "ft"}
_HEAD = 12  # most lines before the first frame


@dataclass(frozen=True)
class Capture:
    """``points`` (frames, markers, 3) in ``unit``, NaN where a marker was lost; ``bodies`` by name: positions (frames, 3) and
    quaternions (frames, 4), scalar last."""

    names: tuple[str, ...]
    points: Annotated[np.ndarray, "f n 3"]
    unit: str | None
    bodies: dict[str, tuple[np.ndarray, np.ndarray]]

    def still(self, frame: int | None, where: Where) -> tuple[list[str], Annotated[np.ndarray, "m 3"], list[str]]:
        """Names and places of the markers in one frame (counted from 0), or their means; and notes."""
        there, count = ~np.isnan(self.points).any(axis=2), len(self.points)
        if frame is not None and not 0 <= frame < count:
            raise where.fail(f"frame {frame} is not among its {count} (counted from 0).")
        if frame is not None or count == 1:
            frame = frame or 0
            seen, points, said = there[frame], self.points[frame], f"frame {frame} of {count}"
        else:
            seen = there.any(axis=0)
            points = np.full(self.points.shape[1:], np.nan)
            points[seen] = np.nanmean(self.points[:, seen], axis=0)
            moved = np.sqrt(np.nanmean((self.points[:, seen] - points[seen]) ** 2)) if seen.any() else 0.0
            said = f"means of {count} frames, about which a coordinate varies by {moved:.2g} {self.unit or 'm'} (RMS)"
        lost = [name for name, ok in zip(self.names, seen, strict=True) if not ok]
        partly = [name for name, ok in zip(self.names, seen & ~there.all(axis=0), strict=True) if ok and frame is None]
        notes = [f"{int(seen.sum())} markers, {said}"]
        notes += [f"lost and left out: {', '.join(lost)}"] * bool(lost)
        notes += [f"lost in some frames: {', '.join(partly)}"] * bool(partly)
        return [name for name, ok in zip(self.names, seen, strict=True) if ok], points[seen], notes

    def frames(self, frame: int | None) -> dict[str, np.ndarray]:
        """The 4x4 matrices of the rigid bodies, by name, in one frame or as means."""
        out = {}
        for name, (position, quaternion) in self.bodies.items():
            at = slice(None) if frame is None else slice(frame, frame + 1)
            ok = ~np.isnan(np.hstack([position, quaternion])[at]).any(axis=1)
            if ok.any():
                out[name] = np.eye(4)
                out[name][:3, :3] = Rotation.from_quat(quaternion[at][ok]).mean().as_matrix()
                out[name][:3, 3] = position[at][ok].mean(axis=0)
        return out


def capture_in(text: str) -> Capture | None:
    """The capture in the text of a CSV of Motive or Vicon; None for another text."""
    rows = list(csv.reader(text.splitlines()[:_HEAD]))
    axes = [[cell.strip().upper() for cell in row] for row in rows]
    head = next((i for i, row in enumerate(axes) if row.count("X") == row.count("Y") == row.count("Z") >= 2), None)
    if not head:
        return None
    motive = rows[0][:1] == ["Format Version"]
    labels = {row[1]: row for row in rows[:head] if len(row) > 2 and row[1]} if motive else {}
    of = labels.get("Name", rows[head - 1])
    kinds, turned = labels.get("Type", []), rows[head - 1] if motive else []
    settings = dict(zip(rows[0][::2], rows[0][1::2], strict=False)) if motive else {}
    unit = _UNITS.get(settings.get("Length Units", "").lower()) if motive else None
    skip = head + 1
    if not motive and skip < len(rows) and any(cell in LENGTHS for cell in rows[skip]):  # Vicon states units below the axes
        unit, skip = next(cell for cell in rows[skip] if cell in LENGTHS), skip + 1
    body = [row for row in csv.reader(text.splitlines()[skip:]) if any(row)]
    table = np.array([[_number(row[k]) if k < len(row) else np.nan for k in range(len(axes[head]))] for row in body])
    names, at = list[str](), list[int]()
    bodies: dict[str, dict[str, int]] = {}
    for k, cell in enumerate(axes[head]):
        if cell != "X":
            continue
        name = (of[k] if k < len(of) else "").rpartition(":")[2].strip() or f"marker {len(names) + 1}"
        if k < len(kinds) and kinds[k] in ("Rigid Body", "Bone"):
            bodies.setdefault(name, {})["turn" if turned[k] == "Rotation" else "place"] = k
        elif k >= len(kinds) or kinds[k] == "Marker":
            names.append(name)
            at.append(k)
    points = np.stack([table[:, k : k + 3] for k in at], axis=1) if at else np.zeros((len(table), 0, 3))
    whole = {n: (c["place"], c["turn"]) for n, c in bodies.items() if len(c) == 2}
    held = {n: (table[:, place : place + 3], table[:, turn : turn + 4]) for n, (place, turn) in whole.items()}
    return Capture(tuple(names), points, unit, held)


def _number(cell: str) -> float:
    try:
        return float(cell)
    except ValueError:
        return np.nan


_READ_C3D = """
import sys, ezc3d, numpy
file = ezc3d.c3d(sys.argv[1])
known = {name: file["parameters"]["POINT"].get(name, {}).get("value", []) for name in ("LABELS", "UNITS")}
words = {name.lower(): numpy.array(value, str) for name, value in known.items()}
numpy.savez(sys.argv[2], points=file["data"]["points"], **words)
"""


def read_c3d(path: Path) -> Capture:
    """The capture in a C3D file; raises `StudyError`."""
    if find_spec("ezc3d") is None:
        advice = "install it with: pip install 'scan2flex_jax[scans]', or export a CSV."
        raise StudyError(path, None, f"C3D needs a library that is not installed (ezc3d): {advice}")
    try:
        found = read_apart(_READ_C3D, str(path))
    except ValueError as fault:
        raise StudyError(path, None, "it cannot be read as a C3D file: export it again, or as a CSV.") from fault
    points, labels, units = (found[name] for name in ("points", "labels", "units"))
    unit = next((str(u) for u in units if u in LENGTHS), None)
    names = tuple(str(name).rpartition(":")[2] for name in labels[: points.shape[1]])
    points = np.moveaxis(points[:3], 0, 2).swapaxes(0, 1)
    return Capture(names, points, unit, {})
