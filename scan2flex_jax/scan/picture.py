"""Plot of one pose's extraction: the cloud, the stages of the curve, and radius and standard deviation along s.

Units in the picture: m for space, mm for residuals and standard deviations.
"""

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from scan2flex_jax.errors import Scan2FlexError
from scan2flex_jax.names import drawn
from scan2flex_jax.scan.centre_curve import CentreCurve
from scan2flex_jax.study.outputs import write_file

_STAGES = (("coarse", "tab:orange", "--"), ("snakes", "tab:green", "-."))


def plot_extraction(curve: CentreCurve, title: str = "") -> Any:
    """A matplotlib figure of the extraction, not shown, saved or closed."""
    from matplotlib.figure import Figure  # noqa: PLC0415  (matplotlib loads slowly and only pictures need it)

    figure = Figure(figsize=(11.0, 5.5), layout="constrained")
    space = figure.add_subplot(1, 2, 1, projection="3d")
    cloud = curve.stages.get("points used", curve.stages.get("cloud"))
    if cloud is not None:
        some = cloud[:: max(1, len(cloud) // 3000)]
        space.plot(*some.T, ".", ms=1.0, color="0.6", label="cloud")
    for name, colour, style in _STAGES:
        if name in curve.stages:
            space.plot(*curve.stages[name].T, style, color=colour, lw=1.0, label=name)
    if "guide points" in curve.stages:
        space.plot(*curve.stages["guide points"].T, "o", ms=4.0, color="tab:red", label="guide points")
    space.plot(*curve.points.T, "-", color="tab:blue", lw=1.8, label="centre curve")
    space.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)", title=drawn(title))
    space.set_aspect("equal")
    space.locator_params(nbins=4)  # a short side has no room for more
    space.legend(loc="upper left", fontsize="small")
    _along(figure, curve)
    return figure


def _along(figure, curve: CentreCurve) -> None:
    """Standard deviation and curvature along s, gaps shaded; the warnings underneath."""
    above = figure.add_subplot(2, 2, 2)
    above.plot(curve.arc_length, 1e3 * curve.std)
    above.set(ylabel="std (mm)", ylim=(0.0, None))
    above.set_title(
        f"length {curve.length:.4f} m, radius {1e3 * curve.radius.mean:.2f} mm, noise {1e3 * curve.noise:.2f} mm",
        fontsize="small",
    )
    below = figure.add_subplot(2, 2, 4, sharex=above)
    bend = np.linalg.norm(np.gradient(curve.tangents, curve.arc_length, axis=0), axis=1)
    below.plot(curve.arc_length, bend)
    below.set(xlabel="s (m)", ylabel="curvature (1/m)", ylim=(0.0, None))
    for axes in (above, below):
        for low, high in curve.gaps:
            axes.axvspan(low, high, color="0.85")
    if curve.warnings:
        figure.supxlabel("\n".join(map(drawn, curve.warnings)), fontsize="x-small")


def save_picture(
    curve: CentreCurve, path: str | Path, title: str = "", write: Callable[[Path, bytes], None] = write_file
) -> Path:
    """Write the picture of an extraction (PNG, PDF or SVG, by the extension) in one step; a study's own files are refused.

    ``write(path, bytes)`` writes the file.
    """
    path, picture = Path(path), io.BytesIO()
    figure, kind = plot_extraction(curve, title), path.suffix.lstrip(".").lower() or "png"
    if kind not in figure.canvas.get_supported_filetypes():
        raise Scan2FlexError(f"{path.name} is not a picture: name a file that ends in .png, .svg or .pdf")
    figure.savefig(picture, format=kind, dpi=130)
    write(path, picture.getvalue())
    return path
