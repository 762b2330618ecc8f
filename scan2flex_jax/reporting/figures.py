"""The figures of a report, with plotly. Lengths in space are in m, distances in mm, forces in N, moments in N m.

plotly reads texts as HTML: every text that comes from a study goes through `html.escape`. Colours carry no light or dark
background of their own; the page sets the colours of text and grid.
"""

from html import escape

import numpy as np

MODELLED = "#8a8f98"
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#8c6bb1", "#b2912f", "#a0522d", "#5f9ea0")
BEFORE, AFTER = "#8a8f98", "#d1495b"
_DISTANCE = ((0.0, "#2a9d8f"), (0.5, "#e9b44c"), (1.0, "#e63946"))
_ROOM = {"margin": {"l": 60, "r": 15, "t": 30, "b": 45}, "paper_bgcolor": "rgba(0,0,0,0)", "plot_bgcolor": "rgba(0,0,0,0)"}
_POWERS = {"exponentformat": "power"}  # not "5\u03bc" on an axis in mm
_LEGEND = {"orientation": "h", "yanchor": "bottom", "y": 1.02, "xanchor": "left", "x": 0.0}
_THINNEST = 0.15  # of its longest side: what a box around plane shapes is thick
_SIDE = 1.3  # of the longest, in units of plotly's cube
_MARGIN = 0.06  # the same: free space on all sides, for a clamp's line too
_TANGENT = 0.05  # of the picture's size: length of the line that shows a clamp's d3


def _figure(**layout):
    from plotly import graph_objects as go  # noqa: PLC0415  (only reports need it, and it comes with an extra)

    return go.Figure(layout={**_ROOM, "template": "none", **layout})


def _axes(x, y, **more):
    common = {"automargin": True, **_POWERS}
    return {"xaxis": {"title": {"text": x}, **common}, "yaxis": {"title": {"text": y}, **common, **more}}


def shapes(poses):
    """All poses in space (m): measured points coloured by their distance from the model (mm), the model, and the clamps.

    Traces of pose k carry ``meta`` k, by which the page shows one pose alone.
    """
    axis = {"backgroundcolor": "rgba(0,0,0,0)", "showspikes": False}
    ranges, sides = _box(poses)
    scene = {
        "aspectmode": "manual",
        "aspectratio": dict(zip("xyz", sides, strict=True)),
        "camera": {"eye": {"x": 1.4, "y": 1.4, "z": 1.0}},
        **{f"{k}axis": {"title": {"text": f"{k} (m)"}, "range": r, **axis} for k, r in zip("xyz", ranges, strict=True)},
    }
    figure = _figure(scene=scene, showlegend=False, height=560, uirevision="kept")
    figure.update_layout(margin={"l": 0, "r": 0, "t": 0, "b": 0})
    distances = [p.distance[np.isfinite(p.distance)] for p in poses if p.distance is not None]
    most = 1e3 * max((float(np.max(d)) for d in distances if len(d)), default=0.0)
    size = max((float(np.ptp(p.measured, axis=0).max()) for p in poses), default=1.0)
    for k, p in enumerate(poses):
        name = escape(p.name)
        coloured = p.distance is not None and np.all(np.isfinite(p.distance)) and most > 0
        marker = {"size": 3, "color": MODELLED}
        text = None
        if coloured:
            bar = {
                "title": {"text": "distance (mm)", "side": "right"},
                "thickness": 12,
                **_POWERS,
                "len": 0.7,
                "x": 1.0,
                "xanchor": "right",
            }
            marker |= {"color": 1e3 * p.distance, "colorscale": _DISTANCE, "cmin": 0.0, "cmax": most, "colorbar": bar}
            marker["showscale"] = k == 0
            text = [f"s = {s:.3f} m<br>{1e3 * d:.3f} mm off" for s, d in zip(p.s, p.distance, strict=True)]
        x, y, z = p.measured.T
        figure.add_scatter3d(x=x, y=y, z=z, mode="markers", marker=marker, text=text, hoverinfo="text+name" if text else "name",
                             name=f"{name}, measured", meta=k)  # fmt: skip
        if p.modelled is not None:
            x, y, z = p.modelled.T
            figure.add_scatter3d(x=x, y=y, z=z, mode="lines", line={"width": 5, "color": MODELLED}, hoverinfo="name",
                                 name=f"{name}, modelled", meta=k)  # fmt: skip
        for position, tangent in p.clamps:
            ends = np.stack([position, position if tangent is None else position + _TANGENT * size * tangent])
            x, y, z = ends.T
            figure.add_scatter3d(x=x, y=y, z=z, mode="lines+markers", line={"width": 6, "color": COLOURS[4]}, hoverinfo="name",
                                 marker={"size": [6, 1], "color": COLOURS[4], "symbol": "square"}, name=f"{name}, clamp",
                                 meta=k)  # fmt: skip
    return figure


