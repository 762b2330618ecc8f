"""Polylines in formats that are no tables, as the rows of one: JSON, WKT, OBJ, VTK, DXF, SWC, Abaqus, CATIA, CGAL and ROS.

Points that a file joins by edges, parents or segments are put in the order along them. A line that branches, is closed or in
pieces, and a file of several lines, are refused: which of them is the cable is the user's to say.
"""

import json
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from scan2flex_jax.study.tables import LENGTHS
from scan2flex_jax.study.values import Where

_HEAD = 4000  # characters of a text that show its format
_PARTS = ("points", "vertices", "coordinates", "positions", "controlpoints", "nodes")
_XYZ = re.compile(r"\bx:\s*([^\s,}]+)[\s,]+y:\s*([^\s,}]+)[\s,]+z:\s*([^\s,}]+)")
_PLACE = re.compile(r"\bposition:[\s{]*" + _XYZ.pattern)
_TURN = re.compile(r"\borientation:[\s{]*" + _XYZ.pattern + r"[\s,]+w:\s*([^\s,}]+)")
_ROS = re.compile(r"^[ -]*(poses|points):\s*(?:\[\s*\{|-\s)", re.MULTILINE)
_LINE_LIST = re.compile(r"^[ -]*type:\s*5\b", re.MULTILINE)  # a Marker of separate segments
_SEVERAL = "it holds several lines: keep the one that is the cable"


class Polyline(NamedTuple):
    """The points of a polyline, one a line of ``text``; the unit that the file states, and the one that its program uses."""

    text: str
    unit: str | None = None
    usual: str | None = None


def polyline_in(text: str, where: Where) -> Polyline | None:
    """The polyline in a text of one of these formats; None for another text. Raises `StudyError`."""
    for form, reader in _FORMS:
        if form.search(text[:_HEAD]):
            with _explained(where):
                found = reader(text)
            if found is not None:
                return found if isinstance(found, Polyline) else _rows(found)
    return None


def holds_messages(text: str) -> bool:
    """Whether a text begins as a ROS message with many points or poses, which is a curve and no clamp."""
    return bool(_ROS.search(text))


def ordered(edges: Iterable[Sequence[int]], points: Sequence[Any], where: Where) -> list[Any]:
    """The points in the order along their edges; raises `StudyError`."""
    with _explained(where):
        return _along(edges, points)


@contextmanager
def _explained(where: Where) -> Iterator[None]:
    """Faults of a reader as one sentence."""
    try:
        yield
    except _UnclearError as fault:
        raise where.fail(f"{fault}.") from None
    except (ValueError, IndexError, KeyError, TypeError, OverflowError) as fault:
        raise where.fail("its polyline is damaged: export it again.") from fault


def _along(edges: Iterable[Sequence[int]], points: Sequence[Any]) -> list[Any]:
    """The points in the order along their edges, which must be one open path; it begins where edges begin, if they say so."""
    near: dict[int, set[int]] = {}
    later = set()
    for a, b in edges:
        if a != b:
            near.setdefault(a, set()).add(b)
            near.setdefault(b, set()).add(a)
            later.add(b)
    if not near:
        raise ValueError
    fork = next((k for k, others in near.items() if len(others) > 2), None)
    if fork is not None:
        spot = ", ".join(str(x) for x in points[fork])
        raise _UnclearError(f"it branches at ({spot[:60]}): keep the one path that is the cable")
    ends = sorted(k for k, others in near.items() if len(others) == 1)
    if not ends:
        raise _UnclearError("it is a closed line: cut it where the cable begins")
    path = [next((k for k in ends if k not in later), ends[0])]
    while onward := near[path[-1]] - set(path[-2:]):
        path.append(onward.pop())
    if len(path) != len(near):
        raise _UnclearError(_SEVERAL)
    return [points[k] for k in path]


class _UnclearError(ValueError):
    """A file that is whole, and holds no single line."""


def _rows(points: Iterable[Sequence[Any]], unit: str | None = None, usual: str | None = None) -> Polyline:
    return Polyline("\n".join(" ".join(map(str, point)) for point in points), unit, usual)


def _joined(lines: Iterable[Iterable[Sequence[Any]]]) -> list[Any]:
    """The points along lines that meet in equal points."""
    at: dict[tuple[float, ...], int] = {}
    edges = list[tuple[int, int]]()
    for line in lines:
        edges += pairwise(at.setdefault(tuple(map(float, point)), len(at)) for point in line)
    return _along(edges, list(at))


