"""Markers of motion-capture systems: wide tables of OptiTrack Motive and Vicon (CSV), C3D, and arrays of frames.

Tables of `rostopic echo -p`, and others with columns such as x1,y1,z1,x2,..., a frame a row, are wide too.

A file holds one pose at rest, of many frames; a marker is its mean over them, or its place in one of them. Markers that were
lost throughout are left out. Rigid bodies of Motive that are called "start" and "end" are the frames of the clamps.
"""

import csv
import re
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated

import numpy as np
from scipy.spatial.transform import Rotation

from scan2flex_jax.convert.units import length_unit
from scan2flex_jax.errors import Scan2FlexError, StudyError
from scan2flex_jax.study.files import read_text
from scan2flex_jax.study.limits import Limit, curve_limit
from scan2flex_jax.study.point_formats import read_apart
from scan2flex_jax.study.tables import LENGTHS
from scan2flex_jax.study.values import Where, one_line, shown

_UNITS = {"millimeters": "mm", "centimeters": "cm", "meters": "m", "inches": "in", "feet": "ft"}
_HEAD = 12  # most lines before the first frame
_AT_REST = 0.01  # of the markers' extent, RMS over the frames: a cable at rest varies by the noise, a tenth of this
_FEW = 3  # markers of a wide table: two may be the ends of segments
_COLUMN = re.compile(r"(.*?)(?:(?<![a-z])|(?<=pos)|(?<=position))([xyz])[_ ]?(\d*)(?:[\s_]*[\[(]([a-z]+)[\])])?", re.IGNORECASE)
_NO_PLACE = re.compile("orient|rot|quat|vel|acc|scale|normal|force|color", re.IGNORECASE)


@dataclass(frozen=True)
class Capture:
    """``points`` (frames, markers, 3) in ``unit``, NaN where a marker was lost; ``bodies`` by name: positions (frames, 3) and
    quaternions (frames, 4), scalar last."""

    names: tuple[str, ...]
    points: Annotated[np.ndarray, "f n 3"]
    unit: str | None
    bodies: dict[str, tuple[np.ndarray, np.ndarray]]

    @np.errstate(all="ignore")  # numbers that are not finite are refused later, with their place
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
            if moved > _AT_REST * np.linalg.norm(np.ptp(points[seen], axis=0)):
                said = f"a coordinate varies by {moved:.2g} {self.unit or 'm'} (RMS) over its {count} frames"
                raise where.fail(f"{said}, so it was not at rest: name one of them with --frame.")
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


def captured(path: Path) -> Capture | None:
    """The motion capture in a file; None for another file. Raises `StudyError`."""
    path, limit, where = Path(path), curve_limit(), Where(one_line(str(path), 300))
    if path.suffix.lower() == ".c3d":
        return read_c3d(path)
    if path.suffix.lower() == ".npy":
        array = load_array(path, limit, where)
        return capture_of(array, where) if array.ndim == 3 else None
    if path.suffix.lower() != ".csv":
        return None
    try:
        return capture_in(read_text(path, limit.bytes, where, "the file is not there: name one.", limit, foreign=True))
    except csv.Error:
        return None  # a line or a field that no table has


def read_arc_lengths(path: Path, *, units: str | None = None) -> dict[str, float]:
    """Arc lengths (m) of markers by name, from a CSV with the header ``name,s``; raises `StudyError`."""
    where, limit = Where(one_line(str(path), 300)), curve_limit()
    text = read_text(Path(path), limit.bytes, where, "the file is not there: name one.", limit, foreign=True)
    lines = [[cell.strip() for cell in re.split("[;,\t]", line)] for line in text.splitlines() if line.strip()]
    if not lines or [cell.lower() for cell in lines[0]] != ["name", "s"]:
        raise where.at("header").fail("write the header name,s.")
    found = {}
    for k, cells in enumerate(lines[1:]):
        try:
            name, s = cells
            found[name] = length_unit(units or "m") * float(s)
        except ValueError:
            raise where.at(f"line {k + 2}").fail(f"got {shown(','.join(cells))}: write a name and a number.") from None
    return found


def load_array(path: Path, limit: Limit, where: Where) -> np.ndarray:
    """The array in a .npy file, of at most as many points as the limit; raises `StudyError`."""
    try:
        array = np.load(path, mmap_mode="r", allow_pickle=False)
        limit.check(path, array.size // 3)
        return np.array(array)
    except Scan2FlexError:
        raise
    except Exception as fault:  # damaged files fail in many ways
        raise where.fail("it cannot be read as an array of numpy: save it again, as numpy.save does.") from fault


def capture_of(array: np.ndarray, where: Where) -> Capture:
    """The capture in an array of the shape (frames, points, 3) or (frames, 3, points)."""
    if 3 not in array.shape[1:] or array.shape[1:] == (3, 3) or array.dtype.kind not in "fiu":
        raise where.fail(f"an array of the shape {array.shape} holds no frames of points: save one of (frames, points, 3).")
    points = np.array(array if array.shape[2] == 3 else array.swapaxes(1, 2), float)
    return Capture(tuple(f"point {k + 1}" for k in range(points.shape[1])), points, None, {})


def _wide(text: str) -> Capture | None:
    """The capture in a table with the numbered columns x1, y1, z1, x2, ... or m1_x, m1_y, ..., a frame a row."""
    head = text[: text.find("\n")].strip("\r")
    mark = max(",;\t", key=head.count)
    markers: dict[str, dict[str, int]] = {}
    units = set[str]()
    for k, cell in enumerate(next(csv.reader([head], delimiter=mark), [])):
        found = _COLUMN.fullmatch(cell.strip())
        if found and re.search(r"\d", found[1] + found[3]) and not _NO_PLACE.search(found[1]):
            markers.setdefault(f"{found[1]}{found[3]}".strip(" ._:"), {})[found[2].lower()] = k
            units |= {found[4]} if found[4] in LENGTHS else set()
    whole = {name: [axes[c] for c in "xyz"] for name, axes in markers.items() if len(axes) == len("xyz")}
    if len(whole) < _FEW or len(whole) < len(markers) or len(units) > 1:
        return None
    body = [row for row in csv.reader(text.splitlines()[1:], delimiter=mark) if any(row)]
    cells = [[[row[k] if k < len(row) else "" for k in at] for at in whole.values()] for row in body]
    points = [[[_number(c if mark == "," else c.replace(",", ".")) for c in cell] for cell in row] for row in cells]
    return Capture(tuple(whole), np.array(points, float).reshape(-1, len(whole), 3), next(iter(units), None), {})


def capture_in(text: str) -> Capture | None:
    """The capture in the text of a CSV of Motive or Vicon, or in a wide table; None for another text."""
    if (wide := _wide(text)) is not None:
        return wide
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