def _box(poses):
    """Ranges (m) of a box around all poses, and its sides in plotly's unit: the box that plotly chooses outgrows the picture
    where a cable hangs deep."""
    curves = [c for p in poses for c in (p.measured, p.modelled, *(np.atleast_2d(at) for at, _ in p.clamps)) if c is not None]
    points = np.concatenate(curves) if curves else np.zeros((1, 3))
    points = points[np.all(np.isfinite(points), axis=1)]
    low, high = (np.min(points, axis=0), np.max(points, axis=0)) if len(points) else (np.zeros(3), np.ones(3))
    longest = max(float(np.max(high - low)), 1e-9)
    half = 0.5 * np.maximum(high - low, _THINNEST * longest) + _MARGIN * longest
    middle = 0.5 * (low + high)
    return np.stack([middle - half, middle + half], axis=1).tolist(), (_SIDE * half / np.max(half)).tolist()


def errors(poses):
    """Distance between measured and modelled curve along the cable, per pose (the paper's Fig. 4)."""
    figure = _figure(**_axes("arc length s (m)", "distance (mm)", rangemode="tozero"), legend=_LEGEND, height=420)
    for k, p in enumerate(poses):
        if p.distance is not None and np.all(np.isfinite(p.distance)):
            line = {"color": COLOURS[k % len(COLOURS)], "dash": "solid" if p.role == "fit" else "dash", "width": 2}
            figure.add_scatter(x=p.s, y=1e3 * p.distance, mode="lines", name=f"{escape(p.name)} ({p.role})", line=line)
    return figure


def correlation(labels, matrix):
    """Correlations of the estimated numbers; blank where there is none."""
    names = [escape(name.replace("_", " ")) for name in labels]
    values = np.where(np.isfinite(matrix), matrix, np.nan)
    figure = _figure(
        height=120 + 60 * len(names), yaxis={"autorange": "reversed", "automargin": True}, xaxis={"automargin": True}
    )
    text = [["" if not np.isfinite(v) else f"{v:+.2f}" for v in row] for row in values]
    scale = ((0.0, "#2b6cb0"), (0.5, "#b8bcc4"), (1.0, "#c05621"))
    figure.add_heatmap(x=names, y=names, z=values, zmin=-1, zmax=1, colorscale=scale, text=text, texttemplate="%{text}",
                       textfont={"color": "#111"}, hoverinfo="skip", showscale=False)  # fmt: skip
    return figure


def residual(pose, noise: float):
    """Both normal components of one pose's residual (mm) along s, before and after, over the 95 % band of the noise."""
    title = f"{escape(pose.name)} ({pose.role})"
    figure = _figure(**_axes("arc length s (m)", "residual (mm)"), height=300, title={"text": title, "font": {"size": 14}},
                     legend=_LEGEND, showlegend=False)  # fmt: skip
    band = 1.959964e3 * noise
    figure.add_hrect(y0=-band, y1=band, fillcolor=MODELLED, opacity=0.25, line_width=0)
    for values, colour, words in ((pose.before, BEFORE, "before"), (pose.residual, AFTER, "after")):
        for normal, dash in enumerate(("solid", "dot")):
            line = {"color": colour, "dash": dash, "width": 1.8}
            figure.add_scatter(
                x=pose.s, y=1e3 * values[:, normal], mode="lines", line=line, name=f"{words}, normal {normal + 1}"
            )
    return figure


def evidence(explanation, most: int = 10):
    """Log evidence of the likeliest kinds over the plain rod (nats)."""
    rows = explanation.ranking[:most][::-1]
    colours = {"named": AFTER, "favoured": AFTER, "tied": COLOURS[4]}
    shown = [max(r.log_evidence, -5.0) for r in rows]  # what is worse than nothing is not told apart
    figure = _figure(**_axes("log evidence over the plain rod (nats)", ""), height=90 + 30 * len(rows))
    figure.add_bar(x=shown, y=[escape(r.kind.replace("_", " ")) for r in rows], orientation="h", hoverinfo="x+y",
                   text=[escape(explanation.in_words(r)) for r in rows], textposition="outside", cliponaxis=False,
                   marker={"color": [colours.get(r.verdict, MODELLED) for r in rows]})  # fmt: skip
    figure.update_xaxes(range=[min(-6.0, 1.1 * min(shown)), 1.25 * max(*shown, 1.0)])
    return figure


def load(field):
    """The equivalent load (N/m, scan frame) that all poses share, with its 95 % band."""
    figure = _figure(**_axes("arc length s (m)", "equivalent load (N/m)"), legend=_LEGEND, height=340)
    for k, name in enumerate("xyz"):
        mean, band, colour = field.mean[:, k], 1.959964 * field.std[:, k], COLOURS[k]
        around = np.r_[mean + band, (mean - band)[::-1]]
        figure.add_scatter(x=np.r_[field.s, field.s[::-1]], y=around, fill="toself", fillcolor=colour, opacity=0.2, mode="none",
                           hoverinfo="skip", showlegend=False)  # fmt: skip
        figure.add_scatter(x=field.s, y=mean, mode="lines", name=name, line={"color": colour, "width": 2})
    return figure


def along(sections, names, quantity: str, label: str):
    """One quantity of all poses along the cable; ``names`` gives the poses their colours."""
    figure = _figure(**_axes("arc length s (m)", label), legend=_LEGEND, height=340)
    for view in sections:
        colour = COLOURS[names.index(view.name) % len(COLOURS)]
        line = {"color": colour, "width": 2}
        figure.add_scatter(x=view.s, y=getattr(view, quantity), mode="lines", name=escape(view.name), line=line)
    return figure