def _triple(p: Any) -> list[Any] | None:
    """The coordinates of a point in JSON, if it is one."""
    if isinstance(p, dict):
        axes = [p.get(c, p.get(c.upper())) for c in "xyz"]
        return axes if None not in axes else _triple(p.get("position"))
    plain = isinstance(p, list) and len(p) == 3 and all(isinstance(c, (int, float)) for c in p)
    return p if plain else None


def _json(text: str) -> Polyline | None:
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError):
        return None  # as the braces around rows of points
    inside, found, unit, usual = [("", tree)], list[tuple[str, list[Any]]](), None, None
    for key, node in inside:
        if isinstance(node, dict):
            stated = [node.get(k) for k in ("coordinateUnits", "units", "unit")]
            words = [word for entry in stated for word in (entry if isinstance(entry, list) else [entry])]
            unit = next((word for word in words if isinstance(word, str) and word in LENGTHS), unit)
            usual = "mm" if "markups" in node else usual  # 3D Slicer's own unit
            axes = [node.get(c, node.get(c.upper())) for c in "xyz"]
            if all(isinstance(axis, list) for axis in axes):
                found.append((key, list(zip(*axes, strict=True))))
            else:
                inside += [(name.lower(), entry) for name, entry in node.items()]
        elif isinstance(node, list) and node:
            points = [_triple(p) for p in node]
            if None in points:
                inside += [(key, entry) for entry in node if isinstance(entry, (dict, list))]
            else:
                found.append((key, points))
    named = [points for key, points in found if key in _PARTS] or [points for _, points in found]
    if len(named) != 1:
        raise _UnclearError(_SEVERAL if named else "it holds no list of points x, y, z: export one")
    return _rows(named[0], unit, usual)


def _vtk(text: str) -> list[Any]:
    head = re.search(r"^POINTS\s+(\d+)\s+\w+", text, re.MULTILINE)
    words = text[head.end() :].split()[: 3 * int(head[1])] if head else []
    points = [words[k : k + 3] for k in range(0, len(words), 3)]
    lines = re.search(r"^LINES\s+(\d+)\s+\d+", text, re.MULTILINE)
    if lines is None:
        return points
    rest, ids = text[lines.end() :].split(), list[list[int]]()
    if rest[0] == "OFFSETS":  # legacy files of version 5
        offsets = list(map(int, rest[2 : 2 + int(lines[1])]))
        at = 4 + int(lines[1])
        ids = [list(map(int, rest[at + a : at + b])) for a, b in pairwise(offsets)]
    at = 0
    while len(ids) < int(lines[1]) and rest[0] != "OFFSETS":
        count = max(0, int(rest[at]))
        ids.append(list(map(int, rest[at + 1 : at + 1 + count])))
        at += 1 + count
    if min(map(min, ids)) < 0:
        raise ValueError
    return _joined([points[k] for k in line] for line in ids)


def _dxf(text: str) -> list[Any]:
    """The vertices of polylines and points in their order (groups 10, 20, 30), or lines end to end."""
    words = [line.strip() for line in text.splitlines()]
    pairs, entity, points = list(zip(words[::2], words[1::2], strict=False)), "", list[list[str]]()
    kinds = set()
    for code, value in pairs:
        if code == "0":
            entity = value
        elif entity in ("VERTEX", "POINT", "LWPOLYLINE", "SPLINE", "LINE") and code in ("10", "11"):
            points.append([value])
            kinds.add(entity)
        elif points and entity in ("VERTEX", "POINT", "SPLINE", "LINE") and code in ("20", "30", "21", "31"):
            points[-1].append(value)
    whole = [p for p in points if len(p) == 3]
    return _joined(zip(whole[::2], whole[1::2], strict=True)) if kinds == {"LINE"} else whole


def _obj(text: str) -> list[Any]:
    points = re.findall(r"^v\s+(\S+)\s+(\S+)\s+(\S+)", text, re.MULTILINE)
    lines = [[int(k.partition("/")[0]) for k in line.split()] for line in re.findall(r"^l\s+(.+)$", text, re.MULTILINE)]
    if any(abs(k) > len(points) or k == 0 for line in lines for k in line):
        raise ValueError
    return _joined([points[k - 1 if k > 0 else k] for k in line] for line in lines) if lines else points


