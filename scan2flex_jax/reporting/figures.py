"""The figures of a report: those of `plot` as SVG inside the page, and optionally all poses in space with plotly.

SVG needs no script. Its texts remain text, escaped by matplotlib; ink and grid take the colours of the page, light or dark.
plotly reads texts as HTML, so every text of a study goes through `html.escape`. Lengths in space are in m, distances in mm.
"""

import io
import re
from collections.abc import Callable, Mapping
from html import escape
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from scan2flex_jax import plot
from scan2flex_jax.inference import PoseFit
from scan2flex_jax.reporting.html import Html
from scan2flex_jax.study.model import Study

MODELLED = "#8a8f98"
_INK = "#010203"  # stands for the page's own colour of text
_OF_PAGE = {**dict.fromkeys((_INK, "#000000"), "var(--ink)"), plot.MEASURED: "var(--measured)", plot.BAND: "var(--grid)"}
_STYLE: Any = {
    "svg.fonttype": "none", "svg.hashsalt": "scan2flex", "axes.spines.top": False, "axes.spines.right": False,
    **dict.fromkeys(("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color"), _INK),
}  # fmt: skip
_CLAMP = "#e69f00"
_DISTANCE = ((0.0, "#2a9d8f"), (0.5, "#e9b44c"), (1.0, "#e63946"))
_THINNEST = 0.15  # of its longest side: least thickness of the box, for plane shapes
_SIDE = 1.3  # of the longest, in units of plotly's cube
_MARGIN = 0.06  # of its longest side: free space on all sides, which a clamp's line needs
_TANGENT = 0.05  # of the picture's size: length of the line that shows a clamp's d3


def svg(draw: Callable[[Axes], object], width: float, height: float, alt: str) -> Html:
    """The drawing made by ``draw(axes)``, ``width`` by ``height`` inches, and narrower on a narrow page.

    ``alt`` is its text alternative.
    """
    with mpl.rc_context(_STYLE):
        figure, out = Figure(figsize=(width, height), layout="constrained"), io.StringIO()
        draw(figure.add_subplot())
        nothing = dict.fromkeys(("Date", "Creator", "Format", "Type"))
        figure.savefig(out, format="svg", transparent=True, metadata=nothing)
    text = out.getvalue()
    text = re.sub(r' id="(?:figure|axes|patch|line2d|text|xtick|ytick|legend|matplotlib|Poly|Fill|Path|Quad|Line)[\w.]*"', "",
                  text[text.index("<svg") :])  # fmt: skip
    for colour, own in _OF_PAGE.items():
        text = text.replace(colour, own)
    begin, end = text.split(">", 1)
    begin = re.sub(r' (?:width|height|version)="[^"]*"', "", begin)  # the page sets the width, the viewBox keeps the shape
    return Html(f'{begin} class="figure" style="max-width: {1.25 * width:.2f}in" role="img" aria-label="{escape(alt)}">{end}')


def space(study: Study, poses: Mapping[str, PoseFit]):
    """All poses in space (m), for plotly: measured points coloured by their distance from the model (mm), model, and clamps.

    Traces of pose k carry ``meta`` k, with which the page selects one pose.
    """
    from plotly import graph_objects as go  # noqa: PLC0415  (only the interactive page needs it, and it comes with an extra)

    held = {name: [clamp for clamp in (study.pose(name).start, study.pose(name).end) if clamp is not None] for name in poses}
    places = [clamp.position[None] for clamps in held.values() for clamp in clamps]
    ranges, sides = _box([p.measured for p in poses.values()] + [p.modelled for p in poses.values() if p.stable] + places)
    axis = {"backgroundcolor": "rgba(0,0,0,0)", "showspikes": False}
    scene = {
        "aspectmode": "manual",
        "aspectratio": dict(zip("xyz", sides, strict=True)),
        "camera": {"eye": {"x": 1.4, "y": 1.4, "z": 1.0}},
        **{f"{k}axis": {"title": {"text": f"{k} (m)"}, "range": r, **axis} for k, r in zip("xyz", ranges, strict=True)},
    }
    bare = {"paper_bgcolor": "rgba(0,0,0,0)", "margin": {"l": 0, "r": 0, "t": 0, "b": 0}, "template": "none"}
    figure = go.Figure(layout={**bare, "scene": scene, "showlegend": False, "height": 560, "uirevision": "kept"})
    most = max((float(np.nanmax(d)) for p in poses.values() if p.stable and len(d := _distance(p))), default=0.0)
    size = max((float(np.ptp(p.measured, axis=0).max()) for p in poses.values()), default=1.0)
    for k, (name, p) in enumerate(poses.items()):
        figure.add_scatter3d(**_measured(p, most, first=k == 0), mode="markers", name=f"{escape(name)}, measured", meta=k)
        if p.stable:
            x, y, z = p.modelled.T
            figure.add_scatter3d(x=x, y=y, z=z, mode="lines", line={"width": 5, "color": MODELLED}, hoverinfo="name",
                                 name=f"{escape(name)}, modelled", meta=k)  # fmt: skip
        for clamp in held[name]:
            along = 0.0 if clamp.tangent is None else _TANGENT * size * clamp.tangent
            ends = np.stack([clamp.position, clamp.position + along])
            x, y, z = ends.T
            figure.add_scatter3d(x=x, y=y, z=z, mode="lines+markers", line={"width": 6, "color": _CLAMP}, hoverinfo="name",
                                 marker={"size": [6, 1], "color": _CLAMP, "symbol": "square"},
                                 name=f"{escape(name)}, clamp", meta=k)  # fmt: skip
    return figure


def _measured(p, most, first):
    """Measured points of one pose, coloured by their distance (mm) where it is known; ``most`` (mm) ends the scale."""
    x, y, z = p.measured.T
    at = {"x": x, "y": y, "z": z}
    distance = _distance(p)
    if not p.stable or not len(distance) or not np.all(np.isfinite(distance)) or not most > 0:
        return {**at, "marker": {"size": 3, "color": MODELLED}, "hoverinfo": "name"}
    bar = {"title": {"text": "distance (mm)", "side": "right"}, "thickness": 12, "exponentformat": "power", "len": 0.7,
           "x": 1.0, "xanchor": "right"}  # fmt: skip
    marker = {"size": 3, "color": distance, "colorscale": _DISTANCE, "cmin": 0.0, "cmax": most, "showscale": first}
    text = [f"s = {s:.3f} m<br>{d:.3f} mm off" for s, d in zip(p.s, distance, strict=True)]
    return {**at, "marker": {**marker, "colorbar": bar}, "text": text, "hoverinfo": "text+name"}


def _distance(p):
    """Distances (mm) of the measured points from the model."""
    return 1e3 * np.linalg.norm(p.residual, axis=1)


def _box(curves):
    """Ranges (m) of a box around all curves (n, 3), and its sides in plotly's unit: plotly's own box exceeds the picture for a
    cable that sags deeply."""
    points = np.concatenate(curves) if curves else np.zeros((1, 3))
    points = points[np.all(np.isfinite(points), axis=1)]
    low, high = (np.min(points, axis=0), np.max(points, axis=0)) if len(points) else (np.zeros(3), np.ones(3))
    longest = max(float(np.max(high - low)), 1e-9)
    half = 0.5 * np.maximum(high - low, _THINNEST * longest) + _MARGIN * longest
    middle = 0.5 * (low + high)
    return np.stack([middle - half, middle + half], axis=1).tolist(), (_SIDE * half / np.max(half)).tolist()
