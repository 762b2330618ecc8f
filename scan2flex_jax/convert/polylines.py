"""Polylines in formats that are no tables (JSON, WKT, OBJ, VTK, DXF), rewritten as the rows of one."""

import json
import re
from collections.abc import Callable
from typing import Any


def rows_of_polyline(text: str) -> str | None:
    """The points of a polyline in JSON, WKT, OBJ, VTK or DXF as rows of a table; None for another text."""
    reader = next((points for form, points in _FORMS if form.search(text[:4000])), None)
    triples = None if reader is None else reader(text)
    return "\n".join(" ".join(map(str, triple)) for triple in triples) if triples else None


def _json(text: str) -> list[Any] | None:
    try:
        tree = json.loads(text)
    except (ValueError, RecursionError):
        return None
    inside = [tree]
    while inside:
        node = inside.pop(0)
        if isinstance(node, dict):
            axes = [node.get(c, node.get(c.upper())) for c in "xyz"]
            if all(isinstance(axis, list) for axis in axes):
                return list(zip(*axes, strict=False))
            inside += node.values()
        elif isinstance(node, list) and node:
            if all(isinstance(p, dict) and {"x", "y", "z"} <= set(p) for p in node):
                return [(p["x"], p["y"], p["z"]) for p in node]
            if all(isinstance(p, list) and len(p) == 3 and all(isinstance(c, (int, float)) for c in p) for p in node):
                return node
            inside += node
    return None


def _vtk(text: str) -> list[Any]:
    head = re.search(r"^POINTS\s+(\d+)\s+\w+", text, re.MULTILINE)
    words = text[head.end() :].split()[: 3 * int(head[1])] if head else []
    return [words[k : k + 3] for k in range(0, len(words), 3)]


def _dxf(text: str) -> list[Any]:
    """The vertices of polylines, points, and ends of lines, in their order: groups 10, 20, 30."""
    words = [line.strip() for line in text.splitlines()]
    pairs, entity, points = list(zip(words[::2], words[1::2], strict=False)), "", list[list[str]]()
    for code, value in pairs:
        if code == "0":
            entity = value
        elif entity in ("VERTEX", "POINT", "LWPOLYLINE", "SPLINE", "LINE") and code in ("10", "11"):
            points.append([value])
        elif points and entity in ("VERTEX", "POINT", "SPLINE", "LINE") and code in ("20", "30", "21", "31"):
            points[-1].append(value)
    return [p for p in points if len(p) == 3]


_FORMS: tuple[tuple[re.Pattern[str], Callable[[str], list[Any] | None]], ...] = (
    (re.compile(r"\A\s*[\[{]\s*[\[{\"]"), _json),
    (re.compile(r"\A\s*(?:SRID=\d+;)?(?:LINESTRING|MULTIPOINT)\s*Z?M?\s*\(", re.IGNORECASE),
     lambda text: [p.split()[:3] for p in re.sub(r"[()]", " ", text.partition("(")[2]).split(",")]),
    (re.compile(r"\A# vtk DataFile"), _vtk),
    (re.compile(r"\A\s*0\r?\n\s*SECTION"), _dxf),
    (re.compile(r"^v\s+[-+.\d]", re.MULTILINE), lambda text: re.findall(r"^v\s+(\S+)\s+(\S+)\s+(\S+)", text, re.MULTILINE)),
)  # fmt: skip