def _swc(text: str) -> list[Any] | None:
    """Number, type, x, y, z, radius and parent of each point of a skeleton; None for another table."""
    rows = [line.split() for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    at = {row[0]: k for k, row in enumerate(rows)}
    if not all(len(row) == 7 and (row[6] in at or row[6] == "-1") for row in rows) or len(at) < len(rows):
        return None
    if not any(row[6] == "-1" for row in rows):
        return None
    return _along([(at[row[6]], k) for k, row in enumerate(rows) if row[6] != "-1"], [row[2:5] for row in rows])


def _abaqus(text: str) -> list[Any]:
    nodes, edges, section = dict[str, list[str]](), list[list[str]](), ""
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip().strip(",").split(",")]
        if line.startswith("*"):
            section = section if line.startswith("**") else cells[0].upper()
        elif section == "*NODE" and cells[0]:
            if cells[0] in nodes:
                raise _UnclearError(_SEVERAL)
            nodes[cells[0]] = cells[1:4]
        elif section == "*ELEMENT" and cells[0]:
            edges += map(list, pairwise(cells[1:]))
    at = {name: k for k, name in enumerate(nodes)}
    points = list(nodes.values())
    return _along([(at[a], at[b]) for a, b in edges], points) if edges else points


def _catia(text: str) -> Polyline:
    _, *curves = text.split("StartCurve")
    if len(curves) > 1:
        raise _UnclearError(_SEVERAL)
    return Polyline(curves[0][: curves[0].index("EndCurve")], usual="mm")


def _cgal(text: str) -> list[Any] | None:
    """Polylines, one a row: the number of its points, and their coordinates; None for another table."""
    rows = [row for line in text.splitlines() if (row := line.split())]
    if not all(row[0].isdecimal() and len(row) == 1 + 3 * int(row[0]) > 6 for row in rows):
        return None
    return _joined([row[k : k + 3] for k in range(1, len(row), 3)] for row in rows)


def _ros(text: str) -> list[Any] | None:
    """The points of a PoseArray, Path, Polygon or Marker; those of a Marker in its frame, which its pose places."""
    if len(heads := list(_ROS.finditer(text))) > 1 or len(re.findall(r"^---\s*\n(?=.*\S)", text, re.MULTILINE)) > 0:
        raise _UnclearError("it holds several messages: keep one")
    head, body = text[: heads[0].start()], text[heads[0].end() - 1 :]
    poses = heads[0][1] == "poses"
    found = (_PLACE if poses else _XYZ).findall(body)
    if len(found) != len(re.findall(r"\bposition:" if poses else r"\bx:", body)):
        raise ValueError
    points = np.array(found, float)
    if not poses and (turn := _TURN.search(head)) and (shift := _PLACE.search(head)):
        turned = np.array(turn.groups(), float)
        R = Rotation.from_quat(turned) if np.any(turned) else Rotation.identity()  # all zero: unset
        points = R.apply(points) + np.array(shift.groups(), float)
    return _joined(zip(points[::2], points[1::2], strict=True)) if _LINE_LIST.search(head) else points.tolist()


_FORMS: tuple[tuple[re.Pattern[str], Callable[[str], list[Any] | Polyline | None]], ...] = (
    (re.compile(r"\A\s*[\[{]\s*[\[{\"]"), _json),
    (re.compile(r"\A\s*(?:SRID=\d+;)?(?:LINESTRING|MULTIPOINT)\s*Z?M?\s*\(", re.IGNORECASE),
     lambda text: [p.split()[:3] for p in re.sub(r"[()]", " ", text.partition("(")[2]).split(",")]),
    (re.compile(r"\A# vtk DataFile"), _vtk),
    (re.compile(r"\A\s*0\r?\n\s*SECTION"), _dxf),
    (re.compile(r"^\*NODE\b(?!\s*(?:OUTPUT|PRINT|FILE))", re.MULTILINE | re.IGNORECASE), _abaqus),
    (re.compile(r"^StartCurve", re.MULTILINE), _catia),
    (re.compile(r"\A(?:\s*#.*\n)*\s*\d+\s+-?\d+(?:\s+[-+.\deE]+){4}\s+-?\d+\s*$", re.MULTILINE), _swc),
    (re.compile(r"\A\s*\d+(?:[ \t]+[-+.\deE]+){6,}\s*$", re.MULTILINE), _cgal),
    (_ROS, _ros),
    (re.compile(r"^v\s+[-+.\d]", re.MULTILINE), _obj),
)  # fmt: skip
